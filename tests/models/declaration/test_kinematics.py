"""Rotations against each other (`models check --source mss` compares them with MSS)."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration import kinematics as k
from uuvsim_cosim.models.declaration.library import declare

ANGLES = (0.1, -0.2, 0.5)
angle = st.floats(-3.1, 3.1)


def number(expression: Any) -> np.ndarray:
    return np.array(ca.evalf(ca.SX(expression)))


@given(angle, st.floats(-1.5, 1.5), angle)
@settings(max_examples=50, deadline=None)
def test_euler_angles_come_back_from_the_quaternion(phi: float, theta: float, psi: float) -> None:
    q = k.q_of_euler(phi, theta, psi)
    np.testing.assert_allclose(number(k.euler_of_q(q)).ravel(), [phi, theta, psi], atol=1e-9)


@given(st.lists(st.floats(-2, 2), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1))
@settings(max_examples=50, deadline=None)
def test_R_is_a_rotation_for_a_quaternion_of_any_length(q: list[float]) -> None:
    Rnb = number(k.R(ca.SX(q)))
    np.testing.assert_allclose(Rnb @ Rnb.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(Rnb) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("sign", [1, -1])
def test_euler_angles_and_their_gradient_are_finite_at_the_pole(sign: int) -> None:
    q = ca.SX.sym("q", 4)
    euler = ca.Function("f", [q], [k.euler_of_q(q), ca.jacobian(k.euler_of_q(q), q)])
    values, gradient = euler([np.sqrt(0.5), 0, sign * np.sqrt(0.5), 0])
    assert float(values[1]) == pytest.approx(sign * np.pi / 2, abs=1e-7)
    assert np.all(np.isfinite(np.array(gradient)))


def test_yaw_is_kept_at_the_pole() -> None:
    q = k.q_of_euler(0.0, np.pi / 2, 0.7)
    assert number(k.euler_of_q(q)).ravel()[2] == pytest.approx(0.7, abs=1e-6)


def test_a_vehicle_turns_through_the_pole() -> None:
    """Pitched by a moment, it passes theta = 90 degrees with all outputs finite."""
    r = simulate(declare("bluerov2_heavy", surface=False), until=10, h=0.01, tau=[0, 0, 0, 0, 8, 0])
    assert np.abs(r["eta"][:, 4]).max() > 1.5
    assert np.abs(np.linalg.norm(r["q"], axis=1) - 1).max() < 1e-14


def test_quaternion_kinematics_agree_with_euler_kinematics() -> None:
    """d(phi, theta, psi)/dt by the chain rule through q equals T_zyx omega."""
    q = ca.SX.sym("q", 4)
    omega = np.array([0.3, -0.2, 0.5])
    rate = ca.Function("f", [q], [ca.jtimes(k.euler_of_q(q), q, ca.mtimes(k.T_q(q), omega))])
    ours = np.array(rate(number(k.q_of_euler(*ANGLES)))).ravel()
    np.testing.assert_allclose(ours, number(k.T_zyx(*ANGLES[:2])) @ omega, atol=1e-12)
