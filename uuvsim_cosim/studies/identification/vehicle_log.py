"""Content of an autopilot's log, without its format: time series, parameters and firmware.

`.BIN` and `.tlog` are read into this form, and `ardusub.py` makes signals of it. All values are in
SI units, angles in rad, positions and velocities in NED or in the vehicle's axes (FRD).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["Series", "VehicleLog", "check_firmware", "without_repetitions"]

Array = NDArray[np.float64]
_BACKWARDS = 0.5  # s that the time of a message may lie before that of an earlier one


@dataclass(frozen=True)
class Series:
    """Values (n, k) at rising times (n,) [s]."""

    t: Array
    values: Array

    def at(self, times: Array, start: Array | float = np.nan) -> Array:
        """Return the values (len(times), k) held from each time on, `start` before the first."""
        i = np.searchsorted(self.t, times, side="right") - 1
        held: Array = self.values[np.maximum(i, 0)].astype(float)
        held[i < 0] = start
        return held


@dataclass(frozen=True)
class VehicleLog:
    """Series by name, the autopilot's parameters, and remarks on how the log was read.

    `series` has any of: `pwm` [us] of outputs 1, 2, …; `attitude` (roll, pitch, yaw); `rates`
    (p, q, r); `position` (N, E, D) and `velocity` (N, E, D) of the estimator, NaN where it had
    none; `depth`; `dvl` (u, v, w); `range` to the bottom; `voltage`; `armed`, `surfaced` and
    `bottomed` (0 or 1, from the time at which they change).
    """

    path: Path
    series: Mapping[str, Series]
    parameters: Mapping[str, float]
    firmware: str = ""
    remarks: Sequence[str] = field(default_factory=tuple)


def without_repetitions(path: Path, name: str, t: Array, values: Array) -> Series:
    """Return a series in the order of time, each time once; refuse a clock that jumps back."""
    if len(t) == 0:
        return Series(t, values.reshape(0, values.shape[-1]))
    latest = np.maximum.accumulate(t)
    back = np.flatnonzero(t < latest - _BACKWARDS)
    if len(back):
        k = int(back[0])
        raise InputInvalid(
            path,
            f"the clock of {name} jumps back from {latest[k - 1]:.3f} to {t[k]:.3f} s",
            "times that increase: one start of the autopilot in a log; split the log there",
        )
    t, first = np.unique(np.round(t, 4), return_index=True)
    return Series(t, np.asarray(values, dtype=float)[first])


def check_firmware(path: Path, firmware: str, parameters: Mapping[str, float]) -> None:
    """Refuse the log of another kind of vehicle than a submarine."""
    if firmware and not firmware.startswith("ArduSub"):
        raise InputInvalid(path, f"a log of {firmware}", "a log of ArduSub")
    if not firmware and "FRAME_CONFIG" not in parameters and "FRAME_CLASS" in parameters:
        raise InputInvalid(
            path, "has FRAME_CLASS, a parameter of ArduCopter or Rover, and no FRAME_CONFIG",
            "a log of ArduSub",
        )  # fmt: skip
