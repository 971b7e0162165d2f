"""Frames of ROS: ENU and FLU, from NED and FRD."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.bridge.ros2.frames import (
    body,
    body_quaternion,
    euler_angles,
    euler_quaternion,
    from_quaternion,
    quaternion,
    world,
)

angle = st.floats(-3.1, 3.1)


def matrix(q: np.ndarray) -> np.ndarray:
    """Return the rotation of a quaternion x y z w."""
    x, y, z, w = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize(
    ("heading", "east", "north"), [(0.0, 0.0, 1.0), (90.0, 1.0, 0.0), (180.0, 0.0, -1.0)]
)
def test_a_vehicle_that_heads_north_has_its_x_axis_along_the_second_axis(
    heading: float, east: float, north: float
) -> None:
    q = quaternion(euler_quaternion(np.radians([[0.0, 0.0, heading]])))[0]
    ahead = matrix(q) @ [1.0, 0.0, 0.0]
    assert ahead == pytest.approx([east, north, 0.0], abs=1e-12)
    assert matrix(q) @ [0.0, 0.0, 1.0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)  # z is up


def test_a_bow_that_is_up_points_up() -> None:
    q = quaternion(euler_quaternion(np.radians([[0.0, 30.0, 0.0]])))[0]
    assert (matrix(q) @ [1.0, 0.0, 0.0])[2] == pytest.approx(0.5)


@given(angle, st.floats(-1.5, 1.5), angle, st.tuples(angle, angle, angle))
def test_a_vector_turned_before_and_after_the_change_of_frames_is_the_same(
    phi: float, theta: float, psi: float, v: tuple[float, float, float]
) -> None:
    q = euler_quaternion(np.array([[phi, theta, psi]]))
    in_ned = matrix(q[0, [1, 2, 3, 0]]) @ v
    in_enu = matrix(quaternion(q)[0]) @ body(np.array([v]))[0]
    assert world(in_ned.reshape(1, 3))[0] == pytest.approx(in_enu, abs=1e-12)
    between = matrix(body_quaternion(q)[0]) @ body(np.array([v]))[0]
    assert body(in_ned.reshape(1, 3))[0] == pytest.approx(between, abs=1e-12)


@given(angle, st.floats(-1.5, 1.5), angle)
def test_an_orientation_that_goes_to_ros_and_back_is_the_same(
    phi: float, theta: float, psi: float
) -> None:
    angles = np.array([[phi, theta, psi]])
    back = euler_angles(from_quaternion(quaternion(euler_quaternion(angles))))
    assert back == pytest.approx(angles, abs=1e-9)


@pytest.mark.parametrize(
    ("q", "angles"),
    [
        ((0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 90.0)),  # x to the east
        ((0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)), (0.0, 0.0, 0.0)),  # x to the north
        ((0.0, np.sin(np.pi / 12), 0.0, np.cos(np.pi / 12)), (0.0, -30.0, 90.0)),  # the bow down
        ((np.sin(np.pi / 12), 0.0, 0.0, np.cos(np.pi / 12)), (30.0, 0.0, 90.0)),  # port side up
    ],
)
def test_orientations_of_ros_have_these_angles(
    q: tuple[float, ...], angles: tuple[float, ...]
) -> None:
    found = np.degrees(euler_angles(from_quaternion(np.array([q]))))[0]
    assert found == pytest.approx(angles, abs=1e-9)


def test_vectors_that_go_to_ros_and_back_are_the_same() -> None:
    v = np.array([[1.0, 2.0, 3.0]])
    assert world(world(v)).tolist() == body(body(v)).tolist() == v.tolist()
