"""Parameters that the data do not determine: weak directions of the Fisher information."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.parameters import Fitted

__all__ = ["WEAK", "ambiguities", "own_sizes", "scaled_information"]

Array = NDArray[np.float64]
WEAK = 0.25  # relative standard error of a weak direction: ± 50 % at 95 %
_SHARE, _CORRELATED = 0.3, 0.95


def scaled_information(information: Array, theta: Array, fitted: Sequence[Fitted]) -> Array:
    """Return the information of parameters in units of their own size."""
    sizes = own_sizes(theta, fitted)
    scaled: Array = information * np.outer(sizes, sizes)
    return scaled


def own_sizes(theta: Array, fitted: Sequence[Fitted]) -> Array:
    """Return the size (n_p,) of each parameter at theta."""
    least = np.array([max(f.size, 0.05 * abs(f.start)) for f in fitted])
    size = np.maximum(np.abs(theta), least)
    return np.where(size > 0, size, 1.0)


def ambiguities(names: Sequence[str], scaled: Array) -> list[str]:
    """Return a message for each combination of parameters that the data do not determine.

    A combination is a direction in which all could change, each by its share of its own size,
    with a standard error above a quarter; two that are correlated by more than 0.95 are named too.
    """
    values, directions = np.linalg.eigh(scaled)
    found = []
    named: set[frozenset[str]] = set()
    for value, direction in zip(values, directions.T, strict=True):
        error = float("inf") if value <= 0 else float(value**-0.5)
        if error < WEAK:
            continue
        size = np.abs(direction) / np.abs(direction).max()
        group = [n for n, s in zip(names, size, strict=True) if s > _SHARE]
        named.add(frozenset(group))
        bound = "" if error > 10.0 else f" better than ± {196 * error:.0f} % (95 %)"
        if len(group) == 1:
            found.append(f"the data do not determine {group[0]}{bound}")
        else:
            signs = np.sign(direction[[names.index(n) for n in group]])
            how = "together" if np.all(signs == signs[0]) else "against each other"
            found.append(
                f"the data cannot separate {', '.join(group[:-1])} and {group[-1]}: they can "
                f"change {how}, which the data do not determine{bound}"
            )
    try:
        covariance = np.linalg.inv(scaled + 1e-9 * np.eye(len(names)))
    except np.linalg.LinAlgError:
        return found
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    for i, a in enumerate(names):
        for j in range(i):
            r = float(covariance[i, j] / (errors[i] * errors[j]))
            pair = frozenset((a, names[j]))
            weak = max(errors[i], errors[j]) > 0.5 * WEAK
            if abs(r) > _CORRELATED and weak and not any(pair <= g for g in named):
                found.append(f"{names[j]} and {a} are known together only (correlation {r:.3f})")
    return found
