"""Judgement of a glide by a recorded flight, as that of a hull by a dive (judge.py).

Pitch, volume of the buoyancy engine and density of the water are the inputs. The motion of the
model runs freely from the begin of each dive. A prediction is the last measured value plus the
modelled change. The linear model has one output for each signal, because the speed is not measured
at all times.
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
from uuvsim_cosim.studies.water.judge import Course, Judged, Unknown, held, judged_of
from uuvsim_cosim.studies.water.linear_model import fit_linear_model
from uuvsim_cosim.studies.water.recordings import Recording

__all__ = ["judge_glides"]

Array = NDArray[np.float64]
_UNITS = {"C_D_0": "1", "nabla": "m3", "C_L_alpha": "1/rad", "epsilon": "1/Pa"}
_UNDER = 2.0  # m of depth from which a flight is judged
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
    glide = fit_glide(flight, inside & gliding, published, recording.parameters)
    before = _course(recording, flight, recording.fitted, {})
    linear = [
        fit_linear_model(y[None], before.inputs, before.runs, recording.step) for y in before.held
    ]
    course = _course(recording, flight, recording.judged, {"fitted": glide, "nominal": published})
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
    recording: Recording, flight: GliderFlight, span: tuple[float, float], glides: dict[str, Glide]
) -> Course:
    h = recording.step
    end = min(span[1], float(flight.t[-1]))
    t = np.arange(max(span[0], float(flight.t[0])), end, h)

    def on_grid(values: Array) -> Array:
        good = np.isfinite(values)
        return np.asarray(np.interp(t, flight.t[good], values[good]), dtype=np.float64)

    nearest = np.clip(np.searchsorted(flight.t, t), 1, len(flight.t) - 1)
    nearest -= t - flight.t[nearest - 1] < flight.t[nearest] - t
    fresh = np.abs(flight.t[nearest] - t) < h
    measured = {"D": flight.depth, "V": flight.speed}
    truth = np.stack([np.where(fresh, measured[n][nearest], np.nan) for n in recording.signals])
    gaps = np.interp(t, flight.t[1:], np.diff(flight.t)) > 10.0
    under = (on_grid(flight.depth) > _UNDER) & ~gaps
    edges = np.flatnonzero(np.diff(np.concatenate([[0], under.astype(int), [0]])))
    runs = tuple(
        (int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 60
    )
    columns = (np.sin(flight.pitch), flight.volume * 1e3, flight.density - 1000.0)
    inputs = np.stack([on_grid(c) for c in columns])
    inputs = 0.5 * (inputs[:, 1:] + inputs[:, :-1])
    models = {}
    last = held(runs, h, truth)
    for name, glide in glides.items():
        motion = dynamic_glide(glide, flight)
        rate, speed = on_grid(motion.depth_rate), on_grid(motion.speed)
        change = np.concatenate([[0.0], np.cumsum(0.5 * h * (rate[1:] + rate[:-1]))])
        models[name] = _model(recording.signals, last, change, speed)
    return Course(recording.signals, h, runs, truth, last, inputs, recording.past, models)


def _model(
    signals: tuple[str, ...], last: Array, change: Array, speed: Array
) -> Callable[[NDArray[np.int64], int], Array]:
    def predict(at: NDArray[np.int64], steps: int) -> Array:
        modelled = {"D": change, "V": speed}
        columns = [
            y[at] + modelled[n][at + steps] - modelled[n][at]
            for n, y in zip(signals, last, strict=True)
        ]
        return np.stack(columns, axis=1)

    return predict
