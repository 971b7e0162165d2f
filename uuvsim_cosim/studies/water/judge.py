"""Judgement of a model by a recording: fitted on one part, compared on the other.

On the judged part, predictions start at every second, with the recorded inputs. The model with
fitted parameters is compared with the same model with published ones, with persistence (the last
measured value), and with a linear model (`linear_model.py`). The measure is the RMS of the error at
1, 5, 10 and 60 s over the windows, with intervals by a block bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.studies.identification.identify import Identified, identify
from uuvsim_cosim.studies.identification.signals import ANGLES, MEASURED, Grid
from uuvsim_cosim.studies.water.bootstrap import Measured, compare, root_mean_square
from uuvsim_cosim.studies.water.linear_model import fit_linear_model
from uuvsim_cosim.studies.water.model_predictions import Predictor
from uuvsim_cosim.studies.water.recordings import Recording

__all__ = ["AHEAD", "OTHERS", "UNITS", "Judged", "Row", "Trace", "judge"]

Array = NDArray[np.float64]
AHEAD = (1.0, 5.0, 10.0, 60.0)  # s
OTHERS = ("persistence", "linear", "nominal")
UNITS = dict(zip(MEASURED, ["m"] * 3 + ["rad"] * 3 + ["m/s"] * 3 + ["rad/s"] * 3, strict=True))
_EVERY = 1.0  # s between starts of windows
_APART = 10.0  # s, longer than the horizon, that a block of windows lasts
_HELD = 1.0  # s that a measurement stands for later points
_TRACE = 10.0  # s ahead of the predictions that are drawn


@dataclass(frozen=True)
class Row:
    """Errors of one signal so many seconds ahead: RMS of each predictor, and ratios to others."""

    signal: str
    unit: str
    ahead: float
    windows: int
    blocks: int
    errors: Mapping[str, Measured]  # fitted, persistence, linear, nominal
    ratios: Mapping[str, Measured]  # of the fitted model's error to each other's

    def verdict(self, other: str) -> str:
        """Return better, worse or cannot be decided."""
        return self.ratios[other].verdict


@dataclass(frozen=True)
class Trace:
    """A stretch of a judged signal, and what each predictor said of each point 10 s before."""

    signal: str
    before: float  # s
    t: Array
    measured: Array
    predicted: Mapping[str, Array]


@dataclass(frozen=True)
class Judged:
    """A recording with its rows, the fit, and stretches to draw."""

    recording: Recording
    fit: Identified
    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]
    linear_step: float  # s, sample time of the linear model


def judge(
    recording: Recording,
    fetched: Path | None = None,
    *,
    signals: Signals | None = None,
    report: Callable[[str], None] = lambda text: None,
) -> Judged:
    """Fit a recording's model to one part, and compare its predictions on the other."""
    signals = recording.read(fetched) if signals is None else signals
    nominal = recording.nominal_system(signals)
    first, last = recording.fitted
    report(f"{recording.name}: fit of {len(recording.parameters)} parameters")
    fit = identify(
        signals, nominal, recording.parameters, step=recording.step, first=first, last=last,
        proposals=False,
    )  # fmt: skip
    fitted = nominal
    for number in fit.numbers:
        for place in number.places:
            fitted = fitted.set(place, number.value)
    report(f"{recording.name}: predictions")
    step, span = recording.step, recording.judged
    models = {
        name: Predictor(
            system, fit.hull, signals, step, span,
            past=recording.past, adapted=recording.adapted,
        )
        for name, system in (("fitted", fitted), ("nominal", nominal))
    }  # fmt: skip
    grid = models["nominal"].grid
    before = Predictor(nominal, fit.hull, signals, step, (first, last)).grid
    elements = [MEASURED.index(n) for n in recording.signals]
    inputs = slice(0, len(grid.w) // 2)
    past = _held(before, _unwrapped(before, elements))
    linear = fit_linear_model(past, before.w[inputs], before.runs, step)
    truth = _unwrapped(grid, elements)
    held = _held(grid, truth)
    rows: list[Row] = []
    traces: list[Trace] = []
    for ahead in AHEAD:
        steps = round(ahead / step)
        at = _starts(grid, held, steps, recording.past)
        if not len(at):
            continue
        said = {
            name: model.predict(at, steps)[:, -1][:, elements] for name, model in models.items()
        }
        said["persistence"] = held[:, at].T
        said["linear"] = linear.predict(held, grid.w[inputs], at, steps)
        blocks = _blocks(grid, at, ahead)
        for i, name in enumerate(recording.signals):
            right = truth[i, at + steps]
            seen = np.isfinite(right)
            if not seen.any():
                continue
            near = {k: _near(v[:, i], right, elements[i]) for k, v in said.items()}
            errors = {k: (v - right)[seen] for k, v in near.items()}
            rows.append(
                Row(
                    name, UNITS[name], ahead, int(seen.sum()), len(np.unique(blocks[seen])),
                    {k: root_mean_square(e, blocks[seen]) for k, e in errors.items()},
                    {k: compare(errors["fitted"], errors[k], blocks[seen]) for k in OTHERS},
                )
            )  # fmt: skip
            if ahead == _TRACE:
                traces.append(Trace(name, ahead, grid.t[at + steps], right, near))
    if not rows:
        raise InputInvalid(
            f"{recording.name}: no stretch from {span[0]:g} to {span[1]:g} s is long enough",
            f"{recording.past + AHEAD[0]:g} s with {', '.join(recording.signals)}",
        )
    rows.sort(key=lambda r: (recording.signals.index(r.signal), r.ahead))
    return Judged(recording, fit, tuple(rows), tuple(traces), linear.every * step)


def _unwrapped(grid: Grid, elements: list[int]) -> Array:
    """Return judged measurements (n, K + 1); angles without jumps within a run."""
    y = grid.y[elements].copy()
    for i, e in enumerate(elements):
        if e in ANGLES:
            good = np.isfinite(y[i])
            y[i, good] = np.unwrap(y[i, good])
    return y


def _held(grid: Grid, y: Array) -> Array:
    """Return the last measurement (n, K + 1) at each point, NaN if it is older than a second."""
    most = round(_HELD / grid.h)
    out = np.full_like(y, np.nan)
    for a, b in grid.runs:
        points = np.arange(a, b + 1)
        for i in range(len(y)):
            seen = np.where(np.isfinite(y[i, points]), points, -1)
            last = np.maximum.accumulate(seen)
            fresh = (last >= 0) & (points - last <= most)
            out[i, points[fresh]] = y[i, last[fresh]]
    return out


def _near(predicted: Array, truth: Array, e: int) -> Array:
    """Shift predicted angles by whole turns to the measured ones."""
    if e not in ANGLES:
        return predicted
    turns = np.round((predicted - truth) / (2 * np.pi))
    return np.asarray(predicted - 2 * np.pi * np.nan_to_num(turns))


def _starts(grid: Grid, held: Array, steps: int, past: float) -> NDArray[np.int64]:
    """Return points with measurements in the second before, a second apart, within runs."""
    before, every = round(past / grid.h), max(1, round(_EVERY / grid.h))
    lag = max(1, round(1.0 / grid.h))
    found = [np.arange(a + before, b - steps + 1, every) for a, b in grid.runs]
    at = np.concatenate(found).astype(np.int64)
    good = np.isfinite(held).all(axis=0)
    fresh = np.logical_and.reduce([good[np.maximum(at - k, 0)] for k in range(lag + 1)])
    return at[fresh]


def _blocks(grid: Grid, at: NDArray[np.int64], ahead: float) -> NDArray[np.int64]:
    """Number the blocks of windows: longer than the horizon, and within a run."""
    run = np.searchsorted([a for a, _ in grid.runs], at, side="right") - 1
    start = np.array([a for a, _ in grid.runs])[run]
    inside = ((at - start) * grid.h // (ahead + _APART)).astype(np.int64)
    return np.asarray(run * 100_000 + inside, dtype=np.int64)
