"""The reference: its special cases, and that what it says of its motion is its derivative."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.analysis.simulate import Trajectory, simulate
from uuvsim_cosim.models.guidance.reference import reference

LEMNISCATE: dict[str, Any] = {"A": (2.0, 1.0, 0.3), "rate": 0.2, "course": 0.7}
HELIX: dict[str, Any] = {"A": (2.0, 0.0, 0.0), "A_c": -2.0, "rate": 0.15, "w": 0.05}
LINE: dict[str, Any] = {"A": (0.0, 0.0, 0.0), "U": 0.4, "course": -2.0, "w": -0.02}


def run(parameters: dict[str, Any], until: float = 60.0) -> Trajectory:
    return simulate(reference(), until=until, h=0.01, parameters=parameters)


@pytest.mark.parametrize("curve", [LEMNISCATE, HELIX, LINE])
def test_its_velocity_and_yaw_rate_are_the_derivatives_of_its_pose(curve: dict[str, Any]) -> None:
    t = run(curve)
    eta, nu = t["eta_d"], t["nu_d"]
    psi = np.unwrap(eta[:, 5])
    moved = (eta[2:, :3] - eta[:-2, :3]) / 0.02
    mid = nu[1:-1]
    np.testing.assert_allclose(moved[:, 0], mid[:, 0] * np.cos(psi[1:-1]), atol=1e-5)
    np.testing.assert_allclose(moved[:, 1], mid[:, 0] * np.sin(psi[1:-1]), atol=1e-5)
    np.testing.assert_allclose(moved[:, 2], mid[:, 2], atol=1e-6)
    np.testing.assert_allclose((psi[2:] - psi[:-2]) / 0.02, mid[:, 5], atol=1e-4)
    assert np.all(eta[:, 3:5] == 0.0)  # it stays level


def test_the_points_ahead_are_where_it_will_be() -> None:
    t = run(LEMNISCATE | {"dt_ahead": 0.5}, until=10.0)
    for i in range(4):
        later = 50 * (i + 1)
        seen = t["ahead"][: len(t.t) - later, 3 * i : 3 * i + 3]
        np.testing.assert_allclose(seen, t["eta_d"][later:, :3], atol=1e-12)


def test_a_helix_keeps_its_radius_and_its_climb() -> None:
    p = run(HELIX)["eta_d"][:, :3]
    np.testing.assert_allclose(np.hypot(p[:, 0], p[:, 1] + 2.0), 2.0, atol=1e-12)
    np.testing.assert_allclose(p[:, 2], 5.0 + 0.05 * run(HELIX).t, atol=1e-12)


def test_a_lemniscate_is_gerono_s() -> None:
    """x⁴ = a² (x² - y²) in its own axes, with a = A_1 = 2 A_2."""
    p = run({"A": (2.0, 1.0, 0.0), "rate": 0.2})["eta_d"]
    x, y = p[:, 0], p[:, 1]
    np.testing.assert_allclose(x**4, 4.0 * (x**2 - y**2), atol=1e-12)


def test_one_that_stands_still_keeps_its_course() -> None:
    t = run({"A": (0.0, 0.0, 0.0), "course": 0.6}, until=1.0)
    np.testing.assert_allclose(t["eta_d"][:, 5], 0.6)
    assert np.all(t["nu_d"] == 0.0)
