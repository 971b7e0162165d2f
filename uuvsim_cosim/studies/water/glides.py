"""Judgement of a glide by a recorded flight, as that of a hull by a dive (judge.py).

Pitch, volume of the buoyancy engine and density of the water are the inputs. The motion of the
model runs freely from the begin of each dive. A prediction of the speed is the last measured value
plus the modelled change. A prediction of the depth starts from the measured depth and rate of depth
(depth_filter.py). The linear model has one output for each signal, because the speed is not
measured at all times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.glider.flight import GliderFlight, read_flight
from uuvsim_cosim.studies.glider.glide import Glide, dynamic_glide, fit_glide, glide_of
from uuvsim_cosim.studies.water.depth_filter import DepthFilter, filter_with_least_errors
from uuvsim_cosim.studies.water.judge import AHEAD, Course, Judged, Unknown, held, judged_of
from uuvsim_cosim.studies.water.linear_model import fit_linear_model
from uuvsim_cosim.studies.water.recordings import Recording

__all__ = ["judge_glides"]

Array = NDArray[np.float64]
_UNITS = {"C_D_0": "1", "nabla": "m3", "C_L_alpha": "1/rad", "epsilon": "1/Pa"}
_UNDER = 2.0  # m of depth from which a flight is judged
_JITTER = 0.1  # of a step, by which a sample may lie beside its point
_LEAST = 0.2  # rad of pitch, above which the glider glides


def judge_glides(recording: Recording, fetched: Path | None) -> Judged:
    """Fit coefficients of a glide to the first part of a flight, and judge the second."""
    flight = _flight(recording, fetched)
    first, last = recording.fitted
    inside = (flight.t >= first) & (flight.t < last)
    published = glide_of(recording.system.removeprefix("glide:"))
    published = replace(published, **{k: float(v) for k, v in recording.values.items()})
    published = replace(published, nabla=published.m / float(np.mean(flight.density[inside])))
    gliding = (flight.depth > 3 * _UNDER) & (np.abs(flight.pitch) > _LEAST)
    glide = fit_glide(
        flight, inside & gliding, published, recording.parameters, surface=recording.surface
    )
    before, constants = _course(recording, flight, recording.fitted, {"fitted": glide})
    linear = [
        fit_linear_model(y[None], before.inputs, before.runs, recording.step) for y in before.held
    ]
    both = {"fitted": glide, "nominal": published}
    course, _ = _course(recording, flight, recording.judged, both, constants)
    unknowns = tuple(
        Unknown(n, getattr(published, n), getattr(glide, n), float("nan"), _UNITS[n])
        for n in recording.parameters
    )
    return judged_of(recording, unknowns, course, linear)


def _flight(recording: Recording, fetched: Path | None) -> GliderFlight:
    file = recording.folder / "flight.csv"
    if not file.is_file():
        raise InputInvalid(file, "no such file", "the samples of a flight")
    return read_flight(file)


def _course(
    recording: Recording,
    flight: GliderFlight,
    span: tuple[float, float],
    glides: dict[str, Glide],
    constants: DepthFilter | None = None,
) -> tuple[Course, DepthFilter]:
    """Lay a part of a flight on a grid; without `constants`, they are found for the first glide."""
    h = recording.step
    end = min(span[1], float(flight.t[-1]))
    # The points lie at the samples: the CTD's clock ticks once in each step, with a constant phase.
    turn = 2 * np.pi / h
    phase = float(np.angle(np.mean(np.exp(1j * turn * flight.t)))) / turn
    begin = max(span[0], float(flight.t[0]))
    t = np.arange(np.ceil((begin - phase) / h) * h + phase, end, h)

    def on_grid(values: Array) -> Array:
        good = np.isfinite(values)
        return np.asarray(np.interp(t, flight.t[good], values[good]), dtype=np.float64)

    nearest = np.clip(np.searchsorted(flight.t, t), 1, len(flight.t) - 1)
    nearest -= t - flight.t[nearest - 1] < flight.t[nearest] - t
    fresh = np.abs(flight.t[nearest] - t) < _JITTER * h
    measured = {"D": flight.depth, "V": flight.speed}
    truth = np.stack([np.where(fresh, measured[n][nearest], np.nan) for n in recording.signals])
    gaps = np.interp(t, flight.t[1:], np.diff(flight.t)) > 10.0
    under = (on_grid(flight.depth) > max(_UNDER, recording.surface)) & ~gaps
    edges = np.flatnonzero(np.diff(np.concatenate([[0], under.astype(int), [0]])))
    runs = tuple(
        (int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 60
    )
    columns = (np.sin(flight.pitch), flight.volume * 1e3, flight.density - 1000.0)
    inputs = np.stack([on_grid(c) for c in columns])
    inputs = 0.5 * (inputs[:, 1:] + inputs[:, :-1])
    models = {}
    last = held(runs, h, truth)
    measured_depth = truth[recording.signals.index("D")]
    for name, glide in glides.items():
        motion = dynamic_glide(glide, flight, surface=recording.surface)
        rate, speed = on_grid(motion.depth_rate), on_grid(motion.speed)
        change = np.concatenate([[0.0], np.cumsum(0.5 * h * (rate[1:] + rate[:-1]))])
        difference = measured_depth - change
        constants = constants or filter_with_least_errors(difference, h, runs, AHEAD)
        models[name] = _model(
            recording.signals, last, change, speed, h, constants,
            constants.estimates(difference, h, runs),
        )  # fmt: skip
    assert constants is not None
    course = Course(recording.signals, h, runs, truth, last, inputs, recording.past, models)
    return course, constants


def _model(
    signals: tuple[str, ...],
    last: Array,
    change: Array,
    speed: Array,
    h: float,
    constants: DepthFilter,
    estimates: tuple[Array, Array],
) -> Callable[[NDArray[np.int64], int], Array]:
    z, b = estimates

    def predict(at: NDArray[np.int64], steps: int) -> Array:
        of = {
            "D": change[at + steps] + constants.ahead(z[at], b[at], steps * h),
            "V": last[-1][at] + speed[at + steps] - speed[at],
        }
        return np.stack([of[n] for n in signals], axis=1)

    return predict
