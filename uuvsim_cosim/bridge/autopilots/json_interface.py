"""ArduPilot's JSON interface: servo packets, lines of state, and their lockstep exchange by UDP.

The autopilot sends a packet of pulse widths and then waits for one line of state. All numbers of a
packet are little-endian (libraries/SITL/examples/JSON of ArduPilot):

    u16 magic (18458: 16 channels, 29569: 32), u16 frame rate [Hz], u32 frame count, u16 widths [µs]
"""

from __future__ import annotations

import math
import select
import socket
import struct
import time
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, final

from uuvsim_cosim.errors import InputInvalid, UuvsimError

__all__ = ["AutopilotLost", "JsonLink", "ServoPacket", "read_servo_packet", "state_line"]

PORT = 9002  # of instance 0; each further instance has 10 more
_CHANNELS = {18458: 16, 29569: 32}
_HEAD = struct.Struct("<HHI")
_WHOLE = {40: struct.Struct("<HHI16H"), 72: struct.Struct("<HHI32H")}  # by the number of bytes
_SLICE = 0.1  # s, between two looks whether the autopilot still runs
# The autopilot repeats a packet after 1 s without an answer. It may do so at the same moment as
# the answer arrives, and then sends the next packet at once.
_REPEATED = 0.2  # s
_STRAY = 10_000  # packets that may be ignored during one exchange
_LINE = (
    '\n{"timestamp":%.9f,"imu":{"gyro":[%.9g,%.9g,%.9g],"accel_body":[%.9g,%.9g,%.9g]},'
    '"position":[%.12g,%.12g,%.12g],"attitude":[%.9g,%.9g,%.9g],'
    '"quaternion":[%.9g,%.9g,%.9g,%.9g],"velocity":[%.9g,%.9g,%.9g],"rng_1":%.9g,'
    '"battery":{"voltage":%.9g,"current":%.9g}}\n'
)


class AutopilotLost(UuvsimError):
    """An autopilot that ended, is silent, started again, or sends something else."""


class ServoPacket(NamedTuple):
    """Outputs of an autopilot at one frame."""

    rate: int  # Hz that the autopilot asks for
    frame: int  # count since its start
    widths: tuple[int, ...]  # µs, 16 or 32 channels


def read_servo_packet(data: bytes) -> ServoPacket:
    """Read a servo packet; raises InputInvalid for one of another length or magic.

    Example:

    >>> import struct
    >>> from uuvsim_cosim.bridge.autopilots.json_interface import read_servo_packet
    >>> packet = read_servo_packet(struct.pack("<HHI16H", 18458, 400, 7, *[1500] * 16))
    >>> packet.frame, packet.widths[:2]
    (7, (1500, 1500))
    """
    if len(data) < 8:
        raise InputInvalid("servo packet", f"{len(data)} bytes", "40 or 72 bytes")
    magic, rate, frame = _HEAD.unpack_from(data)
    channels = _CHANNELS.get(magic)
    if channels is None:
        raise InputInvalid("servo packet", f"magic {magic}", "18458 or 29569")
    if len(data) != 8 + 2 * channels:
        raise InputInvalid("servo packet", f"{len(data)} bytes", f"{8 + 2 * channels} bytes")
    return ServoPacket(rate, frame, _WHOLE[len(data)].unpack(data)[3:])


def state_line(
    timestamp: float, gyro: Sequence[float], acc: Sequence[float], position: Sequence[float],
    attitude: Sequence[float], q: Sequence[float], velocity: Sequence[float],
    distance: float, voltage: float, current: float,
) -> bytes:  # fmt: skip
    r"""Return the line that answers a servo packet.

    `timestamp` [s]; `gyro` [rad/s] and specific force `acc` [m/s2] in b (FRD); `position` [m],
    `velocity` [m/s] in n (NED); `attitude` phi, theta, psi [rad] and its quaternion `q`, from b to
    n, scalar first. Both are sent: versions of ArduPilot differ in the field that they read, and
    4.8-dev finds the range `distance` [m] at its place only if `attitude` is there. `voltage` [V]
    and `current` [A] are the battery's. The order of keys is that of ArduPilot's example, for its
    parser searches the text. Raises InputInvalid for a number that is not finite.

    Example:

    >>> from uuvsim_cosim.bridge.autopilots.json_interface import state_line
    >>> zero = [0.0] * 3
    >>> line = state_line(0.5, zero, zero, zero, zero, [1.0, 0, 0, 0], zero, 2.0, 16.0, 1.0)
    >>> line[1:19], line[-48:-1]
    (b'{"timestamp":0.500', b'"rng_1":2,"battery":{"voltage":16,"current":1}}')
    """
    numbers = (
        timestamp, *gyro, *acc, *position, *attitude, *q, *velocity, distance, voltage, current,
    )  # fmt: skip
    if not all(map(math.isfinite, numbers)):
        raise InputInvalid("state for the autopilot", f"{numbers}", "finite numbers")
    return (_LINE % numbers).encode("ascii")


@final
class JsonLink:
    """The physics side of the interface: receives servo packets and answers their sender.

    `counts` has the number of packets that were ignored, by reason, and of repeated answers.
    """

    def __init__(self, instance: int, timeout: float) -> None:
        """Bind the port of an `instance`; `timeout` [s] is the longest wait for a packet.

        Raises InputInvalid if another program has the port.
        """
        self.port = PORT + 10 * instance
        self.counts = {"invalid": 0, "stale": 0, "repeated": 0}
        self.last: ServoPacket | None = None
        self._timeout = timeout
        self._answer = b""
        self._sender: tuple[str, int] | None = None
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(("127.0.0.1", self.port))
        except OSError as error:
            self._socket.close()
            raise InputInvalid(
                f"UDP port {self.port} of autopilot instance {instance}",
                f"is used by another program ({error.strerror})",
                f"a free port, or another instance, as ardusub:?instance={instance + 1}",
            ) from None
        # One call of the kernel for each wait: with `settimeout` there would be two. The option is
        # a timeval in the machine's own format.
        self._socket.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVTIMEO, struct.pack("@ll", 0, round(1e6 * _SLICE))
        )
        self._waiting = select.poll()
        self._waiting.register(self._socket, select.POLLIN)

    def exchange(self, answer: bytes, alive: Callable[[], None]) -> ServoPacket:
        """Answer the last packet with a line of state, and return the next packet.

        The first exchange has an empty `answer`, for it only receives. `alive` is called while
        nothing arrives; it raises an error if the autopilot has ended. Raises AutopilotLost.
        """
        if answer:
            self._drain()
            self._send(answer)
        start, strays = time.monotonic(), 0
        while True:
            try:
                data, sender = self._socket.recvfrom(256)
            except BlockingIOError:
                alive()
                if time.monotonic() - start > self._timeout:
                    raise AutopilotLost(
                        self._where(),
                        f"no answer for {self._timeout:g} s",
                        "a servo packet within this time, or a longer ?timeout=",
                    ) from None
                continue
            packet = self._judged(data, sender)
            if packet is not None:
                self.last, self._sender = packet, sender
                return packet
            strays += 1
            if strays > _STRAY:
                raise AutopilotLost(
                    self._where(), f"{strays} packets in a row that are not the next one "
                    f"({self.counts})", "one program that sends servo packets",
                )  # fmt: skip

    def release(self, answers: Iterable[bytes]) -> None:
        """Answer further packets, which are dropped, until none arrives at once."""
        if self._sender is None:
            return
        for answer in answers:
            self._send(answer)
            if not self._waiting.poll(1e3 * _SLICE):
                return
            self._socket.recvfrom(256)

    def close(self) -> None:
        """Free the port."""
        self._socket.close()

    # ---- inside ---------------------------------------------------------------------------

    def _judged(self, data: bytes, sender: tuple[str, int]) -> ServoPacket | None:
        """Return a packet if it is the next one; None if it is ignored."""
        try:
            packet = read_servo_packet(data)
        except InputInvalid:
            self.counts["invalid"] += 1
            return None
        last = self.last
        if last is None or (packet.frame == last.frame + 1 and sender == self._sender):
            return packet
        if packet.frame == 0 and (last.frame > 0 or sender != self._sender):
            raise AutopilotLost(
                self._where(),
                "it started again (its frame count is 0)",
                "one start for each run; reset the simulation, so that both begin anew",
            )
        if sender != self._sender or packet.frame < last.frame:
            self.counts["stale"] += 1
            return None
        if packet.frame == last.frame:
            if self._answer and not self._follows():
                self.counts["repeated"] += 1
                self._send(self._answer)
            else:
                self.counts["stale"] += 1
            return None
        raise AutopilotLost(
            self._where(), f"frame {packet.frame} after {last.frame}",
            f"frame {last.frame + 1}, and no other program that answers the autopilot",
        )  # fmt: skip

    def _follows(self) -> bool:
        """Return whether another packet arrives at once, so that no answer was lost."""
        return bool(self._waiting.poll(1e3 * _REPEATED))

    def _drain(self) -> None:
        """Drop packets that were repeated while the simulation paused."""
        for _ in range(_STRAY):
            if not self._waiting.poll(0):
                return
            data, sender = self._socket.recvfrom(256)
            self._answer = b""  # nothing to repeat: this frame has no answer yet
            if self._judged(data, sender) is not None:
                raise AutopilotLost(
                    self._where(), "a servo packet before the answer to the last one",
                    "lockstep, and no other program that answers the autopilot",
                )  # fmt: skip

    def _send(self, answer: bytes) -> None:
        assert self._sender is not None  # the first exchange received a packet
        self._answer = answer
        self._socket.sendto(answer, self._sender)

    def _where(self) -> str:
        frame = "before its first packet" if self.last is None else f"frame {self.last.frame}"
        return f"autopilot at UDP port {self.port}, {frame}"
