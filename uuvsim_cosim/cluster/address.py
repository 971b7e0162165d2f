"""Connection to a Ray cluster by its address, with one clear error message if that fails."""

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
from types import ModuleType
from typing import Any

from uuvsim_cosim.errors import InputInvalid

__all__ = ["connect"]

EXPECTED = "expected auto, local, HOST:PORT of a Ray head, or ray://HOST:PORT"
ANSWER = 5.0  # [s] to wait for an answer of a port
TRIES = 3  # attempts of a connection from outside of the cluster
FAILED = "Initialization failure from server:"  # what Ray Client writes before the reason
HTTP2 = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0\x04\0\0\0\0\0"  # RFC 9113, 3.4
SETTINGS = 4  # type of the frame by which every HTTP/2 server answers
QUIET = {
    "RAY_USAGE_STATS_ENABLED": "0",  # send no statistics
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",  # avoid a warning of Ray
}


def connect(address: str, workers: int | None = None) -> tuple[ModuleType, Callable[[], None]]:
    """Connect to a cluster; return the module ray, and a function that ends the connection.

    If this process is connected already, that connection is used, and not ended. Raises
    InputInvalid.
    """
    if address not in ("auto", "local"):
        found = re.fullmatch(r"(ray://)?(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})", address)
        if found is None or not 0 < int(found[3]) < 65536:
            raise InputInvalid(f"--ray {address}: no address; {EXPECTED}")
    for name, value in QUIET.items():
        os.environ.setdefault(name, value)
    if address.startswith("ray://"):
        _answered(address)
        # A head asks for a token if there is one; Ray reads the mode when it is imported.
        token_file = os.environ.get("RAY_AUTH_TOKEN_PATH") or "~/.ray/auth_token"
        if os.environ.get("RAY_AUTH_TOKEN") or Path(token_file).expanduser().is_file():
            os.environ.setdefault("RAY_AUTH_MODE", "token")
    try:
        import ray
    except ModuleNotFoundError as error:
        raise InputInvalid(
            f"{error}; --ray expects it: pip install 'uuvsim-cosim[distributed]'"
        ) from None
    if ray.is_initialized():
        there = ray.get_runtime_context().gcs_address
        if address not in ("auto", there):
            raise InputInvalid(
                f"--ray {address}: this process is connected to {there} already", "that or auto"
            )
        return ray, lambda: None
    guard = _Guard() if address == "local" else None
    if address not in ("auto", "local") and not address.startswith("ray://"):
        _answered(address)
    options: dict[str, object] = {"address": address, "logging_level": "ERROR"}
    if guard is not None:
        options["_temp_dir"] = guard.folder
        count = workers or os.cpu_count() or 1
        options |= {"num_cpus": count, "include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    if not address.startswith("ray://"):
        options["log_to_driver"] = False
    before = signal.getsignal(signal.SIGTERM)
    try:
        # gRPC's fork handlers sometimes kill the process that answers ray://, on a head without
        # GRPC_ENABLE_FORK_SUPPORT=0: then it is tried again.
        for remaining in reversed(range(TRIES)):
            try:
                ray.init(**options)
                break
            except ConnectionError as error:
                if not remaining or not _of_the_head(error):
                    raise
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


def _refused(ray: ModuleType, address: str, error: BaseException) -> BaseException:
    """Return the error to raise if Ray does not connect."""
    if isinstance(error, ImportError):  # Ray Client needs grpc
        return InputInvalid(address, _line(error), "pip install 'uuvsim-cosim[distributed]'")
    if isinstance(error, ConnectionError | ValueError):
        if address == "auto":
            return InputInvalid(
                "--ray auto: no Ray cluster on this machine", "`ray start` before, or local"
            )
        return InputInvalid(f"--ray {address}: {_line(error)}; {EXPECTED}")
    if not isinstance(error, Exception):
        return error
    ray.shutdown()  # RuntimeError, RpcError and others
    text = str(error)
    if "ersion mismatch" in text:
        there, here = (
            re.search(rf"{who}.*?Ray: (\S+).*?Python: (\S+)", text, re.DOTALL)
            for who in ("started with", "This process")
        )
        if there and here:
            return InputInvalid(
                f"--ray {address}: Ray {there[1]} on Python {there[2]} there",
                f"Ray {here[1]} on Python {here[2]}, as here",
            )
    hint = ""
    if address.startswith("ray://"):
        hint = "; RAY_AUTH_MODE is token where the head asks for one, else disabled"
    return InputInvalid(f"--ray {address}: {_line(error)}{hint}")


class _Guard:
    """A local cluster that only this process and its children can use, on loopback.

    By default, Ray listens on all interfaces, keeps its sockets in a folder that every account may
    write to, and writes its token to a file that others may read. With the token or the sockets,
    other accounts could run code as this user.
    """

    def __init__(self) -> None:
        own = {
            "RAY_AUTH_MODE": "token",
            "RAY_AUTH_TOKEN": secrets.token_hex(32),
            "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # Ray's processes listen on loopback only
        }
        self._before = {name: os.environ.get(name) for name in (*own, "RAY_AUTH_TOKEN_PATH")}
        os.environ |= own
        os.environ.pop("RAY_AUTH_TOKEN_PATH", None)
        constants: Any = importlib.import_module("ray._private.ray_constants")
        self._constants, self._cluster_enabled = constants, constants.ENABLE_RAY_CLUSTER
        constants.ENABLE_RAY_CLUSTER = False  # this process, too
        # A socket's path has at most 107 characters, and TMPDIR may be long.
        short = "/tmp" if os.path.isdir("/tmp") else None
        self._private = tempfile.mkdtemp(prefix="uuvsim-ray-", dir=short)  # mode 0700
        self.folder = f"{self._private}/r"  # Ray opens its own folder to every account
        _read_token_again()

    def end(self) -> None:
        """Restore the settings and remove Ray's files; the cluster must have ended."""
        for name, value in self._before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value
        self._constants.ENABLE_RAY_CLUSTER = self._cluster_enabled
        _read_token_again()
        shutil.rmtree(self._private, ignore_errors=True)


def _read_token_again() -> None:
    """Let Ray read mode and token again, which it caches at their first use."""
    raylet = importlib.import_module("ray._raylet")
    raylet.Config.initialize("")
    raylet.AuthenticationTokenLoader.instance().reset_cache()


def _of_the_head(error: BaseException) -> bool:
    """Return whether a connection failed within the head, which then sends its traceback."""
    return FAILED in str(error) and "Traceback" in str(error)


def _answered(address: str) -> None:
    """Raise InputInvalid unless a server answers there by HTTP/2, as a Ray head does."""
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
        reason = error.strerror or str(error)
        raise InputInvalid(
            f"--ray {address}: {reason}", "a Ray head there (ray start --head)"
        ) from None
    if len(head) < 4 or head[3] != SETTINGS:
        raise InputInvalid(
            f"--ray {address}: the server at this address is not a Ray head; {EXPECTED}"
        )


def _silenced(ray: ModuleType) -> Callable[[], None]:
    """Let Ray print nothing: `Cluster` reports dead workers itself.

    Return a function that ends the connection and restores Ray's output.
    """
    module = importlib.import_module("ray._private.worker")
    name = "print_to_stdstream"
    before = getattr(module, name, None)
    if before is not None:
        setattr(module, name, lambda *_, **__: None)

    def end() -> None:
        ray.shutdown()
        if before is not None:
            setattr(module, name, before)

    return end


def _line(error: BaseException) -> str:
    """Return the first line of Ray's message, or the last one of a head's traceback."""
    reason = str(error).replace(FAILED, "")
    lines = [text.strip() for text in reason.splitlines() if text.strip()]
    line = lines[-1 if _of_the_head(error) else 0] if lines else type(error).__name__
    return line[:200].rstrip(".")
