"""Samples of a live system: one row at a time, as a node gets them."""

from __future__ import annotations

import numpy as np
import pytest

from tests.bridge.ros2.written import Rows, plan_of, written
from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.messages.conversions import sensor_figures

IMU = "sensor_msgs/msg/Imu"


def test_the_covariance_of_a_sensor_is_known_from_its_second_sample() -> None:
    plan, period = plan_of(imu="model:imu"), 0.01
    still = {"imu__gyro": [np.zeros(3)], "imu__acc": [np.zeros(3)], "imu__valid": [True]}
    blocks = [Rows([t], **still, imu__t_sample=[t]) for t in (0.0, period, 2 * period)]
    first, *later = (message for _, message in written(plan, IMU, *blocks))
    figures = sensor_figures(IMU, facts_of(plan)["imu"], period)
    assert figures["gyro"] > 0
    assert first.angular_velocity_covariance[0] == 0  # not known
    for message in later:
        assert message.angular_velocity_covariance[0] == pytest.approx(figures["gyro"] ** 2)
        assert message.linear_acceleration_covariance[8] == pytest.approx(figures["acc"] ** 2)
