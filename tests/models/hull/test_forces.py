"""What must hold of M, C, D and g (`models check` compares them with MSS and gz-sim)."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.models.declaration import inertia
from uuvsim_cosim.models.hull import coriolis, restoring
from uuvsim_cosim.models.hull.damping import damping

finite = st.floats(-10, 10)
six = st.lists(finite, min_size=6, max_size=6).map(np.array)


def number(expression: Any) -> np.ndarray:
    return np.array(ca.evalf(ca.SX(expression)))


def test_the_two_forms_of_rigid_body_coriolis_give_the_same_force() -> None:
    r_g, nu = ca.SX([0.02, -0.01, 0.05]), np.array([1.2, -0.3, 0.4, 0.1, -0.2, 0.3])
    I_b = ca.SX(np.array([[0.3, 0.02, 0], [0.02, 4.2, -0.1], [0, -0.1, 4.3]]))
    one = number(coriolis.m2c(inertia.M_RB(32.0, I_b, r_g), ca.SX(nu))) @ nu
    other = number(coriolis.C_RB(32.0, I_b, r_g, ca.SX(nu[3:]))) @ nu
    np.testing.assert_allclose(other, one, atol=1e-12)


@given(st.lists(finite, min_size=36, max_size=36), six)
@settings(max_examples=100, deadline=None)
def test_coriolis_forces_do_no_work(elements: list[float], nu: np.ndarray) -> None:
    M = ca.SX(np.array(elements).reshape(6, 6))
    power = float(nu @ number(coriolis.coriolis(M, ca.SX(nu))).ravel())
    assert abs(power) <= 1e-9 * (1 + np.abs(elements).max() * np.abs(nu).max() ** 3)


@given(st.lists(finite, min_size=36, max_size=36), six)
@settings(max_examples=50, deadline=None)
def test_coriolis_is_its_matrix_times_nu(elements: list[float], nu: np.ndarray) -> None:
    M = ca.SX(np.array(elements).reshape(6, 6))
    force = number(coriolis.coriolis(M, ca.SX(nu))).ravel()
    np.testing.assert_allclose(force, number(coriolis.m2c(M, ca.SX(nu))) @ nu, atol=1e-9)


@given(st.lists(finite, min_size=72, max_size=72), six)
@settings(max_examples=50, deadline=None)
def test_damping_is_its_matrix_times_nu(elements: list[float], nu: np.ndarray) -> None:
    D_l, D_q = (ca.SX(m) for m in np.array(elements).reshape(2, 6, 6))
    ours = number(damping(D_l, D_q, ca.SX(nu))).ravel()
    np.testing.assert_allclose(ours, (number(D_l) + number(D_q) * np.abs(nu)) @ nu, atol=1e-9)


@given(st.lists(finite, min_size=36, max_size=36))
@settings(max_examples=50, deadline=None)
def test_the_inverse_of_a_mass_is_that_of_numpy(elements: list[float]) -> None:
    A = np.array(elements).reshape(6, 6)
    M = A @ A.T / 10 + 5 * np.eye(6)
    ours = number(coriolis.inverse(ca.SX(M)))
    np.testing.assert_allclose(ours @ M, np.eye(6), atol=1e-10)


def test_the_inverse_keeps_structural_zeros() -> None:
    M = ca.SX(ca.Sparsity.diag(6))
    M[0, 4], M[4, 0] = 1.0, 1.0
    assert coriolis.inverse(M + 3 * ca.SX.eye(6)).nnz() == 8


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
