"""Inputs of a system from ROS 2: an independent Zenoh session publishes the commands."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

import uuvsim_cosim as uuv
from tests.bridge.ros2.ros_side import (
    STORE,
    Publisher,
    Said,
    header,
    made,
    pose,
    ros,
    tokens,
    twist,
    vector,
)
from tests.bridge.waiting import until
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.http.keyboard import source, with_keyboards
from uuvsim_cosim.bridge.http.manual_axes import manual_axes_of
from uuvsim_cosim.bridge.ros2.inputs import Input, inputs_of, read_inputs
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.ros2.receiver import system_of
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.resolve import register

ME = Client("me", "local")
TWIST = "geometry_msgs/msg/Twist"
TWIST_STAMPED = "geometry_msgs/msg/TwistStamped"
WRENCH = "geometry_msgs/msg/Wrench"
POSE = "geometry_msgs/msg/PoseStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
NUMBERS = "std_msgs/msg/Float64MultiArray"
VELOCITY = ("{{topic: /vel, type: geometry_msgs/msg/TwistStamped, frame: base_link, "
            "timeout: {}, signals: {{nu: controller.nu_d}}}}")  # fmt: skip


@pytest.fixture(scope="module")
def system() -> uuv.System:
    """Return a vehicle whose controller waits for set-points."""
    return uuv.load("bluerov2_hold").remove("guidance")


@pytest.fixture
def conductor(system: uuv.System) -> Iterator[Conductor]:
    with Conductor(system) as made_:
        yield made_


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file of topics whose commands last for a minute of wall-clock time."""
    return written(tmp_path, VELOCITY.format(60))


def written(folder: Path, *inputs: str) -> Path:
    file = folder / "topics.yaml"
    lines = "".join(f"  - {one}\n" for one in inputs)
    file.write_text(f"topics: []\ninputs:{' []' * (not inputs)}\n{lines}")
    return file


@contextmanager
def node_of(
    conductor: Conductor, topics: Path | None = None, **options: Any
) -> Iterator[tuple[Ros2Node, zenoh.Session, Said]]:
    said = Said()
    with (
        Ros2Node(conductor, topics=topics, domain=0, port=0, report=said, **options) as node,
        ros(node.port) as peer,
    ):
        yield node, peer, said


def has(conductor: Conductor, name: str, expected: list[float]) -> bool:
    return np.allclose(conductor.get(ME, [name])[name], expected, atol=1e-9)


def gives(conductor: Conductor, name: str, expected: list[float], publish: Any) -> None:
    """Publish until a signal has values; the subscription may be new to the publisher."""
    until(lambda: has(conductor, name, expected), publish)


def test_a_twist_pilots_the_vehicle_in_the_place_of_the_keyboard() -> None:
    swaps = {"pilot": "keyboard"}
    with_keyboards(lambda: uuv.load("bluerov2_hold"), swaps)
    [(path, source)] = swaps.items()
    piloted = uuv.load("bluerov2_hold").replace(path, source)
    with Conductor(piloted) as conductor, node_of(conductor) as (node, peer, _):
        assert [(i.name, i.type) for i in node.inputs] == [("/cmd_vel", TWIST)]
        publisher = Publisher(peer, "/cmd_vel", TWIST)
        # half of 0.5 m/s ahead, all of 0.3 m/s to port, 0.6 rad/s to port
        command = twist((0.25, 0.3, 0.0), (0.0, 0.0, 0.6))
        axes = manual_axes_of(path)
        until(lambda: axes.now() == (0.5, -1.0, 0.0, -1.0), lambda: publisher.put(command))
        conductor.step(ME, 50, {}, ())
        u, v, *_, r = conductor.get(ME, [f"{path}.nu_d"])[f"{path}.nu_d"]
        assert u > 0.0 > max(v, r)
    assert axes.now() == (0.0, 0.0, 0.0, 0.0)


def test_a_twist_takes_part_in_the_inputs_of_another_pilot() -> None:
    swaps = {"pilot": "keyboard"}
    with_keyboards(lambda: uuv.load("pool_tracking"), swaps)
    [(path, source_)] = swaps.items()
    piloted = uuv.load("pool_tracking").replace(path, source_)
    with Conductor(piloted) as conductor, node_of(conductor) as (_, peer, _):
        publisher = Publisher(peer, "/cmd_vel", TWIST)
        command = twist((0.15, 0.3, 0.3), (0.0, 0.0, -0.75))
        axes = manual_axes_of(path)
        until(lambda: axes.now() == (0.5, 0.0, 0.0, 0.5), lambda: publisher.put(command))


def test_a_command_arrives_between_the_steps_of_a_run(conductor: Conductor) -> None:
    conductor.run(ME, factor=10.0)
    with node_of(conductor) as (_, peer, said):
        publisher = Publisher(peer, "/controller/cmd_vel", TWIST)
        command = twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
              lambda: publisher.put(command))  # fmt: skip
        assert conductor.moment().running
        assert "no message for 0.5 s" in said.next()


def test_humble_has_inputs_without_hashes(conductor: Conductor) -> None:
    with node_of(conductor, distribution="humble") as (_, peer, _):
        publisher = Publisher(peer, "/controller/cmd_vel", TWIST, "TypeHashNotSupported")
        command = twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
              lambda: publisher.put(command))  # fmt: skip


def test_commands_arrive_in_ned_and_frd(conductor: Conductor) -> None:
    half = np.sqrt(0.5)
    with node_of(conductor) as (node, peer, said):
        assert {i.name for i in node.inputs} == {
            "/controller/cmd_pose", "/controller/cmd_vel", "/controller/cmd_odometry",
        }  # fmt: skip
        velocity = Publisher(peer, "/controller/cmd_vel", TWIST)
        command = twist((1.0, 2.0, 3.0), (0.1, 0.2, 0.3))
        gives(conductor, "controller.nu_d", [1.0, -2.0, -3.0, 0.1, -0.2, -0.3],
              lambda: velocity.put(command))  # fmt: skip
        goal = Publisher(peer, "/controller/cmd_pose", POSE)
        # 4 m east, 5 m north, 6 m deep; the bow to the north is yaw 90 degrees in ENU
        at = made(POSE, header=header("map"), pose=pose((4.0, 5.0, -6.0), (0.0, 0.0, half, half)))
        gives(conductor, "controller.eta_d", [5.0, 4.0, 6.0, 0.0, 0.0, 0.0],
              lambda: goal.put(at))  # fmt: skip
        both = Publisher(peer, "/controller/cmd_odometry", ODOMETRY)
        state = made(
            ODOMETRY,
            header=header("map"),
            child_frame_id="base_link",
            pose=made("geometry_msgs/msg/PoseWithCovariance",
                      pose=pose((1.0, 2.0, -3.0), (0.0, 0.0, 0.0, 1.0))),
            twist=made("geometry_msgs/msg/TwistWithCovariance",
                       twist=twist((0.0, 0.5, 0.0), (0.0, 0.0, 0.0))),
        )  # fmt: skip
        gives(conductor, "controller.eta_d", [2.0, 1.0, 3.0, 0.0, 0.0, np.pi / 2],
              lambda: both.put(state))  # fmt: skip
        gives(conductor, "controller.nu_d", [0.0, -0.5, 0.0, 0.0, 0.0, 0.0],
              lambda: both.put(state))  # fmt: skip
    assert [t for t in said.texts if "no message for" not in t] == []


def test_the_vehicle_goes_to_a_pose_that_ros_sends_once(conductor: Conductor) -> None:
    half = np.sqrt(0.5)
    with node_of(conductor) as (_, peer, said):
        goal = Publisher(peer, "/controller/cmd_pose", POSE)
        at = made(POSE, header=header("map"), pose=pose((2.0, 3.0, -4.0), (0.0, 0.0, half, half)))
        gives(conductor, "controller.eta_d", [3.0, 2.0, 4.0, 0.0, 0.0, 0.0],
              lambda: goal.put(at))  # fmt: skip
        assert said.next().endswith("fail-safe: controller.eta_d keeps its value")
        conductor.step(ME, 6000, {}, ())
    assert conductor.get(ME, ["hull.eta"])["hull.eta"][:3] == pytest.approx([3, 2, 4], abs=0.1)


def test_inputs_follow_a_component_that_was_replaced() -> None:
    with Conductor("bluerov2_hold") as conductor, node_of(conductor) as (node, peer, _):
        assert node.inputs == []
        register("keyboard", source)
        conductor.replace(ME, "guidance", "keyboard:")
        until(lambda: [i.name for i in node.inputs] == ["/cmd_vel"], conductor.moment)
        until(lambda: any("%cmd_vel" in t for t in tokens(peer)), conductor.moment)


def test_a_closed_node_ends_the_command_that_it_gave(conductor: Conductor) -> None:
    with node_of(conductor) as (_, peer, _):
        publisher = Publisher(peer, "/controller/cmd_vel", TWIST)
        command = twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
              lambda: publisher.put(command))  # fmt: skip
    assert conductor.get(ME, ["controller.nu_d"])["controller.nu_d"][0] == 0.0


def test_forces_and_thruster_commands_set_open_inputs() -> None:
    open_ = uuv.load("bluerov2_hold").remove("controller").remove("allocation")
    with Conductor(open_) as conductor, node_of(conductor) as (node, peer, _):
        [thrusters] = [i for i in node.inputs if i.name == "/cmd_thrusters"]
        assert thrusters.signals["data"] == tuple(f"thruster_{k}.u" for k in range(1, 9))
        publisher = Publisher(peer, "/cmd_thrusters", NUMBERS)
        command = made(NUMBERS, data=np.linspace(-0.4, 0.3, 8))
        ends = {"thruster_1.u": -0.4, "thruster_8.u": 0.3}  # together: they last for 0.5 s
        until(lambda: conductor.get(ME, list(ends)) == ends, lambda: publisher.put(command))
    with Conductor("bluerov2_task") as conductor, node_of(conductor) as (_, peer, _):
        wrench = Publisher(peer, "/allocation/cmd_wrench", WRENCH)
        command = made(WRENCH, force=vector(10.0, 20.0, 30.0), torque=vector(1.0, 2.0, 3.0))
        gives(conductor, "allocation.tau_d", [10.0, -20.0, -30.0, 1.0, -2.0, -3.0],
              lambda: wrench.put(command))  # fmt: skip


def test_a_subscription_has_a_token(conductor: Conductor) -> None:
    with node_of(conductor) as (_, peer, _):
        [token] = [t for t in tokens(peer) if "%cmd_vel" in t]
    hash_ = STORE.hash_rihs01(TWIST)
    assert token.split("/")[5:] == ["MS", "%", "%", "bluerov2_hold", "%controller%cmd_vel",
                                    "geometry_msgs::msg::dds_::Twist_", hash_,
                                    "::,10:,:,:,,"]  # fmt: skip


def test_a_command_that_stops_coming_is_replaced_by_its_start_value(
    conductor: Conductor, tmp_path: Path
) -> None:
    start = conductor.get(ME, ["controller.nu_d"])["controller.nu_d"].tolist()
    with node_of(conductor, written(tmp_path, VELOCITY.format(0.5))) as (_, peer, said):
        publisher = Publisher(peer, "/vel", TWIST_STAMPED)
        command = made(TWIST_STAMPED, twist=twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        for _ in range(2):  # each loss is reported
            reported = len(said.texts)
            gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
                  lambda: publisher.put(command))  # fmt: skip
            # The last messages may be under way for longer than commands last.
            until(lambda: has(conductor, "controller.nu_d", start))
            until(lambda: len(said.texts) > reported)  # noqa: B023
        for text in said.texts:
            assert text.startswith("/vel: no message for 0.5 s, at t = 0 s")
            assert text.endswith("fail-safe: controller.nu_d gets its start value")


def test_a_file_chooses_the_fail_safe(conductor: Conductor, tmp_path: Path) -> None:
    one = ("{topic: /goal, type: nav_msgs/msg/Odometry, timeout: 0.5, frame: map, "
           "signals: {eta: controller.eta_d, nu: controller.nu_d}, "
           "fail_safe: {nu: [0.1, 0, 0, 0, 0, 0]}}")  # fmt: skip
    with node_of(conductor, written(tmp_path, one)) as (_, peer, said):
        goal = Publisher(peer, "/goal", ODOMETRY)
        state = made(ODOMETRY, pose=made(
            "geometry_msgs/msg/PoseWithCovariance",
            pose=pose((1.0, 2.0, -3.0), (0.0, 0.0, 0.0, 1.0))))  # fmt: skip
        gives(conductor, "controller.eta_d", [2.0, 1.0, 3.0, 0.0, 0.0, np.pi / 2],
              lambda: goal.put(state))  # fmt: skip
        text = said.next()
    assert "controller.eta_d keeps its value; controller.nu_d = [0.1, 0.0" in text
    values = conductor.get(ME, ["controller.eta_d", "controller.nu_d"])
    assert values["controller.eta_d"][0] == pytest.approx(2.0)
    assert values["controller.nu_d"].tolist() == [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]


FAULTS: dict[str, tuple[Any, str]] = {
    "nan": (made(TWIST_STAMPED, twist=twist((np.nan, 0.0, 0.0), (0.0, 0.0, 0.0))),
            "expected finite numbers"),
    "frame": (made(TWIST_STAMPED, header=header("odom")),
              "header.frame_id 'odom'; expected 'base_link', or none"),
    "stamp": (made(TWIST_STAMPED, header=header("", 1000.0)),
              "header.stamp 1000 s; expected one within 60 s of the simulated time, 0 s, or of"),
    "truncated": (b"\x00\x01\x00\x00\x01\x02", "6 bytes that are no geometry_msgs/msg/Twist"),
    "none": (b"", "0 bytes that are no geometry_msgs/msg/TwistStamped"),
    "large": (bytes(1 << 17), "a message of 131072 bytes; expected at most 65536"),
}  # fmt: skip


@pytest.mark.parametrize("fault", FAULTS)
def test_a_message_that_cannot_be_used_is_reported_once_and_ignored(
    conductor: Conductor, file: Path, fault: str
) -> None:
    bad, words = FAULTS[fault]
    data = bad if isinstance(bad, bytes) else bytes(STORE.serialize_cdr(bad, TWIST_STAMPED))
    with node_of(conductor, file) as (_, peer, said):
        publisher = Publisher(peer, "/vel", TWIST_STAMPED)
        until(lambda: bool(said.texts), lambda: publisher.put_bytes(data))
        assert conductor.get(ME, ["controller.nu_d"])["controller.nu_d"][0] == 0.0
        for _ in range(3):
            publisher.put_bytes(data)
        good = made(TWIST_STAMPED, header=header("base_link", time.time()),
                    twist=twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))  # fmt: skip
        gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
              lambda: publisher.put(good))  # fmt: skip
        assert len(said.texts) == 1
        assert words in said.texts[0]


def test_a_time_stamp_of_the_simulated_time_is_accepted(conductor: Conductor, file: Path) -> None:
    conductor.step(ME, 500, {}, ())
    with node_of(conductor, file) as (_, peer, said):
        publisher = Publisher(peer, "/vel", TWIST_STAMPED)
        command = made(TWIST_STAMPED, header=header("", 4.9),
                       twist=twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))  # fmt: skip
        gives(conductor, "controller.nu_d", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0],
              lambda: publisher.put(command))  # fmt: skip
    assert said.texts == []


def test_messages_of_another_distribution_are_reported_with_both_hashes(
    conductor: Conductor, file: Path
) -> None:
    with node_of(conductor, file) as (_, peer, said):
        publisher = Publisher(peer, "/vel", TWIST_STAMPED, "RIHS01_0")
        command = made(TWIST_STAMPED, twist=twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        until(lambda: bool(said.texts), lambda: publisher.put(command))
        assert conductor.get(ME, ["controller.nu_d"])["controller.nu_d"][0] == 0.0
    [text] = said.texts
    assert "hash RIHS01_0; expected geometry_msgs::msg::dds_::TwistStamped_, hash RIHS01_" in text
    assert STORE.hash_rihs01(TWIST_STAMPED) in text


def test_no_unit_quaternion_is_refused(conductor: Conductor) -> None:
    with node_of(conductor) as (_, peer, said):
        publisher = Publisher(peer, "/controller/cmd_pose", POSE)
        until(lambda: bool(said.texts), lambda: publisher.put(made(POSE)))
    assert "an orientation of norm 0; expected a unit quaternion" in said.texts[0]


def test_a_value_that_the_system_refuses_is_reported(tmp_path: Path) -> None:
    one = ("{topic: /health, type: std_msgs/msg/Float64MultiArray, "
           "signals: {data: allocation.health}}")  # fmt: skip
    with (
        Conductor("bluerov2_hold") as conductor,
        node_of(conductor, written(tmp_path, one)) as (_, peer, said),
    ):
        publisher = Publisher(peer, "/health", NUMBERS)
        command = made(NUMBERS, data=np.ones(3))
        until(lambda: bool(said.texts), lambda: publisher.put(command))
    assert said.texts[0].startswith("/health: data has 3 elements; expected 8")


def test_a_flood_is_reported_once_and_delays_no_step(conductor: Conductor, file: Path) -> None:
    with node_of(conductor, file) as (_, peer, said):
        publisher = Publisher(peer, "/vel", TWIST_STAMPED)
        command = made(TWIST_STAMPED, twist=twist((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)))
        data = bytes(STORE.serialize_cdr(command, TWIST_STAMPED))

        def flood() -> None:
            for _ in range(200):
                publisher.put_bytes(data)

        until(lambda: any("messages per second" in text for text in said.texts), flood)
        moment, _ = conductor.step(ME, 10, {}, ())
        assert moment.time == pytest.approx(0.1)
    [text] = [t for t in said.texts if "messages per second" in t]
    assert "expected at most 200, of which the newest are used" in text


def test_a_topic_that_lost_its_signal_to_another_does_not_touch_it(
    conductor: Conductor, tmp_path: Path
) -> None:
    inputs = [
        f"{{topic: /{name}, type: geometry_msgs/msg/Twist, timeout: {timeout}, "
        "signals: {nu: controller.nu_d}}"
        for name, timeout in (("a", 0.5), ("b", 60))
    ]
    with node_of(conductor, written(tmp_path, *inputs)) as (_, peer, said):
        first, second = Publisher(peer, "/a", TWIST), Publisher(peer, "/b", TWIST)
        # /a may still have a message when /b is first used, and has none when it is used again
        for publisher, u in ((first, 1.0), (second, 2.0), (second, 3.0), (second, 4.0)):
            message = twist((u, 0.0, 0.0), (0.0, 0.0, 0.0))
            gives(conductor, "controller.nu_d", [u] + [0.0] * 5, partial(publisher.put, message))
        assert said.next().startswith("/a: no message for 0.5 s")
        assert conductor.get(ME, ["controller.nu_d"])["controller.nu_d"][0] == 4.0


def test_without_commands_nothing_listens(conductor: Conductor) -> None:
    with node_of(conductor, commands=False) as (node, peer, _):
        assert (node.inputs, node.services) == ([], {})
        assert {t.split("/")[5] for t in tokens(peer)} == {"NN", "MP"}


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_e}",
         ":3: /x: no signal 'controller.nu_e'; expected one such as controller.nu_d"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: hull.tau}",
         "hull.tau cannot be set; expected an unconnected input or a tunable parameter"),
        ("type: geometry_msgs/msg/Twist, signals: {tau: controller.nu_d}",
         "signals tau; expected nu or axes"),
        ("type: geometry_msgs/msg/Twist, signals: {axes: hull}",
         "axes: hull is no component that a person pilots; expected `--replace pilot=keyboard`"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: allocation.health}",
         "nu: allocation.health has 8 elements; expected 6"),
        ("type: sensor_msgs/msg/Imu, signals: {nu: controller.nu_d}",
         "type sensor_msgs/msg/Imu; expected one of geometry_msgs/msg/Twist, "),
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}, fail_safe: {nu: [1, 2]}",
         "fail_safe of nu has 2 numbers; expected 6"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}, fail_safe: {eta: keep}",
         "fail_safe of eta; expected one of nu"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}, timeout: 0", "timeout"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}, rate: 2",
         "timeout 0.5 s at rate 2; expected two periods or more"),
        ("type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}, fail_safe: {nu: off}",
         "fail_safe"),
    ],
)  # fmt: skip
def test_a_mistake_in_inputs_is_reported_with_its_line(
    conductor: Conductor, tmp_path: Path, entry: str, words: str
) -> None:
    full = f"{{topic: /x, {entry}}}"
    file = written(tmp_path, full)
    with pytest.raises(InputInvalid) as caught:
        read_inputs(file, system_of(conductor))
    assert words in str(caught.value)


def test_an_output_is_no_input(conductor: Conductor, tmp_path: Path) -> None:
    entry = "type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_d}"
    file = written(tmp_path, f"{{topic: /x, {entry}}}", f"{{topic: /x, {entry}}}")
    with pytest.raises(InputInvalid) as caught:
        read_inputs(file, system_of(conductor, ("/x",)))
    assert ":3: /x: is a topic that this node publishes" in str(caught.value)
    assert ":4: /x: is an input above" in str(caught.value)


def test_without_a_section_of_inputs_the_rules_choose(conductor: Conductor, tmp_path: Path) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text("topics: []\n")
    system = system_of(conductor)
    assert read_inputs(file, system) == inputs_of(system)
    assert read_inputs(written(tmp_path), system) == []


def test_parts_of_a_nested_vehicle_have_topics_below_its_name(system: uuv.System) -> None:
    both = uuv.System("both", "0.01").add("boat", system)
    with Conductor(both) as conductor:
        found = {i.name: i for i in inputs_of(system_of(conductor))}
    assert found["/boat/controller/cmd_vel"] == Input(
        "/boat/controller/cmd_vel", TWIST, {"nu": ("boat.controller.nu_d",)}, "boat/base_link",
        "boat/base_link",
    )  # fmt: skip
