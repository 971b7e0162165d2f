"""Small logs of PX4 (.ulg), written here by struct."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from math import cos, pi, sin
from pathlib import Path
from typing import Any

__all__ = ["HEAVY_ROTORS", "MOTORS", "Ulog", "ulog"]

MOTORS = (0.5, -0.25, 0.1, -0.1, 0.2, 0.3, -0.3, -0.2)
_CODES = {"uint64_t": "Q", "float": "f", "uint8_t": "B", "bool": "?", "int8_t": "b"}
_AXES = ((1, -1, 0), (1, 1, 0), (1, 1, 0), (1, -1, 0), (0, 0, -1), (0, 0, 1), (0, 0, 1), (0, 0, -1))
_PLACES = ((0.14, 0.1), (0.14, -0.1), (-0.14, 0.1), (-0.14, -0.1),
           (0.12, 0.22), (0.12, -0.22), (-0.12, 0.22), (-0.12, -0.22))  # fmt: skip
HEAVY_ROTORS: dict[str, float] = {"MAV_TYPE": 12, "CA_ROTOR_COUNT": 8}
for _i, (_axis, _place) in enumerate(zip(_AXES, _PLACES, strict=True)):
    for _k, _v in zip(("AX", "AY", "AZ", "PX", "PY"), (*_axis, *_place), strict=True):
        HEAVY_ROTORS[f"CA_ROTOR{_i}_{_k}"] = _v


class Ulog:
    """A ULog: formats and parameters, then subscriptions, then data."""

    def __init__(self, parameters: Mapping[str, float]) -> None:
        self.data = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1_000_000)
        self.put("B", bytes(40))
        self.formats: dict[str, tuple[int, str]] = {}
        self.subscriptions = b""
        for name, value in parameters.items():
            is_whole = name in ("MAV_TYPE", "CA_ROTOR_COUNT") or "FUNC" in name
            key = f"{'int32_t' if is_whole else 'float'} {name}".encode()
            number = struct.pack("<i" if is_whole else "<f", int(value) if is_whole else value)
            self.put("P", bytes([len(key)]) + key + number)

    def put(self, kind: str, body: bytes) -> None:
        self.data += struct.pack("<H", len(body)) + kind.encode() + body

    def describe(self, name: str, fields: Sequence[str]) -> None:
        layout = "<Q"
        text = "uint64_t timestamp;"
        for field in fields:
            type_, _, label = field.partition(" ")
            base, _, size = type_.partition("[")
            layout += _CODES[base] * int(size.rstrip("]") or 1)
            text += f"{type_} {label};"
        self.put("F", f"{name}:{text}".encode())
        number = len(self.formats)
        self.formats[name] = (number, layout)
        body = struct.pack("<BH", 0, number) + name.encode()
        self.subscriptions += struct.pack("<H", len(body)) + b"A" + body

    def message(self, name: str, us: int, *values: Any) -> None:
        number, layout = self.formats[name]
        self.put("D", struct.pack("<H", number) + struct.pack(layout, us, *values))


def ulog(
    path: Path,
    parameters: Mapping[str, float] = HEAVY_ROTORS,
    *,
    motors: Sequence[float] | None = MOTORS,
    outputs: Sequence[float] | None = None,
    armed: bool = True,
    valid: bool = True,
    times: Sequence[int] = range(5_000_000, 11_000_000, 100_000),
    depth: float = 5.0,
) -> Path:
    """Write six seconds at 10 Hz: heading east at 1 m/s, 5 m deep, rolled by 0.1 rad."""
    log = Ulog(parameters)
    log.describe("vehicle_attitude", ["float[4] q"])
    log.describe("vehicle_angular_velocity", ["float[3] xyz"])
    log.describe("vehicle_local_position", [
        "float x", "float y", "float z", "float vx", "float vy", "float vz",
        "bool xy_valid", "bool z_valid", "bool v_xy_valid", "bool v_z_valid",
    ])  # fmt: skip
    log.describe("vehicle_visual_odometry", ["float[3] velocity", "uint8_t velocity_frame"])
    log.describe("distance_sensor", [
        "float min_distance", "float max_distance", "float current_distance", "uint8_t orientation",
    ])  # fmt: skip
    log.describe("battery_status", ["float voltage_v"])
    log.describe("actuator_armed", ["bool armed"])
    log.describe("actuator_motors", ["float[12] control"])
    log.describe("actuator_outputs", ["float[16] output"])
    log.data += log.subscriptions
    c, s, h = cos(0.05), sin(0.05), cos(pi / 4)  # roll 0.1 rad, then yaw by a quarter turn
    for us in times:
        if motors is not None:
            log.message("actuator_motors", us, *motors, *[float("nan")] * (12 - len(motors)))
        if outputs is not None:
            log.message("actuator_outputs", us, *outputs, *[0.0] * (16 - len(outputs)))
        log.message("vehicle_attitude", us + 10_000, h * c, h * s, h * s, h * c)
        log.message("vehicle_angular_velocity", us + 20_000, 0.01, 0.02, 0.03)
        log.message("vehicle_local_position", us + 30_000, 0.0, (us - times[0]) * 1e-6, depth,
                    0.0, 1.0, 0.0, valid, True, valid, True)  # fmt: skip
        log.message("vehicle_visual_odometry", us + 40_000, 0.9, 0.1, 0.0, 3)
        log.message("vehicle_visual_odometry", us + 50_000, 7.0, 7.0, 7.0, 1)
        log.message("distance_sensor", us + 60_000, 0.3, 50.0, 4.0, 25)
        log.message("distance_sensor", us + 70_000, 0.3, 50.0, 1.0, 0)
        log.message("battery_status", us, 15.8)
        log.message("actuator_armed", us, armed)
    path.write_bytes(log.data)
    return path
