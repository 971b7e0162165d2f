"""Messages as bytes: equal to those of rosbags, for every type that has a conversion."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.bridge.ros2.cdr import MessageLayout
from uuvsim_cosim.bridge.ros2.messages.conversions import CONVERSIONS, GENERIC
from uuvsim_cosim.bridge.ros2.topic_writer import DISTRIBUTIONS, typestore
from uuvsim_cosim.errors import InputInvalid

FURTHER = ("std_msgs/msg/String",)
TEXTS = {"header.frame_id": "map", "child_frame_id": "a/b", "name.1": "x", "status.2.message": "no"}
SEQUENCES = (
    "data",
    "transforms",
    "position",
    "velocity",
    "name",
    "fields",
    "status",
    "ranges",
    "flags",
    "beam_unit_vec",
    "transmit_delays",
    "d",
)


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("type_", [*CONVERSIONS, *dict.fromkeys(GENERIC.values()), *FURTHER])
def test_bytes_are_those_of_rosbags(distribution: str, type_: str) -> None:
    store = typestore(distribution)
    rng = np.random.default_rng(0)
    for texts, length in (({}, 0), (TEXTS, 3)):
        layout = MessageLayout(store, type_, texts, dict.fromkeys(SEQUENCES, length))
        columns = {name: rng.integers(0, 2, (4, layout.count(name))) for name in layout.fields}
        for row in layout.rows(4, columns):
            message = store.deserialize_cdr(row.tobytes(), type_)
            assert bytes(store.serialize_cdr(message, type_)) == row.tobytes()


def test_numbers_stand_in_the_fields_that_they_were_given_for() -> None:
    store = typestore("jazzy")
    layout = MessageLayout(store, "sensor_msgs/msg/Imu", {"header.frame_id": "imu_link"}, {})
    gyro = np.arange(6.0).reshape(2, 3)
    rows = layout.rows(2, {"angular_velocity": gyro, "header.stamp.sec": np.array([7, 8])})
    second = store.deserialize_cdr(rows[1].tobytes(), "sensor_msgs/msg/Imu")
    rate = second.angular_velocity
    assert (rate.x, rate.y, rate.z) == (3.0, 4.0, 5.0)
    assert second.header.stamp.sec == 8
    assert second.header.frame_id == "imu_link"


def test_a_field_that_is_not_there_is_refused_with_those_that_are() -> None:
    layout = MessageLayout(typestore("humble"), "sensor_msgs/msg/Range", {}, {})
    with pytest.raises(InputInvalid, match=r"no number 'variance'; expected .*field_of_view"):
        layout.rows(1, {"variance": np.zeros(1)})
    with pytest.raises(InputInvalid, match=r"message type 'a/msg/B'"):
        MessageLayout(typestore("humble"), "a/msg/B", {}, {})


def test_an_unknown_distribution_is_refused() -> None:
    with pytest.raises(InputInvalid, match="ROS 2 'foxy'; expected humble, jazzy"):
        typestore("foxy")
