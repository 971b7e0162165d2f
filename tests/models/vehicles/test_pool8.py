"""pool8 is computed: every number is the closed form that stands beside it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from uuvsim_cosim.models.actuators.thruster import largest_thrust
from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import parameter_set
from uuvsim_cosim.models.hull.matrices import nominal

L, B, H = 0.22, 0.16, 0.12
AXES = (L / 2, B / 2, H / 2)
P = {k: q.value for k, q in parameter_set("pool8").quantities.items()}
WATER = 1000.0 * np.pi / 6 * L * B * H


def lamb(axis: float) -> float:
    """Lamb (1932), art. 114: alpha_0 of one axis of the ellipsoid."""
    a, b, c = AXES

    def integrand(x: float) -> float:
        root = np.sqrt((a * a + x) * (b * b + x) * (c * c + x))
        return float(a * b * c / ((axis * axis + x) * root))

    return float(quad(integrand, 0, np.inf)[0])


def test_added_mass_is_that_of_lambs_ellipsoid() -> None:
    alpha = [lamb(s) for s in AXES]
    assert sum(alpha) == pytest.approx(2.0, abs=1e-6)
    for i in range(3):
        assert P[f"M_A_{i + 1}{i + 1}"] == pytest.approx(
            WATER * alpha[i] / (2 - alpha[i]), rel=1e-4
        )
        j, k = (i + 1) % 3, (i + 2) % 3
        minus, plus = AXES[j] ** 2 - AXES[k] ** 2, AXES[j] ** 2 + AXES[k] ** 2
        turning = minus**2 * (alpha[k] - alpha[j])
        turning /= 2 * minus + plus * (alpha[j] - alpha[k])
        assert P[f"M_A_{i + 4}{i + 4}"] == pytest.approx(WATER / 5 * turning, rel=1e-3)


def test_mass_matrix_is_symmetric_and_positive() -> None:
    mass, linear, quadratic = nominal("pool8")
    assert min(*mass, *linear, *quadratic) > 0
    assert not [k for k in P if k.startswith(("M_A", "D_")) and k[-1] != k[-2]]


def test_inertia_is_that_of_the_solid_ellipsoid() -> None:
    for i, (j, k) in {1: (B, H), 2: (L, H), 3: (L, B)}.items():
        assert P[f"I_b_{i}{i}"] == pytest.approx(P["m"] / 20 * (j * j + k * k), rel=1e-3)


def test_quadratic_drag_is_that_of_the_boxs_faces() -> None:
    q = 0.5 * 1000 * 1.05
    for i, (j, k) in {1: (B, H), 2: (L, H), 3: (L, B)}.items():
        assert P[f"D_q_{i}{i}"] == pytest.approx(q * j * k, rel=1e-4)
        other = {1: L, 2: B, 3: H}[i]
        strips = 0.5 * q * other * ((j / 2) ** 4 + (k / 2) ** 4)
        assert P[f"D_q_{i + 3}{i + 3}"] == pytest.approx(strips, rel=1e-4)


def test_linear_drag_is_the_quadratic_at_the_assumed_speed() -> None:
    for i in range(1, 7):
        speed = 0.1 if i <= 3 else 0.5
        assert P[f"D_l_{i}{i}"] == pytest.approx(P[f"D_q_{i}{i}"] * speed, rel=1e-3)


def test_two_of_them_fit_within_the_papers_distance_and_it_floats() -> None:
    assert float(np.linalg.norm((L, B, H))) < 0.30
    net = P["g"] * (P["rho"] * P["nabla"] - P["m"])
    assert 0.0 < net < 0.01 * P["m"] * P["g"]
    assert P["nabla"] == pytest.approx(WATER / 1000, rel=1e-4)


def test_thrusters_lie_within_the_hull_and_reach_all_degrees_of_freedom() -> None:
    geometry = thruster_geometry("pool8")
    assert np.all(np.abs(geometry.r) <= AXES)
    assert np.linalg.matrix_rank(configuration_matrix(geometry)) == 6


def test_terminal_speed_is_where_drag_is_thrust() -> None:
    X = 4 * largest_thrust() * np.sqrt(0.5)
    hull = declare("pool8", surface=False)
    r = simulate(hull, until=3, h=0.01, tau=[X, 0, 0, 0, 0, 0], parameters={"nabla": 0.0022})
    u = r["nu"][-1, 0]
    assert P["D_l_11"] * u + P["D_q_11"] * u * u == pytest.approx(X, rel=1e-6)
    assert u == pytest.approx(0.8265, abs=1e-3)
