"""Judgement of a model by a recording: fitted on one part, compared on the other.

On the judged part, predictions start at every second, with the recorded inputs. The model with
fitted parameters is compared with the same model with published ones, with persistence (the last
measured value), and with a linear model (`linear_model.py`). The measure is the RMS of the error at
1, 5, 10 and 60 s over the windows, with intervals by a block bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.assumptions import MEASURED
from uuvsim_cosim.studies.identification.identify import identify
from uuvsim_cosim.studies.identification.signals import ANGLES
from uuvsim_cosim.studies.water.bootstrap import Measured, compare, root_mean_square
from uuvsim_cosim.studies.water.linear_model import LinearModel, fit_linear_model
from uuvsim_cosim.studies.water.model_predictions import Predictor
from uuvsim_cosim.studies.water.recordings import Recording

__all__ = [
    "AHEAD", "OTHERS", "UNITS", "Course", "Judged", "Row", "Trace", "Unknown", "held", "judge",
    "judged_of",
]  # fmt: skip

Array = NDArray[np.float64]
AHEAD = (1.0, 5.0, 10.0, 60.0)  # s
OTHERS = ("persistence", "linear", "nominal")
UNITS = dict(zip(MEASURED, ["m"] * 3 + ["rad"] * 3 + ["m/s"] * 3 + ["rad/s"] * 3, strict=True))
UNITS["V"] = "m/s"  # speed through the water
_ANGLES = tuple(MEASURED[i] for i in ANGLES)
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
class Unknown:
    """A fitted parameter: published and fitted value, half of its 95 % interval or NaN."""

    name: str
    published: float
    value: float
    half_width: float
    unit: str
    at_bound: bool = False


@dataclass(frozen=True)
class Judged:
    """A recording with its rows, the fitted parameters, and stretches to draw."""

    recording: Recording
    unknowns: tuple[Unknown, ...]
    rows: tuple[Row, ...]
    traces: tuple[Trace, ...]


@dataclass(frozen=True)
class Course:
    """Judged part of a recording on a grid of `h` seconds: measurements, inputs and models.

    `truth` and `held` (n, K + 1) are measurements, NaN where there is none, and the last ones;
    `inputs` (n_u, K) are means over the steps. A model returns predictions (len(at), n) so many
    steps after points.
    """

    signals: tuple[str, ...]
    h: float
    runs: tuple[tuple[int, int], ...]
    truth: Array
    held: Array
    inputs: Array
    past: float
    models: Mapping[str, Callable[[NDArray[np.int64], int], Array]]


def judge(
    recording: Recording,
    fetched: Path | None = None,
    *,
    report: Callable[[str], None] = lambda text: None,
) -> Judged:
    """Fit a recording's model to one part, and compare its predictions on the other."""
    report(f"{recording.name}: fit of {', '.join(recording.parameters)}")
    if recording.is_glide:
        from uuvsim_cosim.studies.water.glides import judge_glides

        return judge_glides(recording, fetched)
    signals = recording.read(fetched)
    nominal = recording.nominal_system(signals)
    first, last = recording.fitted
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
            system, fit.hull, signals, step, span, past=recording.past, adapted=recording.adapted
        )
        for name, system in (("fitted", fitted), ("nominal", nominal))
    }
    grid = models["nominal"].grid
    before = Predictor(nominal, fit.hull, signals, step, (first, last)).grid
    elements = [MEASURED.index(n) for n in recording.signals]
    inputs = slice(0, len(grid.w) // 2)
    past = held(before.runs, step, _unwrapped(before, elements))
    linear = fit_linear_model(past, before.w[inputs], before.runs, step)
    truth = _unwrapped(grid, elements)

    def said(model: Predictor) -> Callable[[NDArray[np.int64], int], Array]:
        return lambda at, steps: model.predict(at, steps)[:, -1][:, elements]

    course = Course(
        recording.signals, step, grid.runs, truth, held(grid.runs, step, truth), grid.w[inputs],
        recording.past, {name: said(model) for name, model in models.items()},
    )  # fmt: skip
    unknowns = tuple(
        Unknown(n.name, n.start, n.value, n.half_width, n.unit, n.at_bound) for n in fit.numbers
    )
    return judged_of(recording, unknowns, course, [linear])


def judged_of(
    recording: Recording,
    unknowns: tuple[Unknown, ...],
    course: Course,
    linear: Sequence[LinearModel],
) -> Judged:
    """Compare the predictors of a course; raises InputInvalid if no stretch is long enough.

    `linear` is one model of all signals, or one for each.
    """
    rows: list[Row] = []
    traces: list[Trace] = []
    h = course.h
    for ahead in AHEAD:
        steps = round(ahead / h)
        at = _starts(course, steps)
        if not len(at):
            continue
        said = {name: predict(at, steps) for name, predict in course.models.items()}
        said["persistence"] = course.held[:, at].T
        said["linear"] = _linear(linear, course, at, steps)
        blocks = _blocks(course, at, ahead)
        for i, name in enumerate(course.signals):
            right = course.truth[i, at + steps]
            near = {k: _near(v[:, i], right, name) for k, v in said.items()}
            seen = np.isfinite(right) & _measured_before(course, i, at)
            if not seen.any():
                continue
            errors = {k: (v - right)[seen] for k, v in near.items()}
            rows.append(
                Row(
                    name, UNITS[name], ahead, int(seen.sum()), len(np.unique(blocks[seen])),
                    {k: root_mean_square(e, blocks[seen]) for k, e in errors.items()},
                    {k: compare(errors["fitted"], errors[k], blocks[seen]) for k in OTHERS},
                )
            )  # fmt: skip
            if ahead == _TRACE:
                traces.append(Trace(name, ahead, h * (at + steps).astype(np.float64), right, near))
    if not rows:
        first, last = recording.judged
        raise InputInvalid(
            f"{recording.name}: no stretch from {first:g} to {last:g} s is long enough",
            f"{course.past + AHEAD[0]:g} s with {', '.join(course.signals)}",
        )
    rows.sort(key=lambda r: (course.signals.index(r.signal), r.ahead))
    return Judged(recording, unknowns, tuple(rows), tuple(traces))


def _linear(
    models: Sequence[LinearModel], course: Course, at: NDArray[np.int64], steps: int
) -> Array:
    if len(models) == 1:
        return models[0].predict(course.held, course.inputs, at, steps)
    each = [m.predict(y[None], course.inputs, at, steps)
            for m, y in zip(models, course.held, strict=True)]  # fmt: skip
    return np.concatenate(each, axis=1)


def _measured_before(course: Course, signal: int, at: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return at which points a signal was measured over the second before."""
    good = np.isfinite(course.held[signal])
    lags = range(max(1, round(1.0 / course.h)) + 1)
    return np.asarray(np.logical_and.reduce([good[np.maximum(at - k, 0)] for k in lags]), bool)


def held(runs: tuple[tuple[int, int], ...], h: float, y: Array) -> Array:
    """Return the last measurement (n, K + 1) at each point, NaN if it is older than a second."""
    most = round(_HELD / h)
    out = np.full_like(y, np.nan)
    for a, b in runs:
        points = np.arange(a, b + 1)
        for i in range(len(y)):
            seen = np.where(np.isfinite(y[i, points]), points, -1)
            last = np.maximum.accumulate(seen)
            fresh = (last >= 0) & (points - last <= most)
            out[i, points[fresh]] = y[i, last[fresh]]
    return out


def _near(predicted: Array, truth: Array, name: str) -> Array:
    """Shift predicted angles by whole turns to the measured ones."""
    if name not in _ANGLES:
        return predicted
    turns = np.round((predicted - truth) / (2 * np.pi))
    return np.asarray(predicted - 2 * np.pi * np.nan_to_num(turns))


def _starts(course: Course, steps: int) -> NDArray[np.int64]:
    """Return points with measurements in the second before, a second apart, within runs."""
    h = course.h
    before, every = round(course.past / h), max(1, round(_EVERY / h))
    found = [np.arange(a + before, b - steps + 1, every) for a, b in course.runs]
    at = np.concatenate(found).astype(np.int64)
    # The first signal is measured at all times; others may be missing for long.
    return at[_measured_before(course, 0, at)]


def _blocks(course: Course, at: NDArray[np.int64], ahead: float) -> NDArray[np.int64]:
    """Number the blocks of windows: longer than the horizon, and within a run."""
    run = np.searchsorted([a for a, _ in course.runs], at, side="right") - 1
    start = np.array([a for a, _ in course.runs])[run]
    inside = ((at - start) * course.h // (ahead + _APART)).astype(np.int64)
    return np.asarray(run * 100_000 + inside, dtype=np.int64)
