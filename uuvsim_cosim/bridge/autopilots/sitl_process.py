"""The process of an autopilot, which starts in an empty folder and ends with its run."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, final

from uuvsim_cosim.bridge.autopilots.json_interface import AutopilotLost
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = ["HOME", "MAVLINK_PORT", "Px4Build", "SitlProcess", "ardusub_binary", "px4_build"]

MAVLINK_PORT = 5760  # TCP, of instance 0; each further instance has 10 more
HOME = (47.3, -122.5)  # degrees N and E of the origin of n; its altitude is 0
_NAMES = {b"ArduCopter V": "ArduCopter", b"ArduPlane V": "ArduPlane", b"ArduRover V": "ArduRover"}
_OBTAIN = (
    "ArduSub's simulation binary: `git clone --recurse-submodules "
    "https://github.com/ArduPilot/ardupilot`, there `./waf configure --board sitl` and `./waf "
    "sub`, then --ardusub build/sitl/bin/ardusub, or this folder in the PATH"
)
_GRACE = 2.0  # s to end after a request


_OBTAIN_PX4 = (
    "PX4's simulation build: `git clone --recurse-submodules "
    "https://github.com/PX4/PX4-Autopilot`, there `make px4_sitl_default`, "
    "then --px4 build/px4_sitl_default"
)
_PX4_AIRFRAME = "uuv_bluerov2_heavy"


def ardusub_binary(path: str) -> Path:
    """Return ArduSub's binary at a `path`, or that in the PATH if it is empty.

    Raises InputInvalid if there is none, or if it is another vehicle's.
    """
    found = _file(path, "ardusub", _OBTAIN)
    data = found.read_bytes()
    if b"ArduSub V" not in data:
        others = [name for text, name in _NAMES.items() if text in data]
        raise InputInvalid(found, f"is {others[0] if others else 'no ArduSub'}", _OBTAIN)
    return _executable(found)


class Px4Build(NamedTuple):
    """A build of PX4."""

    binary: Path
    etc: Path  # its start scripts
    airframe: str  # number and name of the BlueROV2 Heavy's


def px4_build(path: str) -> Px4Build:
    """Return the build of PX4 at a `path`: its folder, or its binary; if empty, that in the PATH.

    Raises InputInvalid if there is none, or if it has no start scripts for the BlueROV2 Heavy.
    """
    folder = Path(path).expanduser()
    inside = str(folder / "bin" / "px4") if path and folder.is_dir() else path
    binary = _executable(_file(inside, "px4", _OBTAIN_PX4)).resolve()
    etc = binary.parent.parent / "etc"
    scripts = etc / "init.d-posix"
    if not (scripts / "rcS").is_file():
        raise InputInvalid(scripts / "rcS", "no such file, a start script of PX4", _OBTAIN_PX4)
    airframes = sorted(p.name for p in (scripts / "airframes").glob(f"*{_PX4_AIRFRAME}"))
    if not airframes:
        raise InputInvalid(scripts / "airframes", f"has no airframe {_PX4_AIRFRAME}", _OBTAIN_PX4)
    return Px4Build(binary, etc, airframes[-1])


def _file(path: str, name: str, obtain: str) -> Path:
    """Return the file at a `path`, or `name` in the PATH if it is empty."""
    found = Path(path).expanduser() if path else Path(shutil.which(name) or name)
    if not found.is_file():
        files = [p.name for p in found.parent.iterdir()] if path and found.parent.is_dir() else []
        place = f"{found}" if path else f"{name} in the PATH"
        raise InputInvalid(place, f"no such file{did_you_mean(found.name, files)}", obtain)
    return found


def _executable(file: Path) -> Path:
    if not os.access(file, os.X_OK):
        raise InputInvalid(file, "may not be executed", f"`chmod +x {file}`")
    return file.absolute()


@final
class SitlProcess:
    """A running autopilot and its folder."""

    def __init__(
        self, name: str, command: Sequence[str], folder: str, files: Mapping[str, str],
        environment: Mapping[str, str] | None = None,
    ) -> None:  # fmt: skip
        """Write the `files` and start the `command` beside them, with more of an `environment`.

        With no `folder`, it runs in a temporary one, which is removed at the end. Raises
        InputInvalid if the folder is not empty.
        """
        self._name = name
        self._keeps = bool(folder)
        self.folder = Path(folder).expanduser().absolute() if folder else Path(
            tempfile.mkdtemp(prefix=f"uuvsim-{name.lower()}-")
        )  # fmt: skip
        if self.folder.exists() and any(self.folder.iterdir()):
            raise InputInvalid(self.folder, "is not empty", f"an empty or a new folder for {name}")
        self.folder.mkdir(parents=True, exist_ok=True)
        for file, text in files.items():
            (self.folder / file).write_text(text)
        # A process that is killed cannot end its autopilot; the kernel does.
        bound = ["setpriv", "--pdeathsig", "KILL"] if shutil.which("setpriv") else []
        with (self.folder / "output.txt").open("wb") as output:
            self._process = subprocess.Popen(
                [*bound, *command], cwd=self.folder, stdin=subprocess.DEVNULL, stdout=output,
                stderr=subprocess.STDOUT, start_new_session=True,
                env={**os.environ, **(environment or {})},
            )  # fmt: skip

    def check(self, wait: float = 0.0) -> None:
        """Raise AutopilotLost if the process has ended, or ends within `wait` [s]."""
        try:
            status = self._process.wait(wait)
        except subprocess.TimeoutExpired:
            return
        lines = (self.folder / "output.txt").read_text(errors="replace").strip().splitlines()
        how = f"by signal {-status}" if status < 0 else f"with status {status}"
        last = f"; its last line is {lines[-1]!r}" if lines else ""
        raise AutopilotLost(
            f"the {self._name} binary", f"ended {how}{last}", "it to run until the end"
        )

    def ask_to_end(self) -> None:
        """Send the request to end, SIGTERM; `close` sends it too, and waits."""
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(self._process.pid, signal.SIGTERM)

    def close(self) -> None:
        """End the process and remove a temporary folder; a second call does nothing."""
        for number in (signal.SIGTERM, signal.SIGKILL):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, number)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_GRACE)
                break
        if not self._keeps:
            shutil.rmtree(self.folder, ignore_errors=True)

    def connected(self, port: int, timeout: float) -> socket.socket:
        """Connect to a serial port within `timeout` [s]; ArduSub waits for that before it begins.

        Raises AutopilotLost.
        """
        start = time.monotonic()
        while True:
            with contextlib.suppress(OSError):
                connection = socket.create_connection(("127.0.0.1", port), timeout)
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                return connection
            self.check()
            if time.monotonic() - start > timeout:
                raise AutopilotLost(
                    f"the {self._name} binary",
                    f"no connection at TCP port {port} for {timeout:g} s",
                    "its first serial port to listen there",
                )  # fmt: skip
            time.sleep(0.02)
