"""Linear tables as intrinsics: one function call in the equations, whatever the number of rows.

A table's name holds the hash of its contents. In CasADi it is a Callback, called and never
inlined; an emitter finds the numbers in `TABLES` by the called function's name. Within the
grid a table is (bi)linear; outside it holds the value at the edge and has gradient 0. On a grid
point the value is the row itself, and the gradient that of the interval to the right.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from math import isnan

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.intrinsics.callback import CALLBACKS, register_callback

__all__ = ["TABLES", "Table", "interpolants", "table1", "table2"]

Grid = tuple[float, ...]


@dataclass(frozen=True)
class Table:
    """The numbers of a table: values row by row, [y][x]; y is empty in one dimension."""

    name: str
    x: Grid
    y: Grid
    values: Grid

    @property
    def n_in(self) -> int:
        """Return the number of arguments."""
        return 2 if self.y else 1

    def __call__(self, x: float, y: float = 0.0) -> float:
        """Return the value at x, or at (x, y)."""
        if not self.y:
            return _linear(self.x, self.values, x)
        return _linear(self.y, [_linear(self.x, row, x) for row in self._rows()], y)

    def dx(self, x: float, y: float = 0.0) -> float:
        """Return the partial derivative to x."""
        if not self.y:
            return _slope(self.x, self.values, x)
        return _linear(self.y, [_slope(self.x, row, x) for row in self._rows()], y)

    def dy(self, x: float, y: float) -> float:
        """Return the partial derivative to y."""
        return _slope(self.y, [_linear(self.x, row, x) for row in self._rows()], y)

    def _rows(self) -> list[Grid]:
        n = len(self.x)
        return [self.values[i : i + n] for i in range(0, len(self.values), n)]


TABLES: dict[str, Table] = {}
_INTERPOLANTS: ContextVar[bool] = ContextVar("interpolants", default=False)


def table1(x: Sequence[float], values: Sequence[float]) -> Callable[[ca.SX], ca.SX]:
    """Return the linear table of `values` over the rising grid `x`, as a function of an SX."""
    return _registered("table1", x, (), values)


def table2(
    x: Sequence[float], y: Sequence[float], values: Sequence[Sequence[float]]
) -> Callable[[ca.SX, ca.SX], ca.SX]:
    """Return the bilinear table of values[y][x] over two rising grids, as a function of two SX."""
    return _registered("table2", x, y, [float(v) for row in values for v in row])


@contextmanager
def interpolants() -> Iterator[None]:
    """Declare tables as CasADi's own linear interpolants: many times as fast there, not emitted."""
    token = _INTERPOLANTS.set(True)
    try:
        yield
    finally:
        _INTERPOLANTS.reset(token)


def _callable(table: Table) -> ca.Function:
    if not _INTERPOLANTS.get():
        return CALLBACKS[table.name]
    # CasADi's interpolant of the same function would go on beyond its edges.
    grids = [list(g) for g in (table.x, table.y) if g]
    inner = ca.interpolant("table", "linear", grids, list(table.values))
    at = [ca.MX.sym(f"at{i}") for i in range(table.n_in)]
    held = [ca.fmin(ca.fmax(a, g[0]), g[-1]) for a, g in zip(at, grids, strict=True)]
    return ca.Function(table.name, at, [inner(ca.vertcat(*held))])


def _linear(grid: Grid, values: Sequence[float], at: float) -> float:
    if isnan(at):
        return at
    if at <= grid[0]:
        return values[0]
    if at >= grid[-1]:
        return values[-1]
    i = bisect_right(grid, at) - 1
    return values[i] + (at - grid[i]) * ((values[i + 1] - values[i]) / (grid[i + 1] - grid[i]))


def _slope(grid: Grid, values: Sequence[float], at: float) -> float:
    if at < grid[0] or at >= grid[-1]:
        return 0.0
    i = bisect_right(grid, at) - 1
    return (values[i + 1] - values[i]) / (grid[i + 1] - grid[i])


def _registered(
    kind: str, x: Sequence[float], y: Sequence[float], values: Sequence[float]
) -> Callable[..., ca.SX]:
    grids = {"x": tuple(map(float, x)), "y": tuple(map(float, y))}
    for axis, grid in grids.items():
        if (axis == "x" or grid) and (len(grid) < 2 or not np.all(np.diff(grid) > 0)):
            raise ParameterInvalid("table", f"grid {axis} = {grid}", "two or more, rising")
    numbers = tuple(map(float, values))
    expected = len(grids["x"]) * max(1, len(grids["y"]))
    if len(numbers) != expected or not np.all(np.isfinite(numbers)):
        raise ParameterInvalid("table", f"{len(numbers)} values", f"{expected}, all finite")
    content = np.array([*grids["x"], *grids["y"], *numbers]).astype("<f8").tobytes()
    digest = hashlib.sha256(f"{kind} {len(grids['x'])} ".encode() + content).hexdigest()[:12]
    table = Table(f"{kind}_{digest}", grids["x"], grids["y"], numbers)
    if table.name not in TABLES:
        TABLES[table.name] = table
        partials = [("_d", table.dx)] if not table.y else [("_dx", table.dx), ("_dy", table.dy)]

        def register(
            name: str, function: Callable[..., float], *gradients: ca.Function
        ) -> ca.Function:
            def of_scalars(*at: ca.DM) -> float:
                return function(*map(float, at))

            return register_callback(name, of_scalars, [1] * table.n_in, (1, 1), gradients)

        register(table.name, table, *(register(table.name + s, f) for s, f in partials))
    return lambda *at: _callable(table).call([*at], False, True)[0]
