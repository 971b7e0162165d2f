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
    "BACKWARDS",
    "COMMANDS",
    "SIZES",
    "Series",
    "VehicleLog",
    "check_firmware",
    "check_pauses",
    "damaged_times",
    "remark_on_times",
    "with_depth",
    "without_repetitions",
]

Array = NDArray[np.float64]
# Series of a log, and the number of their values; None: any.
SIZES: dict[str, int | None] = {
    "attitude": 3, "rates": 3, "position": 3, "velocity": 3, "dvl": 3, "depth": 1, "range": 1,
    "pwm": None, "u": None, "tau": 6, "voltage": 1, "armed": 1, "surfaced": 1, "bottomed": 1,
}  # fmt: skip
AHEAD = 3600.0  # s: a longer pause is no pause, but another clock
BACKWARDS = 0.5  # s that the time of a message may lie before that of an earlier one
_IN_A_ROW, _MOST_DAMAGED = 3, 0.01  # messages with a damaged time; share of all
_NEAR = 8  # messages on each side, by which it is decided which ones are damaged
_SHOWN = 3
COMMANDS = {"u", "pwm", "tau"}  # series, of which one is enough


@dataclass(frozen=True)
class Series:
    """Values (n, k) at rising times (n,) [s], and a remark on messages that were left out."""

    t: Array
    values: Array
    remark: str = ""

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


def without_repetitions(
    path: Path, name: str, t: Array, values: Array, backwards: float = BACKWARDS
) -> Series:
    """Return a series in the order of time, each time once.

    Messages with a damaged time are left out with a remark; a clock that jumps is refused.
    `backwards` [s] is how much earlier than the one before it an intact message may be.
    """
    if len(t) == 0:
        return Series(t, values.reshape(0, values.shape[-1]))
    damaged = damaged_times(path, name, t, backwards)
    intact, values = t[~damaged], np.asarray(values, dtype=float)[~damaged]
    rising, first = np.unique(np.round(intact, 4), return_index=True)
    return Series(rising, values[first], remark_on_times(name, t, damaged))


def damaged_times(
    path: Path, name: str, t: Array, backwards: float = BACKWARDS
) -> NDArray[np.bool_]:
    """Return which messages (n,), in the order of the log, have a time that cannot be theirs.

    The fewest messages count as damaged without which times rise, up to three in a row. So do up to
    three at either end that are an hour away from all others. If the times rise only without
    more messages, the clock was set, or the vehicle was started again: raises InputInvalid.
    """
    damaged = np.zeros(len(t), bool)
    few = max(_IN_A_ROW, _MOST_DAMAGED * len(t))
    back = np.flatnonzero(np.diff(t) < -backwards)
    for k in back.tolist() if len(back) <= few else ():
        window = np.arange(max(k - _NEAR, 0), min(k + _NEAR + 2, len(t)))
        window = window[~damaged[window]]
        damaged[np.setdiff1d(window, window[_rising(t[window], backwards)])] = True
    edges = np.flatnonzero(np.diff(np.concatenate([[False], damaged, [False]]).astype(int)))
    longest = int((edges[1::2] - edges[::2]).max(initial=0))
    intact = t[~damaged]
    falls = bool(np.any(intact < np.maximum.accumulate(intact) - backwards))
    if longest > _IN_A_ROW or damaged.sum() > few or falls:
        latest = np.maximum.accumulate(t)
        k = int(np.flatnonzero(t < latest - backwards)[0])
        raise InputInvalid(
            path,
            f"the clock of {name} jumps back from {latest[k - 1]:.3f} to {t[k]:.3f} s",
            "times that increase: one start of the vehicle in a log; split the log there",
        )
    for end in (slice(None, None, 1), slice(None, None, -1)):
        places = np.flatnonzero(~damaged)[end]
        far = np.flatnonzero(np.abs(np.diff(t[places[: _IN_A_ROW + 1]])) > AHEAD)
        if len(far) and len(places) > 2 * _IN_A_ROW:
            damaged[places[: int(far[-1]) + 1]] = True
    return damaged


def _rising(t: Array, backwards: float) -> list[int]:
    """Return the places of the longest sequence within t (n,) in which times rise."""
    best: list[list[int]] = []
    for j, here in enumerate(t.tolist()):
        before = [b for b in best if t[b[-1]] <= here + backwards]
        best.append([*max(before, key=len, default=[]), j])
    return max(best, key=lambda b: (len(b), -t[b[-1]]))  # of two ends, the earlier time


def remark_on_times(name: str, t: Array, damaged: NDArray[np.bool_]) -> str:
    """Return a remark on messages with damaged times: how many, and where the first ones are."""
    places = np.flatnonzero(damaged)
    if not len(places):
        return ""
    intact = np.flatnonzero(~damaged)
    shown = []
    for k in places[:_SHOWN].tolist():
        i = int(np.searchsorted(intact, k))
        after = f"after {t[intact[i - 1]]:.3f} s" if i else "at the begin"
        shown.append(f"{t[k]:.6g} s {after}")
    more = ", …" if len(places) > _SHOWN else ""
    count = "1 time" if len(places) == 1 else f"{len(places)} times"
    return f"{count} of {name} damaged, and left out with the values: {', '.join(shown)}{more}"


def check_pauses(path: Path, t: Array) -> None:
    """Refuse rising times (n,) with a clock that jumps ahead, as one that was set meanwhile."""
    pauses = np.diff(t)
    if len(pauses) and pauses.max() > AHEAD:
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
