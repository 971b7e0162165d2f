"""Check that drawn masses are possible: M positive definite, inertia by its triangle rule."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.targets import Places

__all__ = ["HullMass", "hulls_of"]

Array = NDArray[np.float64]
AT_ONCE = 4096  # rows, to limit the memory for many environments
MASS = ("m", "I_b", "I_g", "M_A", "x_g", "y_g", "z_g")


def hulls_of(places: Places, drawn: Iterable[str]) -> Iterator[HullMass]:
    """Yield the hulls of a system with drawn parameters of mass."""
    from uuvsim_cosim.models.declaration.hull_parameters import meaning_of, missing

    chosen = set(drawn)
    for c in places.plan.components:
        own = [
            v.name for v in c.description.of("parameter") if meaning_of(v.name) and v.shape == ()
        ]
        mass = [n for n in own if n == "m" or n[:3] in MASS]
        if not list(missing(own, surface=False)) and chosen & {f"{c.path}.{n}" for n in mass}:
            yield HullMass(c.path, own, places)


@final
class HullMass:
    """The mass matrix of one hull as a function of the drawn parameters."""

    def __init__(self, path: str, names: list[str], places: Places) -> None:
        import casadi as ca

        from uuvsim_cosim.models.hull.matrices import structure

        self.path = path
        self._names = names
        self._start = {n: float(places.start(f"{path}.{n}")) for n in names}
        symbols = {n: ca.SX.sym(n) for n in names}
        M = ca.densify(structure(symbols)[0])
        self._M: Any = ca.Function("M", [ca.vertcat(*symbols.values())], [M])
        self._triangle = bool(self._inertia_right(self._values({}, 1))[0])

    def right(self, start: Mapping[str, Array], n: int) -> NDArray[np.bool_]:
        """Return which rows of start values are a possible body, of shape (n,)."""
        own = {k: start[f"{self.path}.{k}"] for k in self._names if f"{self.path}.{k}" in start}
        good = np.ones(n, bool)
        for i in range(0, n, AT_ONCE):
            part = slice(i, i + AT_ONCE)
            values = self._values({k: v[part] for k, v in own.items()}, min(AT_ONCE, n - i))
            table = np.array([values[k] for k in self._names])
            M = np.asarray(self._M(table)).reshape(6, -1, 6).transpose(1, 0, 2)
            good[part] = _positive_definite(0.5 * (M + M.transpose(0, 2, 1)))
            if self._triangle:
                good[part] &= self._inertia_right(values)
        return good

    def _values(self, given: Mapping[str, Array], n: int) -> dict[str, Array]:
        """Return all parameters of mass, of shape (n,), the given ones and the system's."""
        return {
            k: np.asarray(given[k], dtype=float) if k in given else np.full(n, self._start[k])
            for k in self._names
        }

    def _inertia_right(self, values: Mapping[str, Array]) -> NDArray[np.bool_]:
        kind = "I_b" if "I_b_11" in values else "I_g"
        a, b, c = (values[f"{kind}_{i}{i}"] for i in (1, 2, 3))
        return np.asarray((a + b >= c) & (b + c >= a) & (c + a >= b))


def _positive_definite(A: Array) -> NDArray[np.bool_]:
    """Return which of the symmetric matrices (n, k, k) have a Cholesky factor, row by row."""
    L = np.zeros_like(A)
    good = np.ones(len(A), bool)
    for i in range(A.shape[1]):
        for j in range(i + 1):
            rest = A[:, i, j].copy()
            for k in range(j):
                rest -= L[:, i, k] * L[:, j, k]
            if i == j:
                good &= rest > 0.0
                L[:, i, i] = np.sqrt(np.where(rest > 0.0, rest, 1.0))
            else:
                L[:, i, j] = rest / L[:, j, j]
    return good
