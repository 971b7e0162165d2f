"""The design of an LQR: a hull's linear model at rest, and `control.lqr` on it.

States are (z, eta, nu) with dz/dt = eta, errors of small size, in b; the cost is

    J = integral of  x' Q x + tau' R tau,   Q_ii = (1 / largest x_i)², R_ii = (1 / largest tau_i)²

by Bryson's rule: Q and R are handed in as those largest values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.linearize import linear_model
from uuvsim_cosim.models.analysis.operating_point import is_hull
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model

__all__ = ["Design", "design_lqr"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Design:
    """K (6, 18) of (z, e, nu error), the cost matrix S (18, 18), and the closed loop's poles."""

    K: Array
    S: Array
    poles: NDArray[np.complex128]


def design_lqr(vehicle: str | Model, Q: ArrayLike, R: ArrayLike) -> Design:
    """Design the gains of `lqr` for a vehicle at rest, level and submerged.

    Q (18): largest z [m.s, rad.s], e [m, rad] and velocity error [m/s, rad/s] that are wanted;
    R (6): largest force [N, N.m]. Raises InputInvalid where a value is not positive, or where
    the hull cannot be stabilised.
    """
    import control

    model = declare(vehicle, surface=False) if isinstance(vehicle, str) else vehicle
    if not is_hull(model):
        raise InputInvalid("design_lqr", f"{model.name} is no hull", "a vehicle")
    largest = {"Q": _positive("Q", Q, 18), "R": _positive("R", R, 6)}
    plant = linear_model(model, inputs=["tau"], outputs=["eta", "nu"])
    A, B = np.zeros((18, 18)), np.zeros((18, 6))
    A[:6, 6:12] = np.eye(6)
    A[6:, 6:], B[6:] = plant.A[:12, :12], plant.B[:12]
    K, S, poles = control.lqr(A, B, np.diag(largest["Q"] ** -2), np.diag(largest["R"] ** -2))
    if not np.all(np.real(poles) < 0):
        raise InputInvalid(f"design_lqr: {model.name}: the loop is not stable with these weights")
    return Design(np.array(K), np.array(S), np.array(poles))


def _positive(name: str, values: ArrayLike, size: int) -> Array:
    given = np.asarray(values, dtype=float).ravel()
    if given.size != size or not np.all(np.isfinite(given)) or not np.all(given > 0):
        shown: Sequence[float] = given.tolist()
        raise InputInvalid("design_lqr", f"{name} = {shown}", f"{size} positive numbers")
    return given
