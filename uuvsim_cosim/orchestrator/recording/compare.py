"""Comparison of two recordings: the first signal that differs, when, and by how much."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

__all__ = ["Comparison", "Difference", "compare_signals"]


@dataclass(frozen=True)
class Difference:
    """One element of a signal that differs: its first difference, and the largest.

    `a` and `b` are the two values at `time` [s]; `size` is |a - b| in `unit`, NaN for values that
    are no numbers and infinity if only one is finite. `largest` is the largest `size`, at
    `largest_time`.
    """

    signal: str
    unit: str
    time: float
    a: object
    b: object
    size: float
    largest: float
    largest_time: float


@dataclass(frozen=True)
class Comparison:
    """Differences between recordings A and B, the earliest first.

    `mismatches` are differences that are not values: signals that one of them lacks, other sizes,
    units, times or lengths. Values are compared at the first `rows` times, which are the same.
    """

    differences: tuple[Difference, ...]
    mismatches: tuple[str, ...]
    rows: int
    signals: int

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not self.differences and not self.mismatches


def compare_signals(
    a: Signals | Path | str, b: Signals | Path | str, tolerance: float = 0.0
) -> Comparison:
    """Compare two recordings; numbers are equal if |a - b| <= `tolerance`, in the signal's unit.

    With tolerance 0 they have to be equal. NaN equals NaN, and an infinity one of the same sign.
    Texts, Booleans and bytes have to be equal. Integers are compared exactly. Raises InputInvalid
    for a tolerance that is negative or not finite, RecordingError if `a` or `b` is no recording.
    """
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise InputInvalid(f"tolerance {tolerance:g}", "a finite number, 0 or more")
    first = a if isinstance(a, Signals) else read_signals(a)
    second = b if isinstance(b, Signals) else read_signals(b)
    rows = min(len(first.time), len(second.time))  # leading rows with the same times
    mismatches: list[str] = []
    differing = np.flatnonzero(first.time[:rows] != second.time[:rows])
    if differing.size:
        rows = int(differing[0])
        times = f"{first.time[rows]:.9g} s in A, at {second.time[rows]:.9g} s in B"
        mismatches = [f"time: row {rows + 1} is at {times}"]
    elif len(first.time) != len(second.time):
        mismatches = [f"time: {_end(first.time)} in A, {_end(second.time)} in B"]
    for one, other, name in ((first, second, "A"), (second, first, "B")):
        only = [signal for signal in one if signal not in other]
        mismatches += [f"{signal}: only in {name}" for signal in only]
    both = [signal for signal in first if signal in second]
    found: list[Difference] = []
    for signal in both:
        shapes = first[signal].shape[1:], second[signal].shape[1:]
        units = first.units.get(signal, ""), second.units.get(signal, "")
        if shapes[0] != shapes[1]:
            sizes = ["x".join(map(str, shape)) or "1" for shape in shapes]
            mismatches.append(f"{signal}: size {sizes[0]} in A, {sizes[1]} in B")
        elif units[0] != units[1]:
            mismatches.append(f"{signal}: in {units[0] or '1'} in A, in {units[1] or '1'} in B")
        else:
            x, y = first[signal][:rows], second[signal][:rows]
            names, own = [signal], [units[0]]
            if x.ndim == 2:
                indices = first.elements.get(signal) or range(1, x.shape[1] + 1)
                names = [f"{signal}[{index}]" for index in indices]
                own = list(first.element_units.get(signal) or units[:1] * x.shape[1])
            columns = zip(names, own, np.atleast_2d(x.T), np.atleast_2d(y.T), strict=True)
            for name, unit, p, q in columns:
                found += _of_element(name, unit, first.time, p, q, tolerance)
    found.sort(key=lambda d: d.time)
    return Comparison(tuple(found), tuple(mismatches), rows, len(both))


def _end(time: np.ndarray) -> str:
    return f"{len(time)} rows up to {time[-1]:.9g} s" if len(time) else "no rows"


def _of_element(
    name: str, unit: str, time: np.ndarray, x: np.ndarray, y: np.ndarray, tolerance: float
) -> list[Difference]:
    if x.dtype.kind in "fiu" and y.dtype.kind in "fiu":
        if x.dtype.kind in "iu" and y.dtype.kind in "iu":  # exact beyond 2^53 and 2^63
            exact = x.astype(object) - y.astype(object)
            size = np.array([float(abs(d)) for d in exact], dtype=np.float64)
        else:  # 0 for two NaN or equal infinities, infinity where one is not finite
            p, q = x.astype(np.float64), y.astype(np.float64)
            same = (p == q) | (np.isnan(p) & np.isnan(q))
            with np.errstate(invalid="ignore", over="ignore"):
                size = np.abs(p - q)
            size = np.where(same, 0.0, np.where(np.isnan(size), math.inf, size))
        differs = size > tolerance
    else:
        size = np.full(len(x), math.nan)
        differs = np.array([p != q for p, q in zip(x, y, strict=True)], dtype=bool)
    rows = np.flatnonzero(differs)
    if not rows.size:
        return []
    begin = int(rows[0])
    most = int(rows[np.argmax(size[rows])])
    a, b = (v.item() if hasattr(v, "item") else v for v in (x[begin], y[begin]))
    return [
        Difference(
            name, unit, float(time[begin]), a, b,
            float(size[begin]), float(size[most]), float(time[most]),
        )
    ]  # fmt: skip
