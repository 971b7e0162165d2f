"""PX4's simulator protocol: messages of sensors and actuators, and their lockstep exchange by TCP.

The simulator listens at port 4560 (+1 per instance), and PX4 connects. HIL_SENSOR with id 0 sets
PX4's clock. PX4 is silent until its first actuator output. From then on it answers each HIL_SENSOR
with HIL_ACTUATOR_CONTROLS of the same time, and waits for the next one. Some versions of PX4 count
time from the first HIL_SENSOR, whose time is therefore 1 µs.
"""

from __future__ import annotations

import math
import select
import socket
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, final

from uuvsim_cosim.bridge.autopilots.json_interface import AutopilotLost
from uuvsim_cosim.errors import InputInvalid

__all__ = ["FIRST", "Controls", "HilLink"]

PORT = 4560  # TCP, of instance 0; each further instance has 1 more, as of all ports
_OURS, _THEIRS = 14540, 14580  # UDP, of the API link: commands to PX4, and its messages
FIRST = 1  # µs, time of the first HIL_SENSOR
_SLICE = 0.1  # s, between two looks whether the autopilot still runs
_ENDING = 0.3  # s, in which a process ends whose connection has closed
_STRAY = 10_000  # messages that may be ignored during one exchange
_LOCKSTEP, _ARMED = 1, 128  # bits of HIL_ACTUATOR_CONTROLS: of `flags`, and of `mode`


@dataclass(frozen=True)
class Controls:
    """Outputs of PX4 for one time of its clock."""

    time: int  # µs
    armed: bool
    controls: tuple[float, ...]  # 16 channels, -1 to 1


@final
class HilLink:
    """The simulator's side of the protocol, on this machine only.

    `counts` has the number of messages that were ignored, by reason; `received` is that of answers.
    """

    def __init__(self, instance: int, timeout: float) -> None:
        """Listen at the port of an `instance`; `timeout` [s] is the longest wait for an answer.

        Raises InputInvalid if another program has one of its ports, or without pymavlink.
        """
        try:
            from pymavlink.dialects.v20 import ardupilotmega
        except ImportError:
            raise InputInvalid(
                "PX4", "its protocol needs pymavlink", "`pip install 'uuvsim-cosim[mavlink]'`"
            ) from None
        self.dialect: Any = ardupilotmega
        self.instance = instance
        self.counts = {"invalid": 0, "other": 0, "stale": 0}
        self.received = 0
        self._mav = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=200)
        self._mav.robust_parsing = True
        self._timeout = timeout
        self._written = bytearray()
        self._read: deque[Any] = deque()
        self._last = -1  # µs, time of the last answer
        self._connection: socket.socket | None = None
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self.onboard = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        place = f"TCP port {PORT + instance}"
        try:
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.bind(("127.0.0.1", PORT + instance))
            self._listener.listen(1)
            place = f"UDP port {_OURS + instance}"
            self.onboard.bind(("127.0.0.1", _OURS + instance))
        except OSError as error:
            self.close()
            raise InputInvalid(
                f"{place} of PX4's instance {instance}",
                f"is used by another program ({error.strerror})",
                f"a free port, or another instance, as px4:?instance={instance + 1}",
            ) from None
        self.onboard.connect(("127.0.0.1", _THEIRS + instance))

    def accept(self, alive: Callable[..., None]) -> None:
        """Wait until PX4 has connected; `alive`, given a time [s] or not, raises if it has ended.

        Raises AutopilotLost.
        """
        end = time.monotonic() + self._timeout
        while not _readable(self._listener, min(_SLICE, end - time.monotonic())):
            alive()
            if time.monotonic() > end:
                raise self._lost(f"did not connect for {self._timeout:g} s",
                                 "it to connect, or a longer ?timeout=")  # fmt: skip
        self._connection, _ = self._listener.accept()
        self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._connection.settimeout(self._timeout)

    def add(self, message: Any) -> None:
        """Collect a message, which the next exchange writes."""
        self._written += message.pack(self._mav)
        self._mav.seq = (self._mav.seq + 1) % 256

    def first(self, wait: float, alive: Callable[..., None]) -> Controls | None:
        """Write the messages; return PX4's first output if it arrives within `wait` [s].

        Raises AutopilotLost.
        """
        self._write()
        end = time.monotonic() + wait
        while (left := end - time.monotonic()) > 0.0:
            message = self._next(left, alive)
            if message is not None and message.get_type() == "HIL_ACTUATOR_CONTROLS":
                self.received += 1
                return self._judged(message)
        return None

    def exchange(self, time_us: int, alive: Callable[..., None]) -> Controls:
        """Write the messages of a time, and return the outputs for it. Raises AutopilotLost."""
        self._write()
        end = time.monotonic() + self._timeout
        for _ in range(_STRAY):
            message = self._next(end - time.monotonic(), alive)
            if message is None:
                raise self._lost(f"no answer for {self._timeout:g} s", "HIL_ACTUATOR_CONTROLS "
                                 "within this time, or a longer ?timeout=")  # fmt: skip
            if message.get_type() != "HIL_ACTUATOR_CONTROLS":
                continue
            found = self._judged(message)
            if time_us - FIRST <= found.time <= time_us:
                self.received += 1
                return found
            if found.time > time_us:
                raise self._lost(
                    f"its time is {found.time} µs after HIL_SENSOR of {time_us} µs",
                    "a clock that only this simulation sets",
                )
            self.counts["stale"] += 1
        raise self._lost(f"{_STRAY} messages in a row that are not the answer ({self.counts})",
                         "one HIL_ACTUATOR_CONTROLS for each HIL_SENSOR")  # fmt: skip

    def close(self) -> None:
        """Free the ports."""
        for one in (self._listener, self._connection, self.onboard):
            if one is not None:
                one.close()

    # ---- inside ---------------------------------------------------------------------------

    def _judged(self, message: Any) -> Controls:
        """Return the outputs of a message; raises AutopilotLost for wrong ones."""
        found = Controls(message.time_usec, bool(message.mode & _ARMED), tuple(message.controls))
        if not message.flags & _LOCKSTEP:
            raise self._lost("it runs without lockstep (flag 1 of HIL_ACTUATOR_CONTROLS)",
                             "a build with lockstep, as `make px4_sitl_default`")  # fmt: skip
        if found.time < self._last:
            raise self._lost(
                f"its time fell from {self._last} to {found.time} µs",
                "one start for each run; reset the simulation, so that both begin anew",
            )
        for i, control in enumerate(found.controls, start=1):
            if not math.isfinite(control):
                raise self._lost(f"control {i} is {control} at {found.time} µs", "finite controls")
        self._last = found.time
        return found

    def _next(self, wait: float, alive: Callable[..., None]) -> Any:
        """Return the next valid message within `wait` [s]; None if there is none."""
        assert self._connection is not None
        end = time.monotonic() + wait
        while not self._read:
            if not _readable(self._connection, min(_SLICE, end - time.monotonic())):
                alive()
                if time.monotonic() >= end:
                    return None
                continue
            try:
                data = self._connection.recv(65_536)
            except OSError:
                data = b""
            if not data:
                alive(_ENDING)
                again = _readable(self._listener, 0.0)
                raise self._lost(
                    f"it closed its connection{' and connected again' if again else ''}",
                    "one connection until the end; reset the simulation, so that both begin anew",
                )
            for message in self._mav.parse_buffer(data) or ():
                kind = message.get_type()
                if kind == "BAD_DATA":
                    self.counts["invalid"] += 1
                self.counts["other"] += kind not in ("BAD_DATA", "HIL_ACTUATOR_CONTROLS")
                self._read.append(message)
        return self._read.popleft()

    def _write(self) -> None:
        assert self._connection is not None
        try:
            self._connection.sendall(self._written)
        except TimeoutError:
            raise self._lost(f"it has read nothing for {self._timeout:g} s",
                             "it to read each HIL_SENSOR") from None  # fmt: skip
        except OSError:
            pass  # its end of the connection is closed, which reading reports with the reason
        self._written.clear()

    def _lost(self, happened: str, expected: str) -> AutopilotLost:
        when = "before its first output" if self._last < 0 else f"time {self._last} µs"
        return AutopilotLost(f"PX4 at TCP port {PORT + self.instance}, {when}", happened, expected)


def _readable(one: socket.socket, wait: float) -> bool:
    return bool(select.select([one], [], [], max(0.0, wait))[0])
