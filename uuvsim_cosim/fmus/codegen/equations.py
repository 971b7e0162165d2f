"""The equations of a declaration as CasADi functions of a block of values, and its layout."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.interruption import interruptible
from uuvsim_cosim.models.declaration.model import Declared, Kind, Model

__all__ = ["Equations", "Layout", "Placed", "equations"]

ORDER: tuple[Kind, ...] = ("input", "parameter", "derived", "state", "discrete", "output")


@dataclass(frozen=True)
class Placed:
    """A declared variable and the offset of its first element."""

    variable: Declared
    offset: int


class Layout:
    """The block: time, then inputs, parameters, derived, states, discrete states, outputs."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.placed: list[Placed] = []
        self.offset: dict[Kind, int] = {}
        self.count: dict[Kind, int] = {}
        n = 1
        for kind in ORDER:
            self.offset[kind] = n
            for variable in model.of_kind(kind):
                self.placed.append(Placed(variable, n))
                n += variable.size
            self.count[kind] = n - self.offset[kind]
        self.size = n

    @cached_property
    def _offsets(self) -> dict[str, int]:
        return {p.variable.name: p.offset for p in self.placed}

    def offset_of(self, name: str) -> int:
        """Return the offset of a variable's first element: its value reference."""
        return self._offsets[name]

    def derivative_of(self, state: Placed) -> int:
        """Return the value reference of a state's derivative; these follow the block."""
        return self.size + state.offset - self.offset["state"]

    @cached_property
    def block(self) -> Any:
        """The symbols of all variables before the outputs, as one SX column."""
        parts = [self.model.t]
        for p in self.placed:
            if p.variable.kind != "output":
                symbol = p.variable.symbol
                parts += symbol.nonzeros() if p.variable.kind == "derived" else [symbol]
        return ca.vertcat(*parts)

    def symbols(self, kind: Kind) -> Any:
        """Return all symbols of a kind (not of outputs), as one SX column."""
        return self.block[ca.Slice(self.offset[kind], self.offset[kind] + self.count[kind])]


@dataclass(frozen=True)
class Equations:
    """Functions of the block `b` (see `Layout`); updates also take the clock's draws."""

    layout: Layout
    derived: Any
    initial: Any
    rhs: Any
    outputs: Any
    forward: Any
    updates: tuple[Any, ...]


@interruptible()
def equations(model: Model) -> Equations:
    """Collect a model's equations; raises ParameterInvalid if one is missing."""
    layout = Layout(model)
    b = layout.block
    for state in model.of_kind("state"):
        if state.name not in model.derivatives:
            raise ParameterInvalid(f"{model.name}.{state.name}: state without der()")

    symbols: list[Any] = []
    derived: list[Any] = []  # earlier derived values are substituted in later ones
    for v in model.of_kind("derived"):
        value = ca.vertcat(*v.start.nonzeros())
        derived.append(ca.substitute([value], symbols, derived)[0] if symbols else value)
        symbols.append(ca.vertcat(*v.symbol.nonzeros()))
    start = [ca.vec(ca.densify(ca.SX(v.start))) for v in model.of_kind("state", "discrete")]
    dx = _column([model.derivatives[v.name] for v in model.of_kind("state")])
    y = _column([ca.vec(v.symbol) for v in model.of_kind("output")])
    u, x = layout.symbols("input"), layout.symbols("state")
    seed = ca.SX.sym("seed", u.numel() + x.numel())
    known = ca.vertcat(u, x)
    result = ca.vertcat(y, dx)
    sensitivity = ca.jtimes(result, known, seed) if known.numel() else ca.SX(result.shape)

    def function(name: str, value: Any, *more: Any) -> Any:
        f = ca.Function(name, [b, *more], [ca.densify(value)], {"allow_free": True, "cse": True})
        if f.has_free():
            raise ParameterInvalid(
                f"{model.name}: its {name} depend on {', '.join(f.get_free())}, "
                "which this model does not declare"
            )
        return f

    updates = []
    for clock in model.clocks:
        new = {v.name: expression for v, expression in clock.updates}
        z = _column([new.get(v.name, v.symbol) for v in model.of_kind("discrete")])
        draws = ca.vertcat(*clock.draws) if clock.draws else ca.SX.sym("no_draws", 0)
        updates.append(function(f"update_{clock.index}", z, draws))
    return Equations(
        layout,
        function("derived", _column(derived)),
        function("initial", _column(start)),
        function("rhs", dx),
        function("outputs", y),
        function("forward", ca.densify(sensitivity), seed),
        tuple(updates),
    )


def _column(parts: list[Any]) -> Any:
    return ca.densify(ca.vertcat(*parts)) if parts else ca.SX(0, 1)
