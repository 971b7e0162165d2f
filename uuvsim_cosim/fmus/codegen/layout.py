"""Layout of a declaration's variables in an instance's block of values."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca

from uuvsim_cosim.models.declaration.model import Declared, Kind, Model

__all__ = ["Layout", "Placed"]

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

    def offset_of(self, name: str) -> int:
        """Return the offset of a variable's first element: its value reference."""
        return next(p.offset for p in self.placed if p.variable.name == name)

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
