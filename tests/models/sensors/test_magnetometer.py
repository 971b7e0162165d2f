from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.models.declaration.kinematics import R, q_of_euler
from uuvsim_cosim.models.sensors.magnetometer import magnetometer


def read(lanes: Any, silent: Any, Theta: Any = (0, 0, 0), **parameters: Any) -> Any:
    m = magnetometer()
    q = np.array(ca.DM(q_of_euler(*Theta))).ravel()
    return lanes(m, parameters=silent(m) | parameters).step(0.0, 0.1, q=q)["B"]


def test_level_and_to_the_north_it_reads_the_field_of_the_place(lanes: Any, silent: Any) -> None:
    B = read(lanes, silent, field=50e-6, inclination=1.0, declination=0.1)
    level = 50e-6 * np.cos(1.0)
    expected = [level * np.cos(0.1), level * np.sin(0.1), 50e-6 * np.sin(1.0)]
    np.testing.assert_allclose(B, expected, rtol=0, atol=1e-18)


def test_turning_turns_the_field_the_other_way(lanes: Any, silent: Any) -> None:
    Theta = (0.3, -0.4, 2.0)
    Rnb = np.array(ca.DM(R(q_of_euler(*Theta))))
    assert read(lanes, silent, Theta) == pytest.approx(Rnb.T @ read(lanes, silent), abs=1e-18)


def test_without_iron_its_strength_is_that_of_the_field(lanes: Any, silent: Any) -> None:
    for Theta in ((0, 0, 1.0), (1.0, 0.5, -2.0)):
        assert np.linalg.norm(read(lanes, silent, Theta)) == pytest.approx(50e-6)


def test_hard_iron_shifts_the_sphere_and_soft_iron_makes_it_an_ellipsoid(
    lanes: Any, silent: Any
) -> None:
    A = np.array([[1.1, 0.05, 0], [0.02, 0.9, 0.01], [0, 0, 1.05]])
    b = np.array([8e-6, -5e-6, 12e-6])
    for Theta in ((0, 0, 1.0), (1.0, 0.5, -2.0)):
        field = read(lanes, silent, Theta)
        distorted = read(lanes, silent, Theta, soft_iron=A.ravel(), hard_iron=b)
        assert distorted == pytest.approx(A @ field + b, abs=1e-15)


def test_heading_of_a_level_hull_comes_back(lanes: Any, silent: Any) -> None:
    B = read(lanes, silent, (0, 0, 0.7))
    assert np.arctan2(-B[1], B[0]) == pytest.approx(0.7)


def test_a_strong_magnet_saturates_it(lanes: Any, silent: Any) -> None:
    B = read(lanes, silent, hard_iron=[2e-3, -2e-3, 0])
    assert B[:2] == pytest.approx([800e-6, -800e-6])
