"""Correlation of the modelled yaw moment with the measured rate of turn, with and without signs.

Give logs of ArduSub of a six-thruster BlueROV2. The moment is that of u |u| at the thrusters'
places, without a lag and after first-order lags; only parts that `uuvsim identify` fits count.
Without a file, a small log is written.
"""

from __future__ import annotations

import argparse
import tempfile
from math import cos, sin
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.bridge.mavlink.dataflash import DataFlashLog
from uuvsim_cosim.models.control.vehicle_design import thrusters_of
from uuvsim_cosim.studies.identification.exclusions import kept_spans
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.readers.ardusub import motors_of
from uuvsim_cosim.studies.identification.readers.dataflash_log import read_dataflash

LAGS = (0.0, 0.3, 0.6, 1.0)  # s


def lagged(t: NDArray[np.float64], values: NDArray[np.float64], lag: float) -> NDArray[np.float64]:
    """Return held values after a first-order lag."""
    if lag == 0.0:
        return values
    out = np.zeros_like(values)
    for k in range(1, len(t)):
        share = 1.0 - np.exp(-(t[k] - t[k - 1]) / lag)
        out[k] = out[k - 1] + share * (values[k - 1] - out[k - 1])
    return out


def measure(path: Path) -> None:
    signals = read_log(path)
    log = read_dataflash(path)
    motors = motors_of(log)
    geometry = thrusters_of(motors.vehicle or "bluerov2").geometry
    arms = np.cross(np.asarray(geometry.r), np.asarray(geometry.e))[:, 2]
    t = signals.time
    rate = signals["nu"][:, 5]
    seen = np.zeros(len(t), bool)
    for first, last in kept_spans(list(signals.metadata["excluded"]), 0.0, float(t[-1])):
        seen |= (t >= first) & (t < last)
    seen &= np.isfinite(rate)
    pwm = log.series["pwm"]
    widths = pwm.at(t + signals.metadata["start"])[:, motors.channels]
    for name, u in (("u = (w - 1500) / 400", (widths - 1500.0) / 400.0), ("signs", signals["u"])):
        moment = (u * np.abs(u)) @ arms
        found = [np.corrcoef(lagged(t, moment, lag)[seen], rate[seen])[0, 1] for lag in LAGS]
        told = ", ".join(f"{r:.2f} (lag {lag:g} s)" for r, lag in zip(found, LAGS, strict=True))
        print(f"{path.name}, {seen.sum()} samples, {name}: {told}")


def written(path: Path) -> Path:
    """Write a log of a vehicle that turns left and right."""
    settings = {"FRAME_CONFIG": 1.0}
    for i, d in enumerate((-1, -1, 1, -1, -1, 1), 1):
        settings |= {f"SERVO{i}_FUNCTION": 32.0 + i, f"MOT_{i}_DIRECTION": float(d)}
    log = DataFlashLog(settings)
    for k in range(600):
        at, turn = k * 100_000, 200 * cos(0.05 * k)
        widths = [round(1500 + s * turn) for s in (1, -1, -1, 1)]
        log.write("RCOU", at, *widths, 1500, 1500, *[0] * 8)
        log.write("ATT", at, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 3)
        log.write("XKF1", at, 0, *[0.0] * 6, 0.0, 0.0, 5.0)
        log.write("IMU", at, 0, 0.0, 0.0, -sin(0.05 * k), 0.0, 0.0, -9.8)
    path.write_bytes(log.data)
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("logs", nargs="*", type=Path)
    with tempfile.TemporaryDirectory() as folder:
        for path in parser.parse_args().logs or [written(Path(folder) / "short.BIN")]:
            measure(path)


if __name__ == "__main__":
    main()
