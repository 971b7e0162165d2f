"""A declaration as  dx/dt = f(x, u), y = h(x, u)  at a point, in coordinates that are all free.

Where a clock updates the states, f is their value after a tick, from which y follows.

A hull's quaternion has four numbers for three turns: its attitude is (phi, theta, psi) here,

    dTheta/dt = T(Theta) omega,   q = q(Theta)

so that no state is bound to others and a linear model is controllable where the hull is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import element_names, split_element_name
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.kinematics import T_zyx, euler_of_q, q_of_euler
from uuvsim_cosim.models.declaration.model import Kind, Model
from uuvsim_cosim.models.declaration.near_names import did_you_mean

__all__ = ["Coordinates", "OperatingPoint", "is_hull", "place_of"]

Array = NDArray[np.float64]
_POSE = ("eta[1]", "eta[2]", "eta[3]", "eta[4]", "eta[5]", "eta[6]")
_NU = ("nu[1]", "nu[2]", "nu[3]", "nu[4]", "nu[5]", "nu[6]")


@dataclass(frozen=True)
class OperatingPoint:
    """States, inputs and outputs of a model by element, SI, and its parameters.

    `residual` is the largest rate that should be 0 and is not (SI units), of a trim.
    """

    states: Mapping[str, float]
    inputs: Mapping[str, float]
    outputs: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, ArrayLike] = field(default_factory=dict)
    residual: float = 0.0

    def __getitem__(self, name: str) -> float:
        """Return the value of a state, an input or an output."""
        for values in (self.states, self.inputs, self.outputs):
            if name in values:
                return values[name]
        known = [*self.states, *self.inputs, *self.outputs]
        raise InputInvalid(_unknown("value", name, known))


def is_hull(model: Model) -> bool:
    """Return whether a model is a hull: its states begin with position, attitude and velocity."""
    first = [(v.name, v.size) for v in model.of_kind("state")][:3]
    return first == [("p", 3), ("q_nb", 4), ("nu_b", 6)]


def place_of(kind: str, name: str, known: list[str], where: str) -> list[int]:
    """Return the places of a variable, all its elements or the one named, among `known`."""
    found = [i for i, k in enumerate(known) if k == name or k.startswith(f"{name}[")]
    if not found:
        raise InputInvalid(f"{where}: {_unknown(kind, name, known)}")
    return found


def _unknown(kind: str, name: str, known: list[str]) -> str:
    whole = list(dict.fromkeys(split_element_name(k)[0] for k in known))
    hint = did_you_mean(name, [*whole, *known])
    listed = ", ".join(whole[:40]) + (", …" if len(whole) > 40 else "")
    return f"there is no {kind} {name!r}{hint}; expected {listed or 'none'}, or an element"


class Coordinates:
    """Names and functions of a model's states, inputs and outputs, by element, at time `t`.

    States are the continuous ones, or the discrete ones of a model that has a clock.
    """

    def __init__(
        self, model: Model, parameters: Mapping[str, ArrayLike] | None = None, t: Any = 0.0
    ) -> None:
        self.model = model
        self.t = t  # s, a number or a symbol
        self._f = f = Evaluation(model)
        self.p = f.values_of("parameter", parameters or {})
        self.d = np.array(f.derived(self.p)).ravel()
        start = np.array(f.initial(self.p, self.d)).ravel()
        self.hull = is_hull(model)
        n_x = sum(v.size for v in model.of_kind("state"))
        x, self.z = start[:n_x], start[n_x:]
        kinds: tuple[Kind, ...] = ("discrete" if model.clocks else "state", "input", "output")
        self.states, self.inputs, self.outputs = (
            [n for v in model.of_kind(kind) for n in element_names(v.name, v.shape)]
            for kind in kinds
        )
        self.x_0, self.u_0 = self.z if model.clocks else x, f.values_of("input", {})
        if self.hull:
            self.states = [*_POSE, *_NU, *self.states[13:]]
            theta = np.array(ca.evalf(euler_of_q(ca.SX(ca.DM(x[3:7]))))).ravel()
            self.x_0 = np.concatenate([x[:3], theta, x[7:]])

    @cached_property
    def symbols(self) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
        """Return (x, u, dx/dt, y) as expressions, in the order of the names."""
        x, u = ca.SX.sym("x", len(self.states)), ca.SX.sym("u", len(self.inputs))
        full = ca.vertcat(x[:3], q_of_euler(x[3], x[4], x[5]), x[6:]) if self.hull else x
        none = ca.SX(0, 1)
        p, d, z = (ca.SX(ca.DM(v)) if len(v) else none for v in (self.p, self.d, self.z))
        if self.model.clocks:
            w = ca.SX.zeros(sum(draw.numel() for draw in self.model.clocks[0].draws))
            new = self._f.updates[0].call([self.t, u, p, d, none, x, w], True, False)[0]
            return x, u, new, self._f.outputs.call([self.t, u, p, d, none, new], True, False)[0]
        rates = self._f.rhs.call([self.t, u, p, d, full, z], True, False)[0]
        y = self._f.outputs.call([self.t, u, p, d, full, z], True, False)[0]
        if self.hull:
            rates = ca.vertcat(rates[:3], ca.mtimes(T_zyx(x[3], x[4]), x[9:12]), rates[7:])
        return x, u, rates, y

    @cached_property
    def functions(self) -> tuple[ca.Function, ca.Function]:
        """Return (f, Jacobians):  f(x, u) -> (dx/dt, y),  and of both by x and u: A, B, C, D."""
        x, u, rates, y = self.symbols
        jacobians = [ca.jacobian(e, by) for e in (rates, y) for by in (x, u)]
        return (
            ca.Function("f", [x, u], [rates, y]),
            ca.Function("jacobians", [x, u], [ca.densify(j) for j in jacobians]),
        )

    def point(self, given: Mapping[str, ArrayLike] | OperatingPoint | None) -> tuple[Array, Array]:
        """Return x and u: at the start values, save what is given by name or by element."""
        x, u = self.x_0.copy(), self.u_0.copy()
        if isinstance(given, OperatingPoint):
            given = {**given.states, **given.inputs}
        for name, value in (given or {}).items():
            known = [*self.states, *self.inputs]
            places = place_of("state or input", name, known, self.model.name)
            values = np.asarray(value, dtype=float).ravel()
            if values.size not in (1, len(places)) or not np.all(np.isfinite(values)):
                n = len(places)
                expected = "a finite number" if n == 1 else f"{n} finite numbers"
                raise InputInvalid(f"{self.model.name}.{name}", f"{value!r}", expected)
            for place, number in zip(places, np.broadcast_to(values, len(places)), strict=True):
                if place < len(x):
                    x[place] = number
                else:
                    u[place - len(x)] = number
        return x, u

    def named(
        self, x: Array, u: Array, parameters: Mapping[str, ArrayLike], residual: float = 0.0
    ) -> OperatingPoint:
        """Return the operating point at x and u."""
        y = np.array(self.functions[0](x, u)[1]).ravel()
        return OperatingPoint(
            dict(zip(self.states, map(float, x), strict=True)),
            dict(zip(self.inputs, map(float, u), strict=True)),
            dict(zip(self.outputs, map(float, y), strict=True)),
            parameters,
            residual,
        )
