"""A declaration's equations as CasADi functions of its parts, and one Runge-Kutta step of them."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Kind, Model

__all__ = ["Evaluation"]

Array = NDArray[np.float64]


class Evaluation:
    """Functions of (t, u, p, d, x, z): inputs, parameters, derived, states, discrete states."""

    def __init__(self, model: Model) -> None:
        self.model = model
        for v in model.of_kind("state"):
            if v.name not in model.derivatives:
                raise ParameterInvalid(f"{model.name}.{v.name}: state without der()")
        u, p, d, x, z = (
            _column([ca.vertcat(*v.symbol.nonzeros()) for v in model.of_kind(kind)])
            for kind in _PARTS
        )
        arguments = [model.t, u, p, d, x, z]
        symbols: list[ca.SX] = []
        derived: list[ca.SX] = []
        for v in model.of_kind("derived"):  # by parameters alone: each may use earlier ones
            value = ca.vertcat(*v.start.nonzeros())
            derived.append(ca.substitute([value], symbols, derived)[0] if symbols else value)
            symbols.append(ca.vertcat(*v.symbol.nonzeros()))
        self.derived = ca.Function("derived", [p], [_column(derived)])
        start = [ca.SX(v.start) for v in model.of_kind("state", "discrete")]
        self.initial = ca.Function("initial", [p, d], [_column(start)])
        dx = _column([model.derivatives[v.name] for v in model.of_kind("state")])
        self.rhs = ca.Function("rhs", arguments, [dx])
        y = _column([v.symbol for v in model.of_kind("output")])
        self.outputs = ca.Function("outputs", arguments, [y])
        self.rk4 = self._rk4(arguments)
        self.updates = []
        for clock in model.clocks:
            new = {v.name: value for v, value in clock.updates}
            z_new = _column([new.get(v.name, v.symbol) for v in model.of_kind("discrete")])
            w = ca.vertcat(*clock.draws) if clock.draws else ca.SX(0, 1)
            self.updates.append(ca.Function(clock.name, [*arguments, w], [z_new]))

    def _rk4(self, arguments: list[ca.SX]) -> ca.Function:
        """One step of length h with the inputs at its start, middle and end."""
        t, u, p, d, x, z = (ca.SX.sym(f"a{i}", *a.shape) for i, a in enumerate(arguments))
        u_m, u_e = ca.SX.sym("u_m", *u.shape), ca.SX.sym("u_e", *u.shape)
        h = ca.SX.sym("h")
        if x.numel() == 0:
            return ca.Function("rk4", [t, h, u, u_m, u_e, p, d, x, z], [x])
        k1 = self.rhs.call([t, u, p, d, x, z], True, False)[0]
        k2 = self.rhs.call([t + h / 2, u_m, p, d, x + h / 2 * k1, z], True, False)[0]
        k3 = self.rhs.call([t + h / 2, u_m, p, d, x + h / 2 * k2, z], True, False)[0]
        k4 = self.rhs.call([t + h, u_e, p, d, x + h * k3, z], True, False)[0]
        end = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return ca.Function("rk4", [t, h, u, u_m, u_e, p, d, x, z], [end])

    def values_of(self, kind: Kind, given: Mapping[str, ArrayLike]) -> Array:
        """Return all values of the inputs or parameters, those not given at their start values."""
        known = {v.name: v for v in self.model.of_kind(kind)}
        for name in given:
            if name not in known:
                raise ParameterInvalid(
                    self.model.name, f"there is no {kind} {name!r}", ", ".join(known)
                )
        parts = [np.zeros(0)]
        for name, v in known.items():
            value = np.asarray(given.get(name, v.start), dtype=float).ravel()
            if value.size != v.size:
                raise ParameterInvalid(f"{self.model.name}.{name}", f"{value.size} values", v.size)
            parts.append(value)
        return np.concatenate(parts)


_PARTS: tuple[Kind, ...] = ("input", "parameter", "derived", "state", "discrete")


def _column(parts: list[ca.SX]) -> ca.SX:
    return ca.densify(ca.vertcat(*(ca.vec(ca.densify(p)) for p in parts))) if parts else ca.SX(0, 1)
