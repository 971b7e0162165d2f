"""Judgement of the glide on a recording: fitted on the first half, predicted on the second.

Two coefficients are fitted, C_D_0 and nabla, to the rate of depth of the first half. The second
half is predicted from pitch, volume and density alone. Its errors are those of the rate of depth,
and of the speed through the water against the Doppler log, which no fit has seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.glider.flight import (
    GliderFlight,
    depth_rate,
    read_flight,
    second_pressure,
)
from uuvsim_cosim.studies.glider.glide import (
    Glide,
    Motion,
    dynamic_glide,
    fit_glide,
    glide_of,
    steady_glide,
)

__all__ = ["MEANS", "Judgement", "judge_glide", "shared_error", "start_of"]

Array = NDArray[np.float64]
MEANS = (1, 5, 11, 21)  # samples over which the measured rate of depth is averaged


@dataclass(frozen=True)
class Judgement:
    """Fitted glide, its motion over the whole flight, and its RMS errors in the second half."""

    glide: Glide
    motion: Motion
    samples: int  # of the rate of depth, in the second half
    depth_rate: Mapping[int, float]  # m/s, by the number of samples of the mean
    depth_rate_first: Mapping[int, float]  # the same in the first half, which was fitted
    speed_samples: int
    speed: float  # m/s, against the Doppler log, at the samples above
    speed_all: float  # m/s, at each sample of the Doppler log in the second half, turns included
    speed_median: float  # m/s, median of the size of that error


def start_of(flight: GliderFlight, vehicle: str = "slocum") -> Glide:
    """Return the published coefficients, ballasted to be neutral in the flight's first half."""
    glide = glide_of(vehicle)
    return replace(glide, nabla=glide.m / float(np.mean(flight.density[flight.first_half])))


def judge_glide(
    flight: GliderFlight | None = None, start: Glide | None = None, *, steady: bool = False
) -> Judgement:
    """Fit C_D_0 and nabla on the first half of a flight, and judge the second half."""
    flight = flight or read_flight()
    gliding, first = flight.gliding(), flight.first_half
    glide = fit_glide(flight, gliding & first, start or start_of(flight), steady=steady)
    motion = (steady_glide if steady else dynamic_glide)(glide, flight)
    rates = {n: motion.depth_rate - depth_rate(flight, n) for n in MEANS}
    rows = gliding & ~first
    speed = motion.speed - flight.speed
    return Judgement(
        glide=glide,
        motion=motion,
        samples=int(np.count_nonzero(rows)),
        depth_rate={n: _rms(error[rows]) for n, error in rates.items()},
        depth_rate_first={n: _rms(error[gliding & first]) for n, error in rates.items()},
        speed_samples=int(np.count_nonzero(np.isfinite(speed[rows]))),
        speed=_rms(speed[rows]),
        speed_all=_rms(speed[~first]),
        speed_median=float(np.nanmedian(np.abs(speed[rows]))),
    )


def shared_error(flight: GliderFlight, motion: Motion) -> tuple[float, float, float]:
    """Return RMS errors [m/s] of the rate of depth in the second half, by two pressure sensors.

    The rates are differences between the samples of the flight computer's sensor, 4.3 s apart. The
    first is that of the CTD, the second of the flight computer's sensor. The third is the square
    root of their covariance: the part that both see. The noise of a sensor is not in it.
    """
    t, pressure = second_pressure()
    known = np.isfinite(motion.depth_rate)
    scale = flight.depth[-1] / flight.pressure[-1]
    middle, step = 0.5 * (t[1:] + t[:-1]), np.diff(t)
    nearest = np.clip(np.searchsorted(flight.t, middle), 0, len(flight.t) - 1)
    kept = (flight.gliding() & ~flight.first_half & known)[nearest] & (step < 6.0)
    modelled = np.interp(middle, flight.t[known], motion.depth_rate[known])[kept]
    ctd = np.diff(np.interp(t, flight.t, flight.depth))[kept] / step[kept] - modelled
    other = scale * np.diff(pressure)[kept] / step[kept] - modelled
    return _rms(ctd), _rms(other), float(np.sqrt(max(0.0, np.mean(ctd * other))))


def _rms(error: Array) -> float:
    return float(np.sqrt(np.nanmean(error * error)))
