"""Single functions against what gz-sim asserts in its own tests."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import casadi as ca
import numpy as np

from uuvsim_cosim.models.actuators.fins import fin_force
from uuvsim_cosim.models.actuators.propeller import propeller
from uuvsim_cosim.models.checks.comparison import Checked, compared, number, reference_values
from uuvsim_cosim.models.checks.compiled_run import end_of
from uuvsim_cosim.models.hull.coriolis import coriolis, m2c
from uuvsim_cosim.models.hull.damping import damping

__all__ = ["functions"]

EQUAL = partial(compared, "gz_sim", "")


def functions() -> Iterator[Checked]:
    """Yield Coriolis, Munk moment, damping, shaft speed and lift, as its tests state them."""
    values = reference_values("published_checks.yaml")
    gz, other = values["gz_sim_hydrodynamics"], values["gz_sim_other"]
    known = gz["coriolis_known"]
    ours = number(m2c(ca.diag(ca.SX(known["MA_diag"])), ca.SX(known["nu"])))
    yield EQUAL("C_A of a diagonal M_A", ours, known["CA"], 1e-12)
    for name, what in (("coriolis_regression", "other numbers"), ("coriolis_tethys", "Tethys")):
        case = gz[name]
        ours = number(m2c(ca.diag(ca.SX(case["MA_diag"])), ca.SX(case["nu"])))
        keys = [k for k in case if k.startswith("CA_")]
        found = [ours[int(k[3]), int(k[5])] for k in keys]
        yield EQUAL(f"elements of C_A, {what}", found, [case[k] for k in keys], 1e-9)
    munk = gz["munk"]
    force = -number(coriolis(ca.diag(ca.SX(munk["MA_diag"])), ca.SX(munk["nu"])))
    yield EQUAL("Munk moment", force[5, 0], munk["force_minus_CA_nu_yaw"], 1e-9)
    full = gz["skew_passive_full_MA"]
    off = 0.0
    for nu in full["nu"]:
        C = number(m2c(ca.SX(np.array(full["MA"])), ca.SX(nu)))
        off = max(off, float(np.abs(C + C.T).max()), abs(float(np.array(nu) @ C @ np.array(nu))))
    yield EQUAL("C_A of a full M_A is skew and does no work", off, 0.0, 1e-12)
    pushes, theirs = [], []
    for case in (c for c in gz["damping"] if "force" in c):
        D_l, D_q = ca.SX(6, 6), ca.SX(6, 6)
        D_l[0, 0], D_q[0, 0] = case.get("Xu", 0.0), case["XuuAbs"]
        pushes.append(number(damping(D_l, D_q, ca.SX([case["u"], 0, 0, 0, 0, 0])))[0, 0])
        theirs.append(case["force"])
    yield EQUAL("linear and quadratic damping in surge", pushes, theirs, 1e-9)
    shaft = other["thruster"]
    for D in shaft["D"]:
        k = shaft["rho"] * shaft["kT"] * D**4
        omega = float(np.sqrt(shaft["F_N"] / k))
        given = {"T_nn": k, "T_nV": 0.0, "n_max": omega, "t": 0.0, "T_n": 0.02}
        run = end_of(propeller("tethys_lrauv"), 1.0, 0.01, {"u": 1}, given)
        what = f"thrust at the speed of its shaft for 300 N, D = {D} m"
        yield EQUAL(what, run["thrust"], shaft["F_N"], 1e-9, relative=True)
    lift = other["lift_drag"]
    figures = {"rho": lift["rho"], "S": lift["area"], "C_L_alpha": lift["cla"]}
    figures |= {"C_D_0": 0.0, "C_D_n": 0.0, "alpha_stall": 1.0}
    a0, speed = lift["a0"], 10.0
    nu = ca.SX([speed * np.cos(a0), 0, speed * np.sin(a0), 0, 0, 0])
    found = number(ca.norm_2(fin_force(nu, ca.SX([0, 0, 0]), ca.SX([0, 1, 0]), 0.0, figures)))
    flat = lift["cla"] * a0 * 0.5 * lift["rho"] * speed**2 * lift["area"]
    why = "it has c_l alpha, a fin here c_l sin(alpha) cos(alpha): 0.7 % less at 0.1 rad"
    yield EQUAL("lift of a foil at 0.1 rad, unchanged", found, flat, 1e-3, relative=True, known=why)
    sine = flat * np.sin(2 * a0) / (2 * a0)
    what = "lift of a foil at 0.1 rad, alpha for its sine and cosine"
    yield EQUAL(what, found, sine, 1e-9, relative=True)
