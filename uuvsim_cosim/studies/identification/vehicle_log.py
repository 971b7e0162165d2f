"""Content of a vehicle's log, without its format: time series, parameters and firmware.

Each reader of a format returns this form, and `log_signals.py` makes signals of it. All values are
in SI units, angles in rad, positions and velocities in NED or in the vehicle's axes (FRD).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "COMMANDS",
    "SIZES",
    "Series",
    "VehicleLog",
    "check_firmware",
    "with_depth",
    "without_repetitions",
]

Array = NDArray[np.float64]
# Series of a log, and the number of their values; None: any.
SIZES: dict[str, int | None] = {
    "attitude": 3, "rates": 3, "position": 3, "velocity": 3, "dvl": 3, "depth": 1, "range": 1,
    "pwm": None, "u": None, "tau": 6, "voltage": 1, "armed": 1, "surfaced": 1, "bottomed": 1,
}  # fmt: skip
_AHEAD = 3600.0  # s: a longer pause is no pause, but another clock
_BACKWARDS = 0.5  # s that the time of a message may lie before that of an earlier one
COMMANDS = {"u", "pwm", "tau"}  # series, of which one is enough


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

    `series` has any of: `pwm` [us] of outputs 1, 2, …; `u`, commands of the vehicle's thrusters (-1
    to 1); `tau`, the force in the vehicle's axes; `attitude` (roll, pitch, yaw); `rates` (p, q, r);
    `position` (N, E, D) and `velocity` (N, E, D) of the estimator, NaN where it had none; `depth`;
    `dvl` (u, v, w); `range` to the bottom; `voltage`; `armed`, `surfaced` and `bottomed` (0 or 1,
    from the time at which they change). `vehicle` is the vehicle of this package whose thrusters
    have the order of `u`, and `frame` is the autopilot's name of its frame.
    """

    path: Path
    series: Mapping[str, Series]
    parameters: Mapping[str, float]
    firmware: str = ""
    remarks: Sequence[str] = field(default_factory=tuple)
    vehicle: str | None = None
    frame: str | None = None


def without_repetitions(path: Path, name: str, t: Array, values: Array) -> Series:
    """Return a series in the order of time, each time once; refuse a clock that jumps back."""
    if len(t) == 0:
        return Series(t, values.reshape(0, values.shape[-1]))
    check_order(path, name, t)
    t, first = np.unique(np.round(t, 4), return_index=True)
    return Series(t, np.asarray(values, dtype=float)[first])


def check_order(path: Path, name: str, t: Array) -> None:
    """Refuse times (n,) of a clock that jumps back."""
    latest = np.maximum.accumulate(t)
    back = np.flatnonzero(t < latest - _BACKWARDS)
    if len(back):
        k = int(back[0])
        raise InputInvalid(
            path,
            f"the clock of {name} jumps back from {latest[k - 1]:.3f} to {t[k]:.3f} s",
            "times that increase: one start of the vehicle in a log; split the log there",
        )


def check_pauses(path: Path, t: Array) -> None:
    """Refuse rising times (n,) with a clock that jumps ahead, as one that was set meanwhile."""
    pauses = np.diff(t)
    if len(pauses) and pauses.max() > _AHEAD:
        k = int(np.argmax(pauses))
        raise InputInvalid(
            path,
            f"the clock jumps ahead by {pauses[k]:.4g} s at {t[k]:.3f} s",
            "one clock for the whole log; split the log there",
        )


def with_depth(series: Mapping[str, Series]) -> dict[str, Series]:
    """Return series in which D of the estimator is the depth, if the depth was not recorded.

    Only for estimators whose origin is at the surface, as those of autopilots.
    """
    found = dict(series)
    if "depth" not in found and "position" in found:
        down = found["position"].values[:, 2:3]
        seen = np.isfinite(down[:, 0])
        if seen.any():
            found["depth"] = Series(found["position"].t[seen], down[seen])
    return found


def check_firmware(path: Path, firmware: str, parameters: Mapping[str, float]) -> None:
    """Refuse the log of another kind of vehicle than a submarine."""
    if firmware and not firmware.startswith("ArduSub"):
        raise InputInvalid(path, f"a log of {firmware}", "a log of ArduSub")
    if not firmware and "FRAME_CONFIG" not in parameters and "FRAME_CLASS" in parameters:
        raise InputInvalid(
            path, "has FRAME_CLASS, a parameter of ArduCopter or Rover, and no FRAME_CONFIG",
            "a log of ArduSub",
        )  # fmt: skip
