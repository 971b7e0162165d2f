"""M, C, D and g against MSS, uuv_simulator, gz-sim, and what must hold of them."""

from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from uuvsim_cosim.models import kinematics, restoring, rigid_body
from uuvsim_cosim.models.added_mass import C_A
from uuvsim_cosim.models.damping import D, damping

HERE = Path(__file__).parent / "reference"
MSS = YAML(typ="safe").load(HERE / "mss_values.yaml")
REXROV = YAML(typ="safe").load(HERE / "rexrov_pointwise.yaml")
CHECKS = YAML(typ="safe").load(HERE / "published_checks.yaml")
GZ = CHECKS["gz_sim_hydrodynamics"]
finite = st.floats(-10, 10)
six = st.lists(finite, min_size=6, max_size=6).map(np.array)


def number(expression: Any) -> np.ndarray:
    return np.array(ca.evalf(ca.SX(expression)))


def test_M_RB_agrees_with_mss() -> None:
    """MSS states M_RB about CO; its inertia about CG is what remains without m S²(r_g)."""
    M_RB = np.array(MSS["remus100_MRB"])
    m, r_g = M_RB[0, 0], np.array([0, 0, 0.02])
    S = number(kinematics.S(ca.SX(r_g)))
    I_b = rigid_body.inertia_about_CO(m, ca.SX(M_RB[3:, 3:] + m * S @ S), ca.SX(r_g))
    np.testing.assert_allclose(number(rigid_body.M_RB(m, I_b, ca.SX(r_g))), M_RB, atol=1e-9)


def test_C_RB_agrees_with_mss() -> None:
    M_RB = np.array(MSS["remus100_MRB"])
    ours = rigid_body.C_RB(
        M_RB[0, 0], ca.SX(M_RB[3:, 3:]), ca.SX([0, 0, 0.02]), ca.SX(MSS["nu_test"][3:])
    )
    np.testing.assert_allclose(number(ours), MSS["remus100_CRB_nu2_form"], atol=1e-9)


def test_m2c_agrees_with_mss() -> None:
    ours = rigid_body.m2c(ca.SX(np.array(MSS["remus100_MRB"])), ca.SX(MSS["nu_test"]))
    np.testing.assert_allclose(number(ours), MSS["m2c_of_MRB"], atol=1e-9)


def test_C_A_agrees_with_mss() -> None:
    ours = C_A(ca.SX(np.array(MSS["remus100_MA"])), ca.SX(MSS["nu_test"]))
    np.testing.assert_allclose(number(ours), MSS["remus100_CA_full"], atol=1e-9)


def test_restoring_agrees_with_mss() -> None:
    down = kinematics.R_zyx(0.1, -0.2, 0.0)[2, :].T
    ours = restoring.g(300.0, 306.0, ca.SX([0.01, 0.02, 0.05]), ca.SX([0, 0, -0.03]), down)
    name = "gvect_W300_B306_theta_m0p2_phi_0p1_rbg_0p01_0p02_0p05_rbb_0_0_m0p03"
    np.testing.assert_allclose(number(ours).ravel(), MSS[name][0], atol=1e-9)


def test_the_two_forms_of_rigid_body_coriolis_give_the_same_force() -> None:
    M_RB, nu = np.array(MSS["remus100_MRB"]), np.array(MSS["nu_test"])
    one = number(rigid_body.m2c(ca.SX(M_RB), ca.SX(nu))) @ nu
    np.testing.assert_allclose(np.array(MSS["remus100_CRB_nu2_form"]) @ nu, one, atol=1e-9)


# ---- uuv_simulator's RexROV, whose M_A is full and (by a misprint) not symmetric ---------------


def rexrov() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    hull = REXROV["hull"]
    M_RB = rigid_body.M_RB(hull["m"], ca.SX(np.array(hull["I"])), ca.SX(3, 1))
    return (
        number(M_RB) + np.array(hull["M_A"], dtype=float),
        np.diag(np.array(hull["D_l"], dtype=float)),
        np.diag(np.array(hull["D_q"], dtype=float)),
    )


def test_total_mass_agrees_with_uuv_simulator() -> None:
    np.testing.assert_allclose(rexrov()[0], REXROV["M_total"], atol=1e-8)


@pytest.mark.parametrize("point", REXROV["points"])
def test_forces_and_acceleration_agree_with_uuv_simulator(point: dict[str, Any]) -> None:
    M, D_l, D_q = rexrov()
    nu = ca.SX(point["nu"])
    C_nu = number(rigid_body.coriolis(ca.SX(M), nu)).ravel()
    D_nu = number(damping(ca.SX(D_l), ca.SX(D_q), nu)).ravel()
    np.testing.assert_allclose(C_nu, point["C_nu"], rtol=0, atol=1e-8)
    np.testing.assert_allclose(D_nu, point["D_nu"], rtol=0, atol=1e-8)
    nu_dot = -number(rigid_body.inverse(ca.SX(M))) @ (C_nu + D_nu)
    np.testing.assert_allclose(nu_dot, point["nu_dot_for_tau0_no_restoring"], rtol=0, atol=1e-8)


# ---- gz-sim's own assertions --------------------------------------------------------------------


def test_C_A_agrees_with_gz_sim() -> None:
    known = GZ["coriolis_known"]
    ours = C_A(ca.diag(ca.SX(known["MA_diag"])), ca.SX(known["nu"]))
    np.testing.assert_array_equal(number(ours), known["CA"])


@pytest.mark.parametrize("name", ["coriolis_regression", "coriolis_tethys"])
def test_single_elements_of_C_A_agree_with_gz_sim(name: str) -> None:
    case = GZ[name]
    ours = number(C_A(ca.diag(ca.SX(case["MA_diag"])), ca.SX(case["nu"])))
    for key in (k for k in case if k.startswith("CA_")):
        i, j = int(key[3]), int(key[5])
        assert ours[i, j] == pytest.approx(case[key], rel=1e-9)


def test_the_munk_moment_turns_a_slender_hull_broadside() -> None:
    case = GZ["munk"]
    force = -number(rigid_body.coriolis(ca.diag(ca.SX(case["MA_diag"])), ca.SX(case["nu"])))
    assert force[5, 0] == pytest.approx(case["force_minus_CA_nu_yaw"], rel=1e-12)


@pytest.mark.parametrize("nu", GZ["skew_passive_full_MA"]["nu"])
def test_C_of_a_full_mass_is_skew_and_passive(nu: list[float]) -> None:
    C = number(C_A(ca.SX(np.array(GZ["skew_passive_full_MA"]["MA"])), ca.SX(nu)))
    assert np.abs(C + C.T).max() <= 1e-12
    assert abs(np.array(nu) @ C @ np.array(nu)) <= 1e-12


@given(st.lists(finite, min_size=36, max_size=36), six)
@settings(max_examples=100, deadline=None)
def test_coriolis_forces_do_no_work(elements: list[float], nu: np.ndarray) -> None:
    M = ca.SX(np.array(elements).reshape(6, 6))
    power = float(nu @ number(rigid_body.coriolis(M, ca.SX(nu))).ravel())
    assert abs(power) <= 1e-9 * (1 + np.abs(elements).max() * np.abs(nu).max() ** 3)


@given(st.lists(finite, min_size=36, max_size=36), six)
@settings(max_examples=50, deadline=None)
def test_coriolis_is_its_matrix_times_nu(elements: list[float], nu: np.ndarray) -> None:
    M = ca.SX(np.array(elements).reshape(6, 6))
    force = number(rigid_body.coriolis(M, ca.SX(nu))).ravel()
    np.testing.assert_allclose(force, number(rigid_body.m2c(M, ca.SX(nu))) @ nu, atol=1e-9)


@pytest.mark.parametrize("case", [c for c in GZ["damping"] if "force" in c])
def test_surge_damping_agrees_with_gz_sim(case: dict[str, float]) -> None:
    D_l, D_q = ca.SX(6, 6), ca.SX(6, 6)
    D_l[0, 0], D_q[0, 0] = case.get("Xu", 0.0), case["XuuAbs"]
    force = number(damping(D_l, D_q, ca.SX([case["u"], 0, 0, 0, 0, 0])))[0, 0]
    assert force == pytest.approx(case["force"], rel=1e-12)


@given(st.lists(finite, min_size=72, max_size=72), six)
@settings(max_examples=50, deadline=None)
def test_damping_is_its_matrix_times_nu(elements: list[float], nu: np.ndarray) -> None:
    D_l, D_q = (ca.SX(m) for m in np.array(elements).reshape(2, 6, 6))
    ours = number(damping(D_l, D_q, ca.SX(nu))).ravel()
    np.testing.assert_allclose(ours, number(D(D_l, D_q, ca.SX(nu))) @ nu, atol=1e-9)


@given(st.lists(finite, min_size=36, max_size=36))
@settings(max_examples=50, deadline=None)
def test_the_inverse_of_a_mass_is_that_of_numpy(elements: list[float]) -> None:
    A = np.array(elements).reshape(6, 6)
    M = A @ A.T / 10 + 5 * np.eye(6)
    ours = number(rigid_body.inverse(ca.SX(M)))
    np.testing.assert_allclose(ours @ M, np.eye(6), atol=1e-10)


def test_the_inverse_keeps_structural_zeros() -> None:
    M = ca.SX(ca.Sparsity.diag(6))
    M[0, 4], M[4, 0] = 1.0, 1.0
    assert rigid_body.inverse(M + 3 * ca.SX.eye(6)).nnz() == 8


@pytest.mark.parametrize(
    ("depth", "fraction"), [(-0.2, 0.0), (-0.15, 0.0), (0.0, 0.5), (0.15, 1.0), (9.0, 1.0)]
)
def test_buoyancy_is_lost_over_the_height_of_the_hull(depth: float, fraction: float) -> None:
    s = restoring.submerged_fraction(ca.SX(depth), ca.SX(3, 1), ca.SX([0, 0, 1]), 0.3)
    assert float(ca.evalf(s)) == pytest.approx(fraction, abs=1e-12)


@pytest.mark.parametrize("edge", [-0.15, 0.15])
def test_buoyancy_has_no_kink_where_its_loss_begins_and_ends(edge: float) -> None:
    z = ca.SX.sym("z")
    s = restoring.submerged_fraction(z, ca.SX(3, 1), ca.SX([0, 0, 1]), 0.3)
    slope = ca.Function("f", [z], [ca.gradient(s, z)])
    assert abs(float(slope(edge - 1e-7))) < 1e-4
    assert abs(float(slope(edge + 1e-7))) < 1e-4
