"""A declaration run by CasADi's own evaluation: the reference that other backends are compared to.

Inputs that are functions of time are evaluated inside the Runge-Kutta stages. At the end of a
step they are evaluated just before it, so that a jump on the grid belongs to the next step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from math import ceil, nextafter

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import ComponentFailed, ParameterInvalid
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.model import Kind, Model
from uuvsim_cosim.models.declaration.philox import normals

__all__ = ["Draws", "Trajectory", "simulate"]

Array = NDArray[np.float64]
Input = ArrayLike | Callable[[float], ArrayLike]
Draws = Callable[[Array, int, int, int], Array]


@dataclass(frozen=True)
class Trajectory:
    """Result of a simulation: times [s], and each output and state, (n,) or (n, size)."""

    t: Array
    values: Mapping[str, Array]

    def __getitem__(self, name: str) -> Array:
        """Return the values of an output or a state."""
        return self.values[name]


def simulate(
    model: Model,
    *,
    until: float | None = None,
    at: Sequence[float] | None = None,
    h: float = 1e-3,
    tau: Input | None = None,
    inputs: Mapping[str, Input] | None = None,
    parameters: Mapping[str, ArrayLike] | None = None,
    draws: Draws = normals,
) -> Trajectory:
    """Integrate a `model` by RK4 in steps of at most `h` [s], from 0 to `until` [s], in CasADi.

    The result has outputs and states by name, (n,) or (n, size), and times ``t`` (n,): each
    multiple of `h`, or the times `at` [s] if they are given instead of `until`. `inputs` by name
    (and `tau`, short for the input ``tau``) are constants or functions of time [s]; an input that
    is not named keeps its start value. `parameters` are values by name. ``draws(seed, clock,
    sample, size)`` returns the normal draws of a clock, by default those of every other backend.
    Angles phi and psi of ``eta`` are in [-pi, pi], theta in [-pi/2, pi/2]: compare them modulo 2
    pi.

    Raises ParameterInvalid for a value that does not fit, ComponentFailed if a value is not finite.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> hull = uuv.declare("sphere")
    >>> pushed = uuv.simulate(hull, until=2.0, h=0.01, tau=[10.0, 0, 0, 0, 0, 0])  # 10 N forward
    >>> pushed.t.shape, pushed["eta"].shape
    ((201,), (201, 6))
    >>> f"{pushed['nu'][-1, 0]:.2f} m/s"
    '0.34 m/s'
    """
    if (until is None) == (at is None) or not h > 0:
        raise ParameterInvalid(
            "simulate", f"until = {until}, at = {at}, h = {h}", "until or at, and h > 0"
        )
    step = Fraction(repr(float(h)))
    if until is not None:
        end = Fraction(repr(float(until)))
        times = [k * step for k in range(ceil(end / step))] + [end]
    else:
        times = [Fraction(repr(float(t))) for t in at or ()]
        if not times or any(b <= a for a, b in pairwise(times)):
            raise ParameterInvalid("simulate", f"at = {at}", "rising times")
    given = dict(inputs or {}) | ({"tau": tau} if tau is not None else {})
    run = _Run(model, times[0], given, parameters or {}, draws)
    rows = [run.row()]
    for t in times[1:]:
        run.advance(t, step)
        rows.append(run.row())
    found, values, at_column = np.array(rows), {}, 0
    for v in [*model.of_kind("output"), *model.of_kind("state"), *model.of_kind("discrete")]:
        part = found[:, at_column : at_column + v.size]
        values[v.name] = part if v.shape else part[:, 0]
        at_column += v.size
    return Trajectory(np.array([float(t) for t in times]), values)


class _Run:
    """The live state of one simulation; time is an exact fraction."""

    def __init__(
        self,
        model: Model,
        t: Fraction,
        given: Mapping[str, Input],
        parameters: Mapping[str, ArrayLike],
        draws: Draws,
    ) -> None:
        self.f = Evaluation(model)
        self.model = model
        self.t = t
        self.draws = draws
        self.functions = {name: v for name, v in given.items() if callable(v)}
        first = {name: v(float(t)) if callable(v) else v for name, v in given.items()}
        self.u = self.f.values_of("input", first)
        self.place = _places(model, "input")
        self.p = self.f.values_of("parameter", parameters)
        self.d = _flat(self.f.derived(self.p))
        start = _flat(self.f.initial(self.p, self.d))
        n_x = sum(v.size for v in model.of_kind("state"))
        self.x, self.z = start[:n_x], start[n_x:]
        self.k = [ceil(t / clock.period) for clock in model.clocks]

    def inputs(self, t: float) -> Array:
        """Return all inputs at t."""
        if not self.functions:
            return self.u
        u = self.u.copy()
        for name, function in self.functions.items():
            u[self.place[name]] = np.asarray(function(t), dtype=float).ravel()
        return u

    def advance(self, end: Fraction, h: Fraction) -> None:
        """Go to `end`, through every tick that lies before it."""
        while True:
            due = [(k * c.period, c.index) for k, c in zip(self.k, self.model.clocks, strict=True)]
            at, index = min(due, default=(end, 0))
            if at >= end:
                break
            self._integrate(at, h)
            clock, w = self.model.clocks[index], np.zeros(0)
            if size := sum(draw.numel() for draw in clock.draws):
                seed = self.p[_places(self.model, "parameter")["seed"]]
                w = self.draws(seed, clock.index, self.k[index], size)
            t = float(self.t)
            self.z = _flat(self.f.updates[index](t, self.inputs(t), *self._rest(), w))
            self.k[index] += 1
        self._integrate(end, h)

    def row(self) -> Array:
        """Return outputs, states and discrete states now, in one row."""
        y = _flat(self.f.outputs(float(self.t), self.inputs(float(self.t)), *self._rest()))
        row = np.concatenate([y, self.x, self.z])
        if not np.all(np.isfinite(row)):
            raise ComponentFailed(self.model.name, float(self.t), "a value is not finite")
        return row

    def _rest(self) -> tuple[Array, ...]:
        return self.p, self.d, self.x, self.z

    def _integrate(self, end: Fraction, h: Fraction) -> None:
        length = end - self.t
        n = ceil(length / h)
        if self.x.size:
            for i in range(n):
                t, t_e = float(self.t + length * i / n), float(self.t + length * (i + 1) / n)
                u = [self.inputs(s) for s in (t, 0.5 * (t + t_e), nextafter(t_e, t))]
                self.x = _flat(self.f.rk4(t, t_e - t, *u, *self._rest()))
        self.t = end


def _flat(value: object) -> Array:
    return np.asarray(value, dtype=float).ravel()


def _places(model: Model, kind: Kind) -> dict[str, slice]:
    places, at = {}, 0
    for v in model.of_kind(kind):
        places[v.name] = slice(at, at + v.size)
        at += v.size
    return places
