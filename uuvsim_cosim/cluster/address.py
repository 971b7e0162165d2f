"""A Ray cluster is reached by its address, or one sentence says why it is not."""

from __future__ import annotations

import importlib
import os
import re
import secrets
import shutil
import signal
import socket
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import InputInvalid

__all__ = ["connect"]

EXPECTED = "expected auto, local, HOST:PORT of a Ray head, or ray://HOST:PORT"
ANSWER = 5.0  # s, that a port is waited for
TRIES = 3  # of a connection from outside
FAILED = "Initialization failure from server:"  # what Ray Client says before the reason
HTTP2 = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\x04\0\0\0\0\0"  # RFC 9113, 3.4
SETTINGS = 4  # type of the frame that every HTTP/2 server answers with
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",  # nothing is told to anybody
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # what Ray would warn of
}


def connect(address: str, workers: int | None = None) -> tuple[Any, Callable[[], None]]:
    """Connect to a cluster; gives the module ray, and what ends the connection.

    Where this process is connected already, that is used, and not ended. Raises InputInvalid.
    """
    kind = _kind(address)
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    if address.startswith("ray://"):
        _answered(address)
        if _has_token():  # it is asked for before Ray is imported
            os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        import ray
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; --ray expects it: pip install 'uuvsim-cosim[distributed]'"
        ) from None
    if ray.is_initialized():
        _check_it_is(ray, address)
        return ray, lambda: None
    guard = _Guard() if kind == "local" else None
    if kind == "port" and not address.startswith("ray://"):
        _answered(address)
    given: dict[str, Any] = {"address": address, "logging_level": "ERROR"}
    if guard is not None:
        given["_temp_dir"] = guard.folder
        count = workers or os.cpu_count() or 1
        given |= {"num_cpus": count, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    if not address.startswith("ray://"):
        given["log_to_driver"] = False
    before = signal.getsignal(signal.SIGTERM)
    try:
        _init(ray, given)
    except BaseException as error:
        refused = _refused(ray, address, error)
        if guard is not None:
            guard.end()
        raise refused from None
    finally:
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGTERM, before)  # Ray sets its own
    end = _silenced(ray)
    if guard is None:
        return ray, end

    def end_all() -> None:
        end()
        guard.end()

    return ray, end_all


def _refused(ray: Any, address: str, error: BaseException) -> BaseException:
    """Return what to raise where Ray did not connect."""
    if isinstance(error, ImportError):  # Ray Client needs grpc
        return InputInvalid(
            f"{address}: {_line(error)}; expected pip install 'uuvsim-cosim[distributed]'"
        )
    if isinstance(error, ConnectionError | ValueError):
        return InputInvalid(_nothing(address, error))
    if not isinstance(error, Exception):
        return error
    ray.shutdown()  # RuntimeError, RpcError and others
    return InputInvalid(_other(address, error))


class _Guard:
    """A local cluster that only this process and its children can use, on loopback.

    By default Ray listens on all interfaces, keeps its sockets in a folder that every account may
    write to, and writes its token to a file that others may read. Whoever has the token or the
    sockets can run code as this user.
    """

    def __init__(self) -> None:
        own = {
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
            "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # of Ray's processes: loopback alone
        }
        self._before = {name: os.environ.get(name) for name in (*own, "RAY_AUTH_TOKEN_PATH")}
        os.environ |= own
        os.environ.pop("RAY_AUTH_TOKEN_PATH", None)
        constants: Any = importlib.import_module("ray._private.ray_constants")
        self._constants, self._beyond = constants, constants.ENABLE_RAY_CLUSTER
        constants.ENABLE_RAY_CLUSTER = False  # the same, of this process
        # A socket's path has at most 107 characters, and TMPDIR may be long.
        short = "/tmp" if os.path.isdir("/tmp") else None
        self._private = tempfile.mkdtemp(prefix="uuvsim-ray-", dir=short)  # mode 0700
        self.folder = f"{self._private}/r"  # Ray opens its own folder to every account
        _read_token_again()

    def end(self) -> None:
        """Put the settings back and remove Ray's files; the cluster has ended before."""
        for name, value in self._before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
        self._constants.ENABLE_RAY_CLUSTER = self._beyond
        _read_token_again()
        shutil.rmtree(self._private, ignore_errors=True)


def _read_token_again() -> None:
    """Have Ray, which keeps mode and token from their first use on, take those of now."""
    inside: Any = importlib.import_module("ray._raylet")
    inside.Config.initialize("")
    inside.AuthenticationTokenLoader.instance().reset_cache()


def _init(ray: Any, given: dict[str, Any]) -> None:
    """Connect; again where a head could not start the process that answers ray://.

    gRPC's fork handlers kill it now and then, on a head without GRPC_ENABLE_FORK_SUPPORT=0.
    """
    for left in reversed(range(TRIES)):
        try:
            ray.init(**given)
            return
        except ConnectionError as error:
            if not left or not _of_the_head(error):
                raise


def _of_the_head(error: BaseException) -> bool:
    """Return whether a connection failed within the head, which then sends its traceback."""
    return FAILED in str(error) and "Traceback" in str(error)


def _has_token() -> bool:
    """Return whether there is a token, where Ray looks for one; a head then asks for it."""
    if os.environ.get("RAY_AUTH_TOKEN"):
        return True
    path = os.environ.get("RAY_AUTH_TOKEN_PATH") or "~/.ray/auth_token"
    return Path(path).expanduser().is_file()


def _kind(address: str) -> str:
    """Say what an address is: "auto", "local" or "port"."""
    if address in ("auto", "local"):
        return address
    found = re.fullmatch(r"(ray://)?(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})", address)
    if found is None or not 0 < int(found[3]) < 65536:
        raise InputInvalid(f"--ray {address}: no address; {EXPECTED}")
    return "port"


def _answered(address: str) -> None:
    """Raise InputInvalid unless something answers there as a Ray head would: by HTTP/2."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    try:
        with socket.create_connection((host.strip("[]"), int(port)), ANSWER) as other:
            if os.environ.get("RAY_USE_TLS", "0") != "0":
                return
            other.settimeout(ANSWER)
            other.sendall(HTTP2)
            head = other.recv(9)
    except TimeoutError:
        head = b""
    except OSError as error:
        said = error.strerror or str(error)
        raise InputInvalid(
            f"--ray {address}: {said}; expected a Ray head there (ray start --head)"
        ) from None
    if len(head) < 4 or head[3] != SETTINGS:
        raise InputInvalid(
            f"--ray {address}: what listens there does not speak as a Ray head does; {EXPECTED}"
        )


def _silenced(ray: Any) -> Callable[[], None]:
    """Have Ray print nothing between our lines; what it says of dead workers, `Cluster` says.

    Gives what ends the connection, and lets it print again.
    """
    module: Any = importlib.import_module("ray._private.worker")
    before = getattr(module, "print_to_stdstream", None)
    if before is not None:
        module.print_to_stdstream = lambda *_, **__: None

    def end() -> None:
        ray.shutdown()
        if before is not None:
            module.print_to_stdstream = before

    return end


def _check_it_is(ray: Any, address: str) -> None:
    there = ray.get_runtime_context().gcs_address
    if address not in ("auto", there):
        raise InputInvalid(
            f"--ray {address}: this process is connected to {there} already; expected that or auto"
        )


def _nothing(address: str, error: Exception) -> str:
    if address == "auto":
        return "--ray auto: no Ray cluster on this machine; expected `ray start` before, or local"
    return f"--ray {address}: {_line(error)}; {EXPECTED}"


def _other(address: str, error: Exception) -> str:
    text = str(error)
    if "ersion mismatch" in text:
        there, here = (
            re.search(rf"{who}.*?Ray: (\S+).*?Python: (\S+)", text, re.DOTALL)
            for who in ("started with", "This process")
        )
        if there and here:
            return (
                f"--ray {address}: Ray {there[1]} on Python {there[2]} there; expected Ray "
                f"{here[1]} on Python {here[2]}, as here"
            )
    hint = ""
    if address.startswith("ray://"):
        hint = "; RAY_AUTH_MODE is token where the head asks for one, else disabled"
    return f"--ray {address}: {_line(error)}{hint}"


def _line(error: BaseException) -> str:
    """Return the first line of what Ray said, or the last where that is a head's traceback."""
    reason = str(error).replace(FAILED, "")
    lines = [text.strip() for text in reason.splitlines() if text.strip()]
    said = lines[-1 if _of_the_head(error) else 0] if lines else type(error).__name__
    return said[:200].rstrip(".")
