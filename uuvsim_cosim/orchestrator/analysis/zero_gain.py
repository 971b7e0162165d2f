"""Commands that are in a dead band, where an opened signal has no loop, or next to one.

In the dead band of a thruster, the derivative by the command is exactly zero, although the equation
contains the command. A command is an input with a smallest and a largest value. Next to the band,
the gain is not that of the design: an allocation crosses the band in one steep line.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.orchestrator.analysis.system_map import StepJacobian, SystemMap

__all__ = ["ZeroGain"]

Array = NDArray[np.float64]
BESIDE = 1.25  # a command is next to a band within this factor of its end
NEAREST, FARTHEST = 1e-6, 1e3  # changes of a value that are tried, relative to 1 + |value|


class ZeroGain:
    """Values of a system at ticks k (over one period) that have no influence on other values.

    `points` are (k, x, j): the state and the Jacobian at tick k. The Jacobian contains the entries
    that are zero by value, if the equations have a term there.
    """

    def __init__(
        self, m: SystemMap, points: Sequence[tuple[int, Array, StepJacobian]], u: Array
    ) -> None:
        self.m, self.points, self.u = m, points, u
        size: dict[tuple[int, int], float] = {}  # of the derivative of row by col, with zeros
        cut = [m.links[n].source for n in m.cut]
        for _, _, j in points:
            for entries, columns in ((j.A, None), (j.late, cut), (j.early, cut)):
                found = entries.tocoo()
                for row, col, value in zip(found.row, found.col, found.data, strict=True):
                    key = int(row), int(col) if columns is None else columns[col]
                    size[key] = size.get(key, 0.0) + abs(value)
        of_part = [(p.at, p.end, self._commands(i)) for i, p in enumerate(m.parts)]
        self.by_command = sorted(
            (row, col) for row, col in size if any(a <= row < b and col in c for a, b, c in of_part)
        )
        self.zero = [pair for pair in self.by_command if size[pair] == 0]
        self._bands: dict[tuple[int, int], tuple[float, float] | None] = {}

    def beside(self) -> str:
        """Return which commands are in a dead band around 0 or next to one; empty if none is.

        One command of each component is looked at.
        """
        found: dict[str, str] = {}
        for row, col in self.by_command:
            owner = next(p.path for p in self.m.parts if row < p.end)
            if owner in found:
                continue
            value = float(self.points[0][1][col])
            low, high = (self._reach(row, col, sign, 0.0) for sign in (-1.0, 1.0))
            if low and high and BESIDE * low <= value <= BESIDE * high:
                found[owner] = (
                    f"{self.m.names[col]} = {value:.3g}, and {owner} has a dead band between "
                    f"{low:.3g} and {high:.3g}"
                )
        first, *others = found or [""]
        more = f" ({', '.join(others)} too)" if others else ""
        return f"{found[first]}{more}" if first else ""

    def _commands(self, i: int) -> set[int]:
        """Return the values that are connected to commands of component i."""
        part = self.m.parts[i]
        limited = {
            part.offset[v.name] + e
            for v in part.model.of_kind("input")
            if v.min is not None and v.max is not None
            for e in range(v.size)
        }
        return {n.source for n in self.m.links if n.target == i and n.element in limited}

    def after(self, reached: NDArray[np.bool_]) -> str:
        """Return where the influence of the values `reached` ends; empty if no band is found.

        A component is named once, by the first of its values.
        """
        found: dict[str, str] = {}
        others: list[str] = []
        for row, col in self.zero:
            if not reached[col] or reached[row]:
                continue
            owner = next(p.path for p in self.m.parts if row < p.end)
            if owner in found or owner in others or (band := self._band(row, col)) is None:
                continue
            if found:
                others.append(owner)
                continue
            low, high = band
            within = f"between {low:.3g} and {high:.3g}" if high > low else "there"
            value = self.points[0][1][col]
            found[owner] = (
                f"{self.m.names[row]} does not change with {self.m.names[col]} = {value:.3g} "
                f"{within}, as in a dead band"
            )
        text = next(iter(found.values()), "")
        return text + (f"; nor do {', '.join(others)} with theirs" if others else "")

    def _band(self, row: int, col: int) -> tuple[float, float] | None:
        """Return the values of `col` between which `row` is constant; None if all of them."""
        if (row, col) not in self._bands:
            value = float(self.points[0][1][col])
            units = (-1.0 - abs(value), 1.0 + abs(value))
            ends = [self._reach(row, col, unit, value) for unit in units]
            low, high = (value + e if e is not None else None for e in ends)
            both = low is not None or high is not None
            self._bands[row, col] = (
                (-np.inf if low is None else low, np.inf if high is None else high)
                if both
                else None
            )
        return self._bands[row, col]

    def _reach(self, row: int, col: int, unit: float, value: float) -> float | None:
        """Return how far `col` may change from a value until `row` does; None if it never does.

        It is found to 1e-5 of it. The row is taken to change no more than once on the way.
        """
        changes = partial(self._changes, row, col, value)
        share = NEAREST
        if changes(share * unit):
            return 0.0
        while share < FARTHEST and not changes(share * unit):
            share *= 2.0
        if share >= FARTHEST:
            return None
        low, high = share / 2.0, share
        while high - low > 1e-5 * high:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if changes(middle * unit) else (middle, high)
        return low * unit

    def _changes(self, row: int, col: int, value: float, change: float) -> bool:
        for k, state, _ in self.points:
            rows = []
            for wanted in (value, value + change):
                x = state.copy()
                x[col] = wanted
                rows.append(float(self.m.advance(k, x, self.u)[row]))
            if abs(rows[1] - rows[0]) > 1e-9 * (1.0 + abs(rows[0])):
                return True
        return False
