"""Messages of a colour camera: its image, and how it projects points."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.bridge.ros2.facts import facts_of
from uuvsim_cosim.bridge.ros2.messages.conversions import CONVERSIONS
from uuvsim_cosim.bridge.ros2.robot import robots_of
from uuvsim_cosim.bridge.ros2.topics import topics_of, variables_of
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.running.library import load

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"


def plan(options: str = "") -> Plan:
    source = f"model:color_camera?columns=8&rows=6&scene=flat{options}"
    system = load("bluerov2_hold").add("camera", source)
    for signal in ("eta", "q"):
        system = system.connect(f"hull.{signal}", f"camera.{signal}")
    return flatten(system, loops="delay")


def types(p: Plan) -> set[str]:
    return {t.type for t in topics_of(variables_of(p), facts_of(p)) if t.component == "camera"}


def test_an_image_has_the_bytes_of_red_green_and_blue_row_by_row() -> None:
    facts = facts_of(plan())["camera"]
    levels = np.arange(144)[None]
    made, shape = CONVERSIONS[IMAGE].columns({"image": levels}, facts), CONVERSIONS[IMAGE].shape
    assert [int(made[n][0]) for n in ("height", "width", "step")] == [6, 8, 24]
    np.testing.assert_array_equal(made["data"], levels)
    assert made["data"].dtype == np.uint8
    assert shape is not None
    assert shape({}, facts).texts == {"encoding": "rgb8"}
    assert shape({}, facts).lengths == {"data": 144}


def test_camera_info_has_the_focal_length_and_the_distortion_of_the_camera() -> None:
    made = CONVERSIONS[INFO].columns({}, facts_of(plan())["camera"])
    k = made["k"].reshape(3, 3)
    assert k[0, 0] == k[1, 1] == pytest.approx(1144 * 8 / 1920)
    assert (k[0, 2], k[1, 2]) == (3.5, 2.5)  # the middle of the first pixel is at 0
    np.testing.assert_allclose(made["d"], [[-0.02, 0.0, 0.0, 0.0, 0.0]])


def test_both_are_published_in_the_optical_frame_and_no_info_behind_a_port() -> None:
    assert {IMAGE, INFO} <= types(plan())
    behind = types(plan("&port=true"))
    assert IMAGE in behind
    assert INFO not in behind
    (robot,) = robots_of(plan())
    assert any(part.name.endswith("camera_optical") for part in robot.parts)
