"""LQR: gains that minimise a quadratic cost of error and force, about the hull's own linear model.

    tau = K_i z + K_p e + K_d (nu_b - nu) + M dnu_b/dt + C(nu_b) nu_b + D(nu_b) nu_b + g(eta_d)

(K_i K_p K_d), 6 x 18, is the solution of the Riccati equation for the hull at rest, with
dz/dt = e (Fossen 2021, 2nd ed., chapter 16; integral action by augmentation). The shipped preset
holds its K; `design_lqr` computes another one with `control.lqr`. Its states are (z, eta, nu),
errors of small size, in b; the cost is

    J = integral of  x' Q x + tau' R tau,   Q_ii = (1 / largest x_i)², R_ii = (1 / largest tau_i)²

by Bryson's rule: Q and R are handed in as those largest values. With ``id=vehicle`` there is no
preset: weights, gains and limits follow from the vehicle's own files (`vehicle_design.py`), and
axes that its thrusters do not control get no force.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.linearize import linear_model
from uuvsim_cosim.models.analysis.operating_point import is_hull
from uuvsim_cosim.models.control.control_law import law, nominal_hull
from uuvsim_cosim.models.control.vehicle_design import control_design
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.vectors import TAU, per

__all__ = ["Design", "design_lqr", "lqr"]

Array = NDArray[np.float64]
PRESET = "bluerov2_lqr"
OWN = "vehicle"  # instead of a preset: figures that follow from the vehicle's files
_FORCE, _MOMENT = ("N", "N.m"), ("m", "rad")
K_UNITS = tuple(
    f"{_FORCE[i > 2]}{over}{_MOMENT[j % 6 > 2]}{end}"
    for i in range(6)
    for j in range(18)
    for over, end in [(("/(", ".s)"), ("/", ""), (".s/", ""))[j // 6]]
)


def lqr(id: str = PRESET, vehicle: str = "bluerov2_heavy", period: str = "0.02") -> Model:
    """Declare the law; gains are the preset's K, or are designed here from its Q and R.

    K is used for the vehicle that it was designed for, bluerov2_heavy in the shipped preset. With
    the `id` "vehicle", all figures are those of `control_design` for the `vehicle`.
    """
    p = _own_figures(vehicle) if id == OWN else preset("controllers", id, "controller")
    m = Model("lqr", "LQR with integral action, designed on the hull's linear model")
    loop, hull = law(m, p, period), nominal_hull(m, vehicle)
    if "K" in p.values and (id == OWN or (id, vehicle) == (PRESET, "bluerov2_heavy")):
        designed = np.array(p.vector("K", K_UNITS, 108)).reshape(6, 18)
    else:
        designed = design_lqr(vehicle, p.vector("Q", "1", 18), p.vector("R", "1", 6)).K
    K = m.parameter("K", designed, unit=K_UNITS, description="(K_i K_p K_d)")
    units = per("m.s", "rad.s")
    limit = p.parameter(m, "z_max", units, "limit of z", 6, min=0)
    z = loop.integral("z", units)
    nu_b = loop.nu_b
    state = ca.vertcat(loop.in_body(z), loop.e, nu_b - loop.nu)
    tau = (
        ca.mtimes(K, state)
        + ca.mtimes(hull.M, loop.a_b)
        + ca.mtimes(hull.C(nu_b) + hull.D(nu_b), nu_b)
        + hull.g(loop.eta_d)
    )
    K_p = ca.vertcat(*(K[i, 6 + i] for i in range(6)))
    if id == OWN:  # without force in an axis, nothing is missing there
        K_p = ca.vertcat(*(K_p[i] if designed[i].any() else 1e12 for i in range(6)))
    loop.close(tau, z, lambda short: loop.in_ned(loop.e + short / (K_p + 1e-9)), limit)
    return m


def _own_figures(vehicle: str) -> Preset:
    """Return the figures of `control_design` as a preset."""
    design = control_design(vehicle)
    values = {
        "K": (design.K.ravel().tolist(), list(K_UNITS), 0),
        "tau_max": (design.tau_max.tolist(), list(TAU), 0),
        "z_max": (design.z_max.tolist(), list(per("m.s", "rad.s")), 0),
        "T_ff": ([0.3], ["s"], 0),
    }
    return Preset(Path(vehicle), values)


@dataclass(frozen=True)
class Design:
    """K (6, 18) of (z, e, nu error), the cost matrix S (18, 18), and the closed loop's poles."""

    K: Array
    S: Array
    poles: NDArray[np.complex128]


def design_lqr(vehicle: str | Model, Q: ArrayLike, R: ArrayLike) -> Design:
    """Design the gains of `lqr` for a `vehicle` (a name or a `Model`) at rest, level and submerged.

    `Q` (18): largest z [m.s, rad.s], e [m, rad] and velocity error [m/s, rad/s] that are wanted;
    `R` (6): largest force [N, N.m]. The result has the gains `K` (6, 18), the cost matrix `S`
    (18, 18) and the `poles` of the closed loop [1/s]. Raises InputInvalid if a value is not
    positive, or if the hull cannot be stabilised.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.models import design_lqr
    >>> design = design_lqr("bluerov2_heavy", Q=np.ones(18), R=np.full(6, 50.0))
    >>> design.K.shape, f"{max(design.poles.real):.2f} 1/s"
    ((6, 18), '-0.77 1/s')
    """
    import control

    model = declare(vehicle, surface=False) if isinstance(vehicle, str) else vehicle
    if not is_hull(model):
        raise InputInvalid("design_lqr", f"{model.name} is no hull", "a vehicle")
    largest = {}
    for name, values, size in (("Q", Q, 18), ("R", R, 6)):
        largest[name] = given = np.asarray(values, dtype=float).ravel()
        if given.size != size or not np.all(np.isfinite(given)) or not np.all(given > 0):
            raise InputInvalid(
                "design_lqr", f"{name} = {given.tolist()}", f"{size} positive numbers"
            )
    plant = linear_model(model, inputs=["tau"], outputs=["eta", "nu"])
    A, B = np.zeros((18, 18)), np.zeros((18, 6))
    A[:6, 6:12] = np.eye(6)
    A[6:, 6:], B[6:] = plant.A[:12, :12], plant.B[:12]
    K, S, poles = control.lqr(A, B, np.diag(largest["Q"] ** -2), np.diag(largest["R"] ** -2))
    if not np.all(np.real(poles) < 0):
        raise InputInvalid(f"design_lqr: {model.name}: the loop is not stable with these weights")
    return Design(np.array(K), np.array(S), np.array(poles))
