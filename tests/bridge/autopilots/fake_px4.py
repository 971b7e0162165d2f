"""A PX4 end of the simulator protocol, from MAVLink's definitions and PX4's pages alone.

It shares no code with the package, not even pymavlink, so that a mistake in one is seen by the
other. It runs as ``bin/px4 -i INSTANCE -d ETC`` like PX4: it connects by TCP, is silent and unarmed
at first, answers each HIL_SENSOR once it has begun, and ends with status 3 at the first message
that breaks the protocol. ``FAKE=fault:N`` selects a fault N answers after it was told to arm; see
`spoiled`. ``FAKE=replay:FILE`` sends recorded controls (float32, 8 for each answer) from then on.
"""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import struct
import sys
import time
from typing import Any, NoReturn

SILENT = int(os.environ.get("SILENT", "20"))  # messages of sensors before the first output
HEARTBEAT, MANUAL, COMMAND, SET_MODE_COMMAND, ARM_COMMAND = 0, 69, 76, 176, 400
POSITION, ACTUATORS, SENSOR, GPS, RANGE, ODOMETRY = 84, 93, 107, 113, 132, 331
# Of common.xml: name, CRC_EXTRA, layout with extensions, names of the fields.
MESSAGES: dict[int, tuple[str, int, str, str]] = {
    HEARTBEAT: ("HEARTBEAT", 50, "<IBBBBB", "custom_mode type autopilot base_mode status version"),
    MANUAL: ("MANUAL_CONTROL", 243, "<hhhhHBHBhhhhhhhh", "x y z r buttons target"),
    COMMAND: ("COMMAND_LONG", 152, "<7fHBBB", "p1 p2 p3 p4 p5 p6 p7 command target component "
              "confirmation"),
    POSITION: ("SET_POSITION_TARGET_LOCAL_NED", 143, "<I11fHBBB", "time_boot_ms x y z vx vy vz "
               "ax ay az yaw yaw_rate type_mask target component frame"),
    SENSOR: ("HIL_SENSOR", 108, "<Q13fIB", "time_usec xacc yacc zacc xgyro ygyro zgyro xmag ymag "
             "zmag abs_pressure diff_pressure pressure_alt temperature fields_updated id"),
    GPS: ("HIL_GPS", 124, "<QiiiHHHhhhHBBBH", "time_usec lat lon alt eph epv vel vn ve vd cog "
          "fix_type satellites id yaw"),
    RANGE: ("DISTANCE_SENSOR", 85, "<IHHHBBBBff4fB", "time_boot_ms min max current type id "
            "orientation covariance"),
    ODOMETRY: ("ODOMETRY", 91, "<Q3f4f3f3f21f21fBBBBb", "time_usec x y z q0 q1 q2 q3 vx vy vz "
               "p q r " + " ".join(f"c{i}" for i in range(21)) + " "
               + " ".join(f"d{i}" for i in range(21)) + " frame child reset estimator quality"),
}  # fmt: skip


def _remainder(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ 0x8408 if byte & 1 else byte >> 1
    return byte


_REMAINDERS = [_remainder(i) for i in range(256)]


def crc(data: bytes) -> int:
    """Return CRC-16/MCRF4XX, MAVLink's checksum."""
    found = 0xFFFF
    for byte in data:
        found = (found >> 8) ^ _REMAINDERS[(found ^ byte) & 0xFF]
    return found


def broken(text: str) -> NoReturn:
    """End with the reason that the protocol is broken."""
    print(text, flush=True)
    sys.exit(3)


class Reader:
    """Frames of MAVLink 2 from bytes; the first error ends the program."""

    def __init__(self) -> None:
        self._data = b""
        self._next: int | None = None

    def read(self, data: bytes) -> list[tuple[int, dict[str, Any]]]:
        """Return the messages that are complete, as number and fields."""
        self._data += data
        found = []
        while len(self._data) >= 12:
            if self._data[0] != 0xFD:
                broken(f"magic {self._data[0]:#x}, expected 0xfd")
            length, flags, sequence = self._data[1], self._data[2], self._data[4]
            number = int.from_bytes(self._data[7:10], "little")
            if flags & 1:
                broken("a signed message")
            if len(self._data) < 12 + length:
                break
            frame, self._data = self._data[: 12 + length], self._data[12 + length :]
            if number not in MESSAGES:
                broken(f"message {number}")
            name, extra, layout, fields = MESSAGES[number]
            if crc(frame[1:-2] + bytes([extra])) != int.from_bytes(frame[-2:], "little"):
                broken(f"{name}: wrong CRC")
            if self._next not in (None, sequence):
                broken(f"{name}: sequence {sequence}, expected {self._next}")
            self._next = (sequence + 1) % 256
            size = struct.calcsize(layout)
            if length > size:
                broken(f"{name}: {length} bytes, expected at most {size}")
            values = struct.unpack(layout, frame[10:-2].ljust(size, b"\0"))
            found.append((number, dict(zip(fields.split(), values, strict=False))))
        return found


class Writer:
    """Frames of MAVLink 2 from payloads; zeros at the end of a payload are left out."""

    def __init__(self, system: int) -> None:
        self._system = system
        self._sequence = 0

    def frame(self, number: int, extra: int, payload: bytes) -> bytes:
        """Return a frame."""
        payload = payload.rstrip(b"\0") or b"\0"
        head = bytes([len(payload), 0, 0, self._sequence, self._system, 1])
        self._sequence = (self._sequence + 1) % 256
        body = head + number.to_bytes(3, "little") + payload
        return b"\xfd" + body + crc(body + bytes([extra])).to_bytes(2, "little")

    def heartbeat(self, mode: int, armed: bool) -> bytes:
        """Return HEARTBEAT of a submarine with PX4."""
        return self.frame(
            HEARTBEAT, 50, struct.pack("<IBBBBB", mode << 16, 12, 12, 1 | 128 * armed, 4, 3)
        )

    def actuators(self, time_us: int, controls: list[float], armed: bool, flags: int) -> bytes:
        """Return HIL_ACTUATOR_CONTROLS."""
        return self.frame(
            ACTUATORS, 47, struct.pack("<QQ16fB", time_us, flags, *controls, 1 | 128 * armed)
        )


class Vehicle:
    """The little of an autopilot that a dive needs: arm, mode, and depth from the pressure."""

    def __init__(self) -> None:
        self.armed = self.told = False
        self.mode = 1
        self.wanted = 0.0
        self.depth = 0.0
        self._rate = 0.0
        self._is_first = True

    def command(self, number: int, m: dict[str, Any], system: int) -> None:
        """Take a message of the API link."""
        if number in (MANUAL, COMMAND, POSITION) and m["target"] != system:
            broken(f"{MESSAGES[number][0]}: target {m['target']}, expected {system}")
        if number == COMMAND and m["command"] == ARM_COMMAND:
            self.armed, self.told = m["p1"] == 1.0, True
        elif number == COMMAND and m["command"] == SET_MODE_COMMAND:
            if m["p1"] != 1.0:
                broken("DO_SET_MODE: no custom mode")
            self.mode = int(m["p2"])
        elif number == POSITION:
            self.wanted = m["z"]

    def sense(self, m: dict[str, Any], period: float) -> None:
        """Take all readings of HIL_SENSOR, which come each `period` [s]."""
        depth = (100.0 * m["abs_pressure"] - 101325.0) / (1025.0 * 9.80665)
        if self._is_first:
            self._is_first, self.depth = False, depth
        self._rate += 0.2 * ((depth - self.depth) / period - self._rate)
        self.depth = depth

    def controls(self) -> list[float]:
        """Return the controls of 16 channels; the vertical axes of the airframe are -z +z +z -z."""
        if not self.armed or self.mode != 6:
            return [0.0] * 16
        down = max(-1.0, min(1.0, 0.6 * (self.wanted - self.depth) - 0.6 * self._rate))
        return [0.0] * 4 + [-down, down, down, -down] + [0.25, -0.5, 0.75] + [0.0] * 5


def check_sensor(m: dict[str, Any], last: int) -> None:
    """End unless a HIL_SENSOR is one of this protocol, in its units."""
    if m["id"] != 0:
        broken(f"HIL_SENSOR: id {m['id']}, expected 0, the clock")
    if m["time_usec"] <= last:
        broken(f"HIL_SENSOR: time {m['time_usec']} after {last}")
    if m["fields_updated"] not in (0b111111, 0b1101111111111):
        broken(f"HIL_SENSOR: fields_updated {m['fields_updated']:#b}")
    force = math.hypot(m["xacc"], m["yacc"], m["zacc"])
    field = math.hypot(m["xmag"], m["ymag"], m["zmag"])
    if not 1.0 < force < 50.0:
        broken(f"HIL_SENSOR: specific force of {force} m/s2")
    if not 0.2 < field < 0.7:
        broken(f"HIL_SENSOR: magnetic field of {field} G")
    if not 1000.0 < m["abs_pressure"] < 100_000.0:
        broken(f"HIL_SENSOR: pressure of {m['abs_pressure']} hPa")


def main() -> None:
    """Run as PX4 does."""
    arguments = sys.argv[1:]
    if len(arguments) != 4 or arguments[0] != "-i" or arguments[2] != "-d":
        broken(f"arguments {arguments}")
    if sorted(os.listdir()) != ["output.txt"]:
        broken(f"the folder has {os.listdir()}")
    if not os.path.isfile(os.path.join(arguments[3], "init.d-posix", "rcS")):
        broken(f"no rcS in {arguments[3]}")
    instance = int(arguments[1])
    fault, _, after = os.environ.get("FAKE", "").partition(":")
    print(f"INFO  [px4] instance: {instance}", flush=True)
    if fault == "ends":
        print("INFO  [px4] PX4 server already running for instance 0", flush=True)
        sys.exit(1)
    if fault == "never_connects":
        signal.pause()
    simulate(instance, fault, after)


def connected(instance: int) -> socket.socket:
    """Connect to the simulator, which may not listen yet."""
    while True:
        try:
            link = socket.create_connection(("127.0.0.1", 4560 + instance))
        except ConnectionRefusedError:
            time.sleep(0.0005)
            continue
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return link


def simulate(instance: int, fault: str, after: str) -> None:
    """Exchange messages with the simulator until it closes the connection."""
    api = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    api.bind(("127.0.0.1", 14580 + instance))
    api.setblocking(False)
    place = ("127.0.0.1", 14540 + instance)
    link = connected(instance)
    reader, commands = Reader(), Reader()
    writer, announcer = Writer(instance + 1), Writer(instance + 1)
    replayed = []
    if fault == "replay":
        with open(after, "rb") as file:
            data = file.read()
        replayed = [struct.unpack_from("<8f", data, 32 * k) for k in range(len(data) // 32)]
    number_of_fault = int(after) if after.isdecimal() else -1
    vehicle, sensed, answered, last, last_slow, said = Vehicle(), 0, 0, 0, 0, (-1, False)
    link.sendall(writer.heartbeat(0, False))
    with open("received.txt", "w", buffering=1) as log:
        while data := link.recv(65_536):
            for number, m in reader.read(data):
                log.write(
                    json.dumps({"name": MESSAGES[number][0], "told": vehicle.told, **m}) + "\n"
                )
                if number != SENSOR and sensed == 0:
                    broken(f"{MESSAGES[number][0]} before the first HIL_SENSOR")
                if number != SENSOR:
                    continue
                check_sensor(m, last)
                sensed, last = sensed + 1, m["time_usec"]
                if m["fields_updated"] & 1 << 9:
                    vehicle.sense(m, max(1e-3, (last - last_slow) / 1e6))
                    last_slow = last
                while True:
                    try:
                        given = commands.read(api.recv(65_536))
                    except BlockingIOError:
                        break
                    for kind, one in given:
                        log.write(
                            json.dumps({"name": MESSAGES[kind][0], "api": 1, "at": last, **one})
                            + "\n"
                        )
                        vehicle.command(kind, one, instance + 1)
                if said != (vehicle.mode, vehicle.armed):
                    said = (vehicle.mode, vehicle.armed)
                    api.sendto(announcer.heartbeat(*said), place)
                if sensed <= SILENT or fault == "never_answers":
                    continue
                controls, armed = vehicle.controls(), vehicle.armed
                if replayed and vehicle.told:
                    row = replayed[min(answered, len(replayed) - 1)]
                    controls, armed = [*row, *[0.0] * 8], True
                answer = writer.actuators(last, controls, armed, 1)
                if answered == number_of_fault:
                    answer = spoiled(fault, link, writer, instance, last, controls, answer)
                answered += vehicle.told
                link.sendall(answer)


def spoiled(
    fault: str, link: socket.socket, writer: Writer, instance: int, now: int,
    controls: list[float], answer: bytes,
) -> bytes:  # fmt: skip
    """Commit a fault; return what is sent instead of the answer."""
    if fault == "silent":
        signal.pause()
    if fault == "dies":
        print("ERROR [px4] segmentation fault", flush=True)
        os.abort()
    if fault in ("disconnects", "reconnects"):
        again = (
            socket.create_connection(("127.0.0.1", 4560 + instance)) if fault[0] == "r" else None
        )
        link.close()
        signal.pause()
        del again
    if fault == "nan":
        return writer.actuators(now, [0.0, 0.0, math.nan, *[0.0] * 13], True, 1)
    if fault == "no_lockstep":
        return writer.actuators(now, controls, False, 0)
    if fault == "back":
        return writer.actuators(now - 1_000_000, controls, False, 1)
    if fault == "ahead":
        return writer.actuators(now + 2500, controls, False, 1)
    if fault == "flood":
        while True:
            link.sendall(writer.heartbeat(1, False) * 100)
    if fault == "wrong":  # a valid message of another kind, and nothing else
        link.sendall(writer.heartbeat(1, False))
        signal.pause()
    if fault == "garbage":
        damaged = bytearray(answer)
        damaged[20] ^= 0xFF
        return b"nonsense" + bytes(damaged) + answer
    if fault == "twice":
        return answer + answer
    if fault == "pieces":
        link.sendall(answer[:7])
        return answer[7:]
    raise AssertionError(fault)


if __name__ == "__main__":
    main()
