"""Bags of ROS: frames, the choice of topics, channels of the user, and bad input."""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

import uuvsim_cosim as uuv
from tests.studies.identification.readers.ardusub_logs import PWM, ROV
from tests.studies.identification.readers.bag_files import (
    bag,
    commands,
    depth,
    imu,
    numbers,
    odometry,
    outputs,
    px4,
    state,
    wrench,
)
from tests.studies.identification.readers.ulog_files import HEAVY_ROTORS, MOTORS
from uuvsim_cosim.bridge.autopilots.px4 import thruster_commands
from uuvsim_cosim.bridge.ros2.bag import write_bag
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.identify import identify
from uuvsim_cosim.studies.identification.logs import read_log
from uuvsim_cosim.studies.identification.readers.channels import read_channels

U = [0.5, -0.5, 0.2, 0.1, 0.0, 0.3]


def mean(values: Any) -> list[float]:
    columns = np.asarray(values).T
    return [float(np.sum(c[np.isfinite(c)]) / max(np.isfinite(c).sum(), 1)) for c in columns]


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_odometry_and_wrench_become_ned_and_frd(plugin: StoragePlugin, tmp_path: Path) -> None:
    folder = bag(tmp_path / "b", odometry(), wrench(), plugin=plugin)
    (file,) = (*folder.glob("*.mcap"), *folder.glob("*.db3"))
    for path in (folder, file):
        signals = read_log(path)
        assert mean(signals["eta"]) == pytest.approx([2, 2.95, 5, 0.1, 0, pi / 2], abs=1e-6)
        assert mean(signals["nu"]) == pytest.approx([1, -0.2, -0.1, 0.01, 0.02, 0.03])
        assert mean(signals["tau"]) == pytest.approx([10, -2, -3, 0.1, -0.2, -0.3])
        assert signals.metadata["excluded"] == ()


def test_a_dive_as_a_bag_gives_the_same_fit_as_its_recording(tmp_path: Path) -> None:
    system = uuv.load("bluerov2_hold").set("hull.eta_0", [0, 0, 5, 0, 0, 0])
    folder = uuv.run(system, until=4.0, out=tmp_path / "dive", backend="native").folder
    write_bag(folder, tmp_path / "bag")
    chosen = read_channels(["tau=/wrench/wrench"])
    read = read_log(tmp_path / "bag", None, chosen)
    fits = [
        identify(signals, of, ["D_q_11", "M_A_11"], step=0.05, proposals=False)
        for signals, of in ((folder, system), (read, "model:bluerov2_heavy"))
    ]
    for one, other in zip(fits[0].numbers, fits[1].numbers, strict=True):
        assert other.value == pytest.approx(one.value, rel=1e-6)


def test_a_gyroscope_is_preferred_for_rates_and_the_choice_is_reported(tmp_path: Path) -> None:
    signals = read_log(bag(tmp_path / "b", odometry(), imu(), commands(U)))
    assert mean(signals["u"]) == pytest.approx(U)
    assert mean(signals["nu"])[3:] == pytest.approx([0.1, 0.2, 0.3])
    assert mean(signals["eta"])[5] == pytest.approx(pi / 2)  # the odometry's, not the compass'
    text = "; ".join(signals.metadata["remarks"])
    assert "rates is /imu/data (not /odom)" in text
    assert "does not state when the vehicle was armed" in text


def test_a_raw_imu_has_no_attitude(tmp_path: Path) -> None:
    raw = imu("/imu/raw", oriented=False)
    oriented = read_log(bag(tmp_path / "b", imu(), commands(U)))
    assert mean(oriented["eta"])[3:] == pytest.approx([0.0, 0.0, 0.0], abs=1e-6)
    with pytest.raises(InputInvalid, match="2 topics give the rates: /imu/data, /imu/raw"):
        read_log(bag(tmp_path / "c", imu(), raw, commands(U)))
    chosen = read_log(tmp_path / "c", None, read_channels(["rates=/imu/raw"]))
    assert np.isfinite(chosen["eta"][:, 5]).sum() == 60  # of the other one


def test_two_vehicles_in_a_bag_are_refused_by_the_names_of_their_topics(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", odometry("/rov1/odom"), odometry("/rov2/odom"), commands(U))
    with pytest.raises(
        InputInvalid,
        match=r"2 topics give the position: /rov1/odom, /rov2/odom; expected a bag of one vehicle",
    ):
        read_log(path)


def test_outputs_of_mavros_need_the_parameters_of_the_autopilot(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", odometry(), outputs(PWM), state(armed=True))
    with pytest.raises(InputInvalid, match=r"lacks the parameters FRAME_CONFIG, SERVO1_FUNCTION"):
        read_log(path)
    signals = read_log(path, ROV)
    assert mean(signals["u"]) == pytest.approx([1.0, -1.0, -0.5, -0.5, 0.0, -0.25])
    assert signals.metadata["vehicle"] == "bluerov2"
    with pytest.raises(InputInvalid, match=r"FRAME_CLASS, a parameter of ArduCopter"):
        read_log(path, {"FRAME_CLASS": 1.0})
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 5.9 s: disarmed"):
        read_log(bag(tmp_path / "c", odometry(), outputs(PWM), state(armed=False)), ROV)


def test_topics_of_px4_are_read_as_in_its_logs(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", px4(MOTORS))
    with pytest.raises(InputInvalid, match=r"lacks the parameters CA_ROTOR0_PX"):
        read_log(path)
    signals = read_log(path, HEAVY_ROTORS)
    assert mean(signals["u"]) == pytest.approx(thruster_commands(MOTORS).tolist())
    assert signals.metadata["vehicle"] == "bluerov2_heavy"
    assert mean(signals["eta"]) == pytest.approx([0, 0, 5, 0, 0, 0], abs=1e-6)
    with pytest.raises(InputInvalid, match=r"vehicle type 2 \(MAV_TYPE\); expected a submarine"):
        read_log(bag(tmp_path / "c", px4(MOTORS, kind=2)), HEAVY_ROTORS)


def test_channels_assign_topics_fields_units_and_frames(tmp_path: Path) -> None:
    path = bag(
        tmp_path / "b", numbers("/ahrs", [0.0, 5.0, 90.0]), numbers("/pwm", [1900, 1300]),
        depth(7.0), imu(oriented=False),
    )  # fmt: skip
    file = tmp_path / "channels.yaml"
    file.write_text("attitude: /ahrs:data?unit=deg&frame=ned\ndepth: /bar30/depth\n")
    channels = read_channels([str(file), "u=/pwm:data?factor=0.0025&offset=-3.75"])
    signals = read_log(path, None, channels)
    assert mean(signals["eta"])[2:] == pytest.approx([7.0, 0.0, pi / 36, pi / 2])
    assert mean(signals["u"]) == pytest.approx([1.0, -0.5])
    # In the frames of ROS, pitch and yaw have other signs and another zero.
    ros = read_channels(["attitude=/ahrs:data?unit=deg", "u=/pwm?factor=0.0025&offset=-3.75"])
    assert mean(read_log(path, None, ros)["eta"])[3:] == pytest.approx([0, -pi / 36, 0], abs=1e-9)


def test_angles_in_degrees_are_refused(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", numbers("/ahrs", [0.0, 5.0, 90.0]), commands(U))
    with pytest.raises(InputInvalid, match=r"pitch reaches 5 at .* as if it were in degrees"):
        read_log(path, None, read_channels(["attitude=/ahrs?frame=ned"]))


def test_a_bag_without_commands_lists_its_topics(tmp_path: Path) -> None:
    path = bag(tmp_path / "b", odometry(), numbers("/motors", [1.0]))
    with pytest.raises(
        InputInvalid, match=r"lacks the thrusters' commands \(--channel u=.*not read: /motors"
    ):
        read_log(path)


def test_parts_at_the_surface_are_left_out_by_the_depth_alone(tmp_path: Path) -> None:
    assert read_log(bag(tmp_path / "a", odometry(), commands(U))).metadata["excluded"] == ()
    with pytest.raises(InputInvalid, match=r"no part to fit: 0.0 to 5.9 s: at the surface"):
        read_log(bag(tmp_path / "b", odometry(), commands(U), depth(0.1)))


def test_a_part_before_the_first_or_behind_the_last_message_is_left_out(tmp_path: Path) -> None:
    late = odometry(times=range(2 * 10**9, 20 * 10**9, 10**8))
    excluded = read_log(bag(tmp_path / "b", late, commands(U))).metadata["excluded"]
    assert [(e.first, pytest.approx(e.last), e.reason) for e in excluded] == [
        (0.0, 2.0, "no attitude in the log"), (5.9, 19.9, "no commands in the log"),
    ]  # fmt: skip


def test_headers_of_another_clock_are_reported_and_not_used(tmp_path: Path) -> None:
    late = odometry(late=3_000_000_000)
    signals = read_log(bag(tmp_path / "b", late, commands(U)))
    seen = signals.time[np.isfinite(signals["eta"][:, 0])]
    assert (len(seen), seen[0], seen[-1]) == (60, 0.0, 5.9)
    assert any("headers is 3 s from the bag's" in r for r in signals.metadata["remarks"])


def test_clocks_that_jump_are_refused(tmp_path: Path) -> None:
    times = [*range(0, 3 * 10**9, 10**8), *range(10**14, 10**14 + 3 * 10**9, 10**8)]
    with pytest.raises(InputInvalid, match=r"the clock jumps ahead by 9.999e\+04 s at 5.9"):
        read_log(bag(tmp_path / "b", odometry(times=times), commands(U)))


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_truncated_bag_is_refused_with_what_mends_it(
    plugin: StoragePlugin, tmp_path: Path
) -> None:
    folder = bag(tmp_path / "b", odometry(), commands(U), plugin=plugin)
    (file,) = (*folder.glob("*.mcap"), *folder.glob("*.db3"))
    file.write_bytes(file.read_bytes()[:9000])
    with pytest.raises(InputInvalid, match=r"cannot be read .*expected a complete bag"):
        read_log(folder)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("attitude", "cannot be read .*YAML file of channels"),
        ("heading=/x", r"'heading' is no quantity"),
        ("depth=/x?unit=kg", r"unit=kg; expected a unit of m"),
        ("depth=/x?scale=2", r"option 'scale'; expected unit, factor, offset or frame"),
        ("depth=/x?factor=two", r"factor=two; expected a number"),
        ("depth=/x?frame=enu", r"frame=enu; expected ros or ned"),
        ("u=", r"expected quantity=topic:field"),
    ],
)
def test_a_wrong_channel_is_refused_by_its_text(text: str, message: str) -> None:
    with pytest.raises(InputInvalid, match=message):
        read_channels([text])


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        ("depth=/odo:z", r"no topic '/odo'; expected one such as /odom"),
        ("depth=/odom", r"nav_msgs/msg/Odometry has several fields"),
        ("depth=/odom:pose.pose.z", r"a message cannot be read"),
        ("depth=/odom:pose.pose.position", r"3 numbers; expected 1"),
    ],
)
def test_a_channel_that_the_bag_lacks_is_refused(
    channel: str, message: str, tmp_path: Path
) -> None:
    path = bag(tmp_path / "b", odometry(), commands(U))
    with pytest.raises(InputInvalid, match=message):
        read_log(path, None, read_channels([channel]))
