"""Functions of Fossen's equation against those of MSS, which GNU Octave evaluated unmodified."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import casadi as ca
import numpy as np

from uuvsim_cosim.models.checks.comparison import Checked, compared, number, reference_values
from uuvsim_cosim.models.declaration import inertia as hull_inertia
from uuvsim_cosim.models.declaration import kinematics
from uuvsim_cosim.models.hull import coriolis, restoring
from uuvsim_cosim.models.hull.coriolis import m2c
from uuvsim_cosim.models.hull.damping import cross_flow
from uuvsim_cosim.models.shapes.ellipsoid import added_mass
from uuvsim_cosim.models.water.seawater import gravity

__all__ = ["matrices", "others", "rotations"]

ANGLES = (0.1, -0.2, 0.5)
EQUAL = partial(compared, "mss", "")
STATIONS = "MSS sums 21 stations for 20 strips: the extra station adds this drag"


def rotations() -> Iterator[Checked]:
    """Yield rotations and their rates."""
    mss = reference_values("mss_values.yaml")
    k = kinematics
    q = k.q_of_euler(*ANGLES)
    pairs = [
        ("Rzyx", k.R_zyx(*ANGLES), "Rzyx_0p1_m0p2_0p5"),
        ("Tzyx", k.T_zyx(*ANGLES[:2]), "Tzyx_0p1_m0p2"),
        ("euler2q", q.T, "euler2q_0p1_m0p2_0p5"),
        ("Rzyx by way of a quaternion", k.R(q), "Rzyx_0p1_m0p2_0p5"),
        ("Tquat", k.T_q(q), "Tquat_of_that_q"),
        ("Hmtrx", k.H(ca.SX([0.1, 0.2, 0.3])), "Hmtrx_r_0p1_0p2_0p3"),
    ]
    for what, ours, name in pairs:
        yield EQUAL(what, number(ours), mss[name], 1e-9)


def matrices() -> Iterator[Checked]:
    """Yield mass, Coriolis and restoring matrices."""
    mss = reference_values("mss_values.yaml")
    spheroid = mss["remus100_spheroid_semiaxes"]
    nu, rigid = ca.SX(mss["nu_test"]), np.array(mss["remus100_MRB"], dtype=float)
    m, r_g = float(rigid[0, 0]), ca.SX([0, 0, 0.02])
    S = number(kinematics.S(r_g))
    inertia = hull_inertia.inertia_about_CO(m, ca.SX(rigid[3:, 3:] + m * S @ S), r_g)
    yield EQUAL("M_RB", number(hull_inertia.M_RB(m, inertia, r_g)), rigid, 1e-9)
    C_RB = coriolis.C_RB(m, ca.SX(rigid[3:, 3:]), r_g, nu[3:])
    yield EQUAL("C_RB by angular velocity", number(C_RB), mss["remus100_CRB_nu2_form"], 1e-9)
    C = coriolis.m2c(ca.SX(rigid), nu)
    yield EQUAL("m2c", number(C), mss["m2c_of_MRB"], 1e-9)
    M_A = np.array(mss["remus100_MA"], dtype=float)
    yield EQUAL("C_A", number(m2c(ca.SX(M_A), nu)), mss["remus100_CA_full"], 1e-9)
    a, b = spheroid["a"], spheroid["b"]
    added = added_mass(a, b, b, spheroid["rho_MA"])
    added[3] = M_A[3, 3]  # chosen there, not of a spheroid
    yield EQUAL("M_A of a spheroid (imlay61)", np.diag(added), M_A, 1e-9)
    m = 4 / 3 * np.pi * spheroid["rho_MRB"] * a * b * b
    I_g = ca.SX(ca.diag(ca.DM([0.4 * m * b * b, *[0.2 * m * (a * a + b * b)] * 2])))
    of_body = hull_inertia.M_RB(m, hull_inertia.inertia_about_CO(m, I_g, r_g), r_g)
    total = number(of_body) + np.diag(added)
    yield EQUAL("total mass of a spheroid", total, mss["remus100_M_total"], 1e-9)
    down = kinematics.R_zyx(0.1, -0.2, 0.0)[2, :].T
    g = restoring.g(300.0, 306.0, ca.SX([0.01, 0.02, 0.05]), ca.SX([0, 0, -0.03]), down)
    name = "gvect_W300_B306_theta_m0p2_phi_0p1_rbg_0p01_0p02_0p05_rbb_0_0_m0p03"
    yield EQUAL("gvect", number(g).ravel(), mss[name][0], 1e-9)
    yield EQUAL("gRvect", number(g).ravel(), mss["gRvect_same"][0], 1e-9)


def others() -> Iterator[Checked]:
    """Yield gravity, cross-flow drag, and K_T of a propeller."""
    mss = reference_values("mss_values.yaml")
    lat = np.deg2rad(63.446827)
    theirs = mss["gravity_lat_63p446827deg"]
    what = "gravity at 63.4 deg: the formula of UNESCO against that of WGS-84"
    yield EQUAL(what, float(gravity(lat)), theirs, 1e-6, relative=True)
    # Where the flow is in one plane; across both, MSS brakes each axis alone.
    L = 1.6
    nu = np.array(mss["nu_test"], dtype=float)
    theirs = np.array(mss["crossFlowDrag_cylinder_L1p6_D0p19"], dtype=float).ravel()[[1, 5]]
    x = np.linspace(-L / 2, L / 2, 21)
    v = nu[1] + x * nu[5]
    stations = np.array([-np.abs(v) * v, -x * np.abs(v) * v])
    k = theirs[0] / (stations[0].sum() * L / 20)
    alone = ca.SX([0, nu[1], 0, 0, 0, nu[5]])
    ours = -number(cross_flow(alone, -L / 2, L / 2, k, k)).ravel()[[1, 5]]
    exact = np.trapezoid(stations, x, axis=1) * k
    what = "crossFlowDrag in one plane, its end stations counted by half"
    yield EQUAL(what, ours, exact, 0.01, relative=True)
    what = "crossFlowDrag in one plane, unchanged"
    yield EQUAL(what, ours, theirs, 0.01, relative=True, known=STATIONS)
    for J in (0.2, 0.4):
        line = 0.4566 + (0.1798 - 0.4566) / 0.6632 * J
        theirs = mss[f"wageningen_B3_0p718_J{J}".replace(".", "p")]["KT"]
        what = f"K_T of Wageningen B3-71.8 at J = {J}: a straight line against the polynomial"
        yield EQUAL(what, line, theirs, 0.04, relative=True)
