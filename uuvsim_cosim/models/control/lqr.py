"""LQR: gains that minimise a quadratic cost of error and force, about the hull's own linear model.

    tau = K_i z + K_p e + K_d (nu_b - nu) + M dnu_b/dt + C(nu_b) nu_b + D(nu_b) nu_b + g(eta_d)

(K_i K_p K_d), 6 x 18, is the solution of the Riccati equation for the hull at rest, with
dz/dt = e (Fossen 2021, 2nd ed., chapter 16; integral action by augmentation). `lqr_design.py`
computes it; that of the shipped preset lies in its file.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.models.control.control_law import law, nominal_hull
from uuvsim_cosim.models.control.lqr_design import design_lqr
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.vectors import per

__all__ = ["K_UNITS", "lqr"]

PRESET = "bluerov2_lqr"
_FORCE, _MOMENT = ("N", "N.m"), ("m", "rad")
K_UNITS = tuple(
    f"{_FORCE[i > 2]}{over}{_MOMENT[j % 6 > 2]}{end}"
    for i in range(6)
    for j in range(18)
    for over, end in [(("/(", ".s)"), ("/", ""), (".s/", ""))[j // 6]]
)


def lqr(id: str = PRESET, vehicle: str = "bluerov2_heavy", period: str = "0.02") -> Model:
    """Declare the law; gains are the preset's K, or are designed here from its Q and R.

    K is used for the vehicle that it was designed for, bluerov2_heavy in the shipped preset.
    """
    p = preset("controllers", id, "controller")
    m = Model("lqr", "LQR with integral action, designed on the hull's linear model")
    loop, hull = law(m, p, period), nominal_hull(m, vehicle)
    K = m.parameter("K", _gains(p, id, vehicle), unit=K_UNITS, description="(K_i K_p K_d)")
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
    loop.close(tau, z, lambda short: loop.in_ned(loop.e + short / (K_p + 1e-9)), limit)
    return m


def _gains(p: Preset, id: str, vehicle: str) -> np.ndarray:
    if "K" in p.values and (id, vehicle) == (PRESET, "bluerov2_heavy"):
        return np.array(p.vector("K", K_UNITS, 108)).reshape(6, 18)
    return design_lqr(vehicle, p.vector("Q", "1", 18), p.vector("R", "1", 6)).K
