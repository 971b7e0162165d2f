"""What gz-sim, LRAUV and MSS assert or print of single functions and short runs, beside ours."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from ruamel.yaml import YAML

from uuvsim_cosim.models.cross_flow import cross_flow
from uuvsim_cosim.models.ellipsoid import added_mass
from uuvsim_cosim.models.fins import fin_force
from uuvsim_cosim.models.library import declare
from uuvsim_cosim.models.propeller import propeller
from uuvsim_cosim.models.restoring import g
from uuvsim_cosim.models.rigid_body import M_RB, inertia_about_CO
from uuvsim_cosim.models.seawater import gravity
from uuvsim_cosim.models.simulate import simulate
from uuvsim_cosim.orchestrator.run import run
from uuvsim_cosim.orchestrator.system import System

HERE = Path(__file__).parent / "reference"
CHECKS = YAML(typ="safe").load(HERE / "published_checks.yaml")
MSS = YAML(typ="safe").load(HERE / "mss_values.yaml")
GZ, LRAUV = CHECKS["gz_sim_other"], CHECKS["lrauv"]
NU = np.array(MSS["nu_test"])
N_MAX = 47.1238898038  # rad/s, of the shipped propeller


# ---- LRAUV's system tests -----------------------------------------------------------------------


def tethys(elevator: float, out: Path) -> tuple[np.ndarray, np.ndarray]:
    """Give eta and nu (n, 6) of hull, propeller at 300 rpm and fins, from rest at 0.5 m."""
    system = (
        System("tethys", "0.02", "As in LRAUV's system tests")
        .add("propeller", "model:propeller?vehicle=tethys_lrauv", start={"u": 31.4159265 / N_MAX})
        .add("fins", "model:fins?vehicle=tethys_lrauv&contact=true", start={"u": [0, elevator]})
        .add("hull", "model:tethys_lrauv?surface=false", start={"eta_0": [0, 0, 0.5, 0, 0, 0]})
        .connect("propeller.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("hull.nu_r", "propeller.nu_r")
    )
    signals = run(system, until=45.0, out=out, backend="native").signals()
    return signals["hull.eta"], signals["hull.nu"]


def test_tethys_accelerates_straight_ahead_as_its_project_asserts(tmp_path: Path) -> None:
    case, action = LRAUV["forward_300rpm"], LRAUV["propeller_action"]
    eta, nu = tethys(0.0, tmp_path)
    assert nu[-1, 0] == pytest.approx(case["speed_mps"], abs=case["tol"])
    assert nu[-1, 0] == pytest.approx(action["speed_mps"], abs=action["tol"])
    assert abs(nu[-1, 2]) < case["abs_w_max"]
    assert abs(eta[-1, 2] + action["z"]) < action["tol_z"]
    assert abs(eta[-1, 3]) < action["roll_tol"]
    assert np.all(np.abs(eta[-1, 4:]) < action["pitch_yaw_tol"])


def test_an_elevator_of_tethys_dives_as_its_project_asserts(tmp_path: Path) -> None:
    """Nose down, deeper than 1.5 m, and never above 0.01 m; about +y its sense is the same."""
    eta, _ = tethys(LRAUV["elevator"]["angle_rad"], tmp_path)
    assert eta[-1, 4] < 0
    assert eta[-1, 2] > 1.5
    assert np.min(eta[:, 2]) > -0.01


def test_released_nose_up_tethys_swings_back_and_never_beyond() -> None:
    case = LRAUV["restoring"]
    start = {"eta_0": [0, 0, 10, 0, case["pitch0_rad"], 0]}
    r = simulate(declare("tethys_lrauv", surface=False), until=60.0, h=0.05, parameters=start)
    assert np.max(np.abs(r["eta"][:, 4])) <= case["max_pitch_ever"] + 1e-9
    assert np.min(r["eta"][:, 4]) < 0, "it swings through level"
    assert np.max(np.abs(np.diff(r["eta"][:, :2], axis=0))) < case["xy_drift_per_step"]


# ---- gz-sim's integration tests -----------------------------------------------------------------


@pytest.mark.parametrize("D", GZ["thruster"]["D"])
def test_the_speed_of_a_shaft_for_a_thrust_is_gz_sims(D: float) -> None:
    case = GZ["thruster"]
    k = case["rho"] * case["kT"] * D**4
    omega = np.sqrt(case["F_N"] / k)
    given = {"T_nn": k, "T_nV": 0.0, "n_max": omega, "t": 0.0, "T_n": 0.02}
    r = simulate(
        propeller("tethys_lrauv"), at=[0.0, 1.0], h=0.01, inputs={"u": 1}, parameters=given
    )
    assert r["thrust"][-1] == pytest.approx(case["F_N"], rel=1e-9)


def test_lift_of_a_foil_is_gz_sims_but_for_a_sine() -> None:
    """It has cl alpha, a fin here cl sin(alpha) cos(alpha): 0.7 % less at 0.1 rad, 0 broadside."""
    case = GZ["lift_drag"]
    figures = {"rho": case["rho"], "S": case["area"], "C_L_alpha": case["cla"]}
    figures |= {"C_D_0": 0.0, "C_D_n": 0.0, "alpha_stall": 1.0}
    speed, a0 = 10.0, case["a0"]
    nu = ca.SX([speed * np.cos(a0), 0, speed * np.sin(a0), 0, 0, 0])
    force = fin_force(nu, ca.SX([0, 0, 0]), ca.SX([0, 1, 0]), 0.0, figures)
    found = float(ca.evalf(ca.norm_2(force)))
    theirs = case["cla"] * a0 * 0.5 * case["rho"] * speed**2 * case["area"]
    assert found == pytest.approx(theirs * np.sin(2 * a0) / (2 * a0), rel=1e-9)
    assert found == pytest.approx(theirs, rel=0.01)


# ---- MSS ----------------------------------------------------------------------------------------


def test_total_mass_of_msss_spheroid_agrees() -> None:
    s = MSS["remus100_spheroid_semiaxes"]
    a, b = s["a"], s["b"]
    m = 4 / 3 * np.pi * s["rho_MRB"] * a * b * b
    I_g = ca.SX(ca.diag(ca.DM([0.4 * m * b * b, *[0.2 * m * (a * a + b * b)] * 2])))
    r_g = ca.SX(ca.DM(s["r_bg"]))
    rigid = np.array(ca.evalf(ca.densify(M_RB(m, inertia_about_CO(m, I_g, r_g), r_g))))
    added = added_mass(a, b, b, s["rho_MA"])
    added[3] = MSS["remus100_MA"][3][3]  # chosen there, not of a spheroid
    total = rigid + np.diag(added)
    np.testing.assert_allclose(total, MSS["remus100_M_total"], rtol=1e-9, atol=1e-9)


def test_restoring_by_the_rotation_matrix_is_msss() -> None:
    theta, phi = -0.2, 0.1
    down = [-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)]
    ours = g(300.0, 306.0, ca.SX([0.01, 0.02, 0.05]), ca.SX([0, 0, -0.03]), ca.SX(down))
    np.testing.assert_allclose(np.array(ca.evalf(ours)).ravel(), MSS["gRvect_same"][0], atol=1e-9)


def test_the_planes_moments_of_npsauv_are_msss() -> None:
    """Its B_delta is the one without a slipstream, n = 0."""
    fins = declare("fins", vehicle="npsauv", form="derivatives")
    for i, (pitch, yaw) in enumerate(zip(*MSS["npsauv_B_delta"], strict=True)):
        moments = []
        for delta in (1e-4, -1e-4):
            inputs = {"u": [delta * (j == i) for j in range(4)], "n": 0.0}
            nu_r = [1.0, 0, 0, 0, 0, 0]
            steered = simulate(fins, at=[0.0, 3.0], h=0.02, inputs=inputs | {"nu_r": nu_r})
            moments.append(steered["tau"][-1])
        slope = (moments[0] - moments[1]) / 2e-4
        np.testing.assert_allclose(slope[[4, 5]], [pitch, yaw], rtol=1e-8, atol=1e-6)


def test_gravity_is_msss_to_a_millionth() -> None:
    """It takes WGS-84's formula, this the one of the UNESCO papers that depth is computed with."""
    ours = float(gravity(np.deg2rad(63.446827)))
    assert ours == pytest.approx(MSS["gravity_lat_63p446827deg"], rel=1e-6)


def test_cross_flow_is_msss_where_the_flow_is_in_one_plane_but_for_its_extra_strip() -> None:
    """MSS brakes each axis by itself, over 21 stations; across both axes ours is not the sum."""
    L, D, rho = 1.6, 0.19, 1026.0
    theirs = np.array(MSS["crossFlowDrag_cylinder_L1p6_D0p19"]).ravel()
    x = np.linspace(-L / 2, L / 2, 21)
    v, w = NU[1] + x * NU[5], NU[2] - x * NU[4]
    sums = np.array([np.sum(-np.abs(v) * v), np.sum(-np.abs(w) * w)]) * L / 20
    C_D = theirs[1:3] / (0.5 * rho * D * sums)
    assert C_D[0] == pytest.approx(C_D[1], rel=1e-9), "one coefficient for both planes"
    k = 0.5 * rho * C_D[0] * D
    alone = ca.SX([0, NU[1], 0, 0, 0, NU[5]])
    ours = -np.array(ca.evalf(cross_flow(alone, -L / 2, L / 2, k, k))).ravel()
    assert ours[1] == pytest.approx(theirs[1], rel=0.12)
    assert ours[5] == pytest.approx(theirs[5], rel=0.17)
    exact = np.trapezoid(-np.abs(v) * v, x) * k
    assert ours[1] == pytest.approx(exact, rel=0.01)


@pytest.mark.parametrize("J", [0.2, 0.4])
def test_a_straight_line_in_J_is_within_four_percent_of_wageningens_polynomial(J: float) -> None:
    line = 0.4566 + (0.1798 - 0.4566) / 0.6632 * J
    assert line == pytest.approx(MSS[f"wageningen_B3_0p718_J{J}".replace(".", "p")]["KT"], rel=0.04)
