"""Refinements of the glide, each judged on the first half of a recorded flight.

A refinement changes the flight that the model reads, a coefficient, or what is fitted. It is judged
by the first half alone: each quarter of the flight is predicted from the other one. The error in
the second half is listed beside it; no choice depends on it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.glider.flight import GliderFlight, depth_rate, read_flight
from uuvsim_cosim.studies.glider.glide import Glide, dynamic_glide, fit_glide, steady_glide
from uuvsim_cosim.studies.glider.judged import start_of

__all__ = ["REFINEMENTS", "Judged", "Refinement", "judge_refinements"]

SAMPLES = 11  # of the mean of the measured rate of depth
FITTED = ("C_D_0", "nabla")


@dataclass(frozen=True)
class Refinement:
    """One change of the model."""

    name: str
    names: tuple[str, ...] = FITTED  # of the fitted coefficients
    changed: Mapping[str, float] = field(default_factory=dict)
    flight: Callable[[GliderFlight], GliderFlight] = lambda flight: flight
    steady: bool = False


@dataclass(frozen=True)
class Judged:
    """RMS errors of the rate of depth [m/s], and the coefficients fitted to the first half."""

    refinement: Refinement
    first: float  # each quarter from the other
    second: float
    glide: Glide


def _later(seconds: float, name: str) -> Callable[[GliderFlight], GliderFlight]:
    def shifted(flight: GliderFlight) -> GliderFlight:
        moved = np.interp(flight.t - seconds, flight.t, getattr(flight, name))
        return replace(flight, **{name: moved})

    return shifted


def _expands(per_kelvin: float) -> Callable[[GliderFlight], GliderFlight]:
    def expanded(flight: GliderFlight) -> GliderFlight:
        warmer = flight.temperature - float(np.mean(flight.temperature[flight.first_half]))
        return replace(flight, volume=flight.volume + 0.0696 * per_kelvin * warmer)

    return expanded


REFINEMENTS = (
    Refinement("equilibrium of the forces, without inertia", steady=True),
    Refinement("with inertia and added mass"),
    Refinement("without added mass", changed={"M_A_11": 0.0, "M_A_33": 0.0}),
    Refinement("without compressibility of the hull", changed={"epsilon": 0.0}),
    Refinement("compressibility fitted", names=(*FITTED, "epsilon")),
    Refinement("slope of lift fitted", names=(*FITTED, "C_L_alpha")),
    Refinement("hull expands by 7e-5 per K with the water", flight=_expands(7e-5)),
    Refinement("density of the water 1 s earlier (lag of the CTD)", flight=_later(-1.0, "density")),
    Refinement("pitch 6 s later", flight=_later(6.0, "pitch")),
)


def judge_refinements(
    flight: GliderFlight | None = None, start: Glide | None = None
) -> Iterator[Judged]:
    """Yield each refinement with its errors."""
    flight = flight or read_flight()
    start = start or start_of(flight)
    measured = depth_rate(flight, SAMPLES)
    gliding, first = flight.gliding(), flight.first_half
    early = flight.t < 0.75 * flight.t[0] + 0.25 * flight.t[-1]
    for r in REFINEMENTS:
        seen, begun = r.flight(flight), replace(start, **r.changed)

        def error(
            fitted: NDArray[np.bool_], judged: NDArray[np.bool_], r: Refinement = r,
            seen: GliderFlight = seen, begun: Glide = begun,
        ) -> tuple[NDArray[np.float64], Glide]:  # fmt: skip
            glide = fit_glide(seen, fitted, begun, r.names, steady=r.steady, samples=SAMPLES)
            motion = (steady_glide if r.steady else dynamic_glide)(glide, seen)
            return (motion.depth_rate - measured)[judged], glide

        second, glide = error(gliding & first, gliding & ~first)
        quarters = [
            error(gliding & early, gliding & first & ~early)[0],
            error(gliding & first & ~early, gliding & early)[0],
        ]
        yield Judged(r, _rms(np.concatenate(quarters)), _rms(second), glide)


def _rms(error: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error * error)))
