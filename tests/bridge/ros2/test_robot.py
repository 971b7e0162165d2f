"""Vehicles as ROS sees them: frames of the parts, and URDF texts."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.bridge.ros2.test_frames import matrix
from tests.bridge.ros2.written import STORE, plan_of, topics_of_plan
from uuvsim_cosim.bridge.ros2.robot import Robot, mounted, robots_of, text_message
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.orchestrator.shipped.of_vehicle import system_of


@pytest.fixture(scope="module")
def heavy() -> Robot:
    [robot] = robots_of(flatten(load("bluerov2_survey")))
    return robot


def rpy_matrix(text: str) -> np.ndarray:
    r, p, y = (float(x) for x in text.split())
    (cr, cp, cy), (sr, sp, sy) = np.cos([r, p, y]), np.sin([r, p, y])
    x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    return z @ about_y @ x


def joints(robot: Robot) -> dict[str, Any]:
    return {j.find("child").get("link"): j for j in ET.fromstring(robot.urdf).iter("joint")}  # type: ignore[union-attr,misc]


def test_each_thruster_points_along_its_thrust_from_its_place(heavy: Robot) -> None:
    geometry, found = thruster_geometry("bluerov2_heavy"), joints(heavy)
    for i, (r, e) in enumerate(zip(geometry.r, geometry.e, strict=True), 1):
        origin = found[f"thruster_{i}_link"].find("origin")
        assert [float(x) for x in origin.get("xyz").split()] == pytest.approx(r * [1, -1, -1])
        ahead = rpy_matrix(origin.get("rpy"))[:, 0]
        assert ahead == pytest.approx(e * [1, -1, -1], abs=1e-8)


def test_links_and_joints_are_a_tree_below_base_link(heavy: Robot) -> None:
    root = ET.fromstring(heavy.urdf)
    links = [link.get("name") for link in root.iter("link")]
    assert len(links) == len(set(links))
    above = {j.find("child").get("link"): j.find("parent").get("link") for j in root.iter("joint")}  # type: ignore[union-attr]
    assert set(links) - above.keys() == {"base_link"}
    for name in above:
        at: str | None = name
        while at in above:
            at = above[at]
        assert at == "base_link"
    [box] = list(root.find("link").iter("box"))  # type: ignore[union-attr]
    assert box.get("size") == "0.457 0.575 0.254"


def test_each_frame_of_a_sonars_messages_is_placed() -> None:
    plan = plan_of(sonar="model:multibeam?beams=5", hull="model:bluerov2_heavy")
    topics = topics_of_plan(plan)
    [robot] = robots_of(plan)
    message = STORE.deserialize_cdr(
        mounted(STORE, topics, [robot]).tobytes(), "tf2_msgs/msg/TFMessage"
    )
    placed = {tf.child_frame_id for tf in message.transforms}
    assert {t.frame for t in topics if t.frame.startswith("sonar_")} <= placed


def test_the_description_and_tf_static_agree(heavy: Robot) -> None:
    plan = flatten(load("bluerov2_survey"))
    message = STORE.deserialize_cdr(
        mounted(STORE, topics_of_plan(plan), [heavy]).tobytes(), "tf2_msgs/msg/TFMessage"
    )
    found = joints(heavy)
    assert {tf.child_frame_id for tf in message.transforms} == found.keys()
    for tf in message.transforms:
        origin, q = found[tf.child_frame_id].find("origin"), tf.transform.rotation
        assert rpy_matrix(origin.get("rpy")) == pytest.approx(
            matrix(np.array([q.x, q.y, q.z, q.w])), abs=1e-8
        )


def test_fins_are_joints_whose_names_are_in_the_joint_states() -> None:
    [robot] = robots_of(flatten(system_of("remus100", "hold")))
    revolute = [j for j in ET.fromstring(robot.urdf).iter("joint") if j.get("type") == "revolute"]
    assert [j.get("name") for j in revolute] == ["fins_1", "fins_2", "fins_3", "fins_4"]
    for joint in revolute[:2]:  # rudders: the hinge is down
        hinge = rpy_matrix(joint.find("origin").get("rpy")) @ [0, 0, 1]  # type: ignore[union-attr]
        assert hinge == pytest.approx([0, 0, -1], abs=1e-8)
    assert float(revolute[0].find("limit").get("upper")) == pytest.approx(0.2373648)  # type: ignore[union-attr]
    assert {p.name for p in robot.parts if p.kind == "thruster"} == {"propeller_link"}


def test_each_vehicle_has_a_description_of_its_own() -> None:
    robots = robots_of(flatten(load("pool_tracking")))
    assert [r.topic for r in robots] == ["/quarry/robot_description", "/robot_description"]
    assert all(p.name.startswith("quarry/") for p in robots[0].parts)
    text = text_message(STORE, robots[0].urdf)
    assert STORE.deserialize_cdr(text.tobytes(), "std_msgs/msg/String").data == robots[0].urdf


def test_a_hull_of_unknown_size_has_no_picture() -> None:
    assert "<visual>" not in Robot("", None, ()).urdf


def test_a_boat_without_a_folder_is_described_by_its_hull_alone() -> None:
    plan = flatten(uuv.System("boat", "0.1").add("hull", "model:sphere"))
    [robot] = robots_of(plan)
    assert 'radius="' in robot.urdf
    assert robot.parts == ()
