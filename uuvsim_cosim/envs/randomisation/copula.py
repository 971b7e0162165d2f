"""A Gaussian copula: draws in (0, 1) that keep their own distributions but move together.

With z_i independent standard normals and C = L L^T the correlation matrix, x = L z is normal with
correlation C, and Phi(x_i) is uniform again.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import Problem
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["Copula", "copula_problems"]

Array = NDArray[np.float64]
Pairs = Mapping[tuple[str, str], float]
TINY = 1e-12  # a pivot below it counts as zero: a draw that follows from those before it


def copula_problems(pairs: Pairs, labels: Sequence[str]) -> list[Problem]:
    """Return the mistakes in the correlations between draws."""
    problems: list[Problem] = []
    seen: set[frozenset[str]] = set()
    for pair, rho in pairs.items():
        place = f"correlation of {' and '.join(pair)}"
        for name in pair:
            if name not in labels:
                right = expected_names(name, labels, "a parameter that has a distribution")
                problems.append(Problem(place, f"{name!r} is not one draw", right))
        if len(set(pair)) != 2:
            problems.append(Problem(place, "one draw with itself", "two draws"))
        elif frozenset(pair) in seen:
            problems.append(Problem(place, "given twice", "once"))
        seen.add(frozenset(pair))
        if not (isinstance(rho, int | float) and -1.0 <= rho <= 1.0):
            problems.append(Problem(place, f"{rho}", "a number in [-1, 1]"))
    if problems:
        return problems
    names, matrix = _matrix(pairs)
    least = float(np.linalg.eigvalsh(matrix)[0]) if names else 1.0
    if least < -1e-9:
        read = f"no random numbers can have these (least eigenvalue {least:.3g})"
        expected = "a positive semidefinite matrix: weaker correlations, or more of them"
        problems.append(Problem(f"correlation of {', '.join(names)}", read, expected))
    return problems


def _matrix(pairs: Pairs) -> tuple[list[str], Array]:
    names = list(dict.fromkeys(name for pair in pairs for name in pair))
    matrix = np.eye(len(names))
    for (a, b), rho in pairs.items():
        i, j = names.index(a), names.index(b)
        matrix[i, j] = matrix[j, i] = rho
    return names, matrix


@final
class Copula:
    """Correlations between some of the draws; the others are returned unchanged."""

    def __init__(self, pairs: Pairs) -> None:
        self.names, C = _matrix(pairs)
        n = len(self.names)
        self._L = L = [[0.0] * n for _ in range(n)]
        for i in range(n):
            for j in range(i + 1):
                rest = float(C[i, j]) - math.fsum(L[i][k] * L[j][k] for k in range(j))
                if i == j:
                    L[i][i] = math.sqrt(rest) if rest > TINY else 0.0
                elif L[j][j] > 0.0:
                    L[i][j] = rest / L[j][j]

    def correlated(self, u: Mapping[str, Array]) -> dict[str, Array]:
        """Return the draws by label, with the correlated ones replaced, row by row."""
        from scipy.special import ndtr, ndtri

        z = [np.asarray(ndtri(u[name])) for name in self.names]
        out = dict(u)
        for i, name in enumerate(self.names):
            x = np.zeros_like(z[i])
            for factor, each in zip(self._L[i][: i + 1], z, strict=False):
                if factor != 0.0:
                    x = x + factor * each
            out[name] = np.clip(ndtr(x), 2.0**-54, 1.0 - 2.0**-53)
        return out
