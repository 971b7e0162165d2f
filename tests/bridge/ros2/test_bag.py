"""A recording as rosbag2: read back by rosbags and by the mcap library."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

import uuvsim_cosim as uuv
from tests.conftest import Uuvsim
from uuvsim_cosim.bridge.ros2.bag import recorded_topics, write_bag
from uuvsim_cosim.bridge.ros2.topics import (
    QosProfile,
    Variable,
    read_topics,
    topics_of,
    topics_text,
)
from uuvsim_cosim.errors import InputInvalid


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("survey") / "run"
    uuv.run("bluerov2_survey", until=6.0, out=folder, backend="native")
    return folder


@pytest.fixture(scope="module")
def bag(run: Path) -> Path:
    write_bag(run, run.parent / "bag")
    return run.parent / "bag"


def messages(bag: Path, topic: str) -> list[tuple[int, Any]]:
    with AnyReader([bag]) as reader:
        chosen = [c for c in reader.connections if c.topic == topic]
        return [(t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages(chosen)]


def xyz(v: Any) -> list[float]:
    return [v.x, v.y, v.z]


def test_true_odometry_is_the_hulls_state_in_enu_and_flu(run: Path, bag: Path) -> None:
    signals = uuv.read_signals(run)
    read = messages(bag, "/hull/odometry")
    assert [t for t, _ in read] == list(np.rint(signals.time * 1e9).astype(int))
    eta, nu = signals["hull.eta"][-1], signals["hull.nu"][-1]
    _, last = read[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("map", "base_link")
    assert xyz(last.pose.pose.position) == [eta[1], eta[0], -eta[2]]
    assert xyz(last.twist.twist.linear) == [nu[0], -nu[1], -nu[2]]
    q = last.pose.pose.orientation
    yaw = np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
    assert np.cos(yaw) == pytest.approx(np.sin(eta[5]))
    assert np.sin(yaw) == pytest.approx(np.cos(eta[5]))
    [tf] = messages(bag, "/tf")[-1][1].transforms
    assert xyz(tf.transform.translation) == [eta[1], eta[0], -eta[2]]
    assert (xyz(tf.transform.rotation), tf.transform.rotation.w) == (xyz(q), q.w)


def test_a_sensor_has_a_message_for_each_sample_with_its_time(run: Path, bag: Path) -> None:
    signals = uuv.read_signals(run)
    times = np.unique(signals["dvl.t_sample"][(signals["dvl.valid"] > 0)])
    stamps = [m.header.stamp for _, m in messages(bag, "/dvl/twist")]
    given = [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps]
    assert given == list(np.rint(times[times >= 0] * 1e9).astype(int))


def test_a_late_fix_is_in_the_bag_when_the_system_had_it(run: Path, bag: Path) -> None:
    signals = uuv.read_signals(run)
    sample = signals["usbl.t_sample"]
    first = int(np.flatnonzero(sample >= 0)[0])
    at, message = messages(bag, "/usbl/pose")[0]
    stamp = message.header.stamp
    assert at == round(signals.time[first] * 1e9)
    assert stamp.sec * 10**9 + stamp.nanosec == round(sample[first] * 1e9) < at


def test_at_rest_an_imu_reads_one_g_upwards(bag: Path) -> None:
    read = [m.linear_acceleration.z for _, m in messages(bag, "/imu/data_raw")[:100]]
    assert np.mean(read) == pytest.approx(9.8, abs=0.3)


def test_covariances_are_those_of_the_sensors_parameters(bag: Path) -> None:
    # pressure: 60 Pa/√Hz at 10 Hz, and 100 Pa of wandering bias
    _, pressure = messages(bag, "/pressure/fluid_pressure")[0]
    assert pressure.variance == pytest.approx(60.0**2 / 0.1 + 100.0**2)
    _, dvl = messages(bag, "/dvl/twist")[0]
    tilt = np.radians(22.5)
    assert dvl.twist.covariance[0] == pytest.approx(0.004**2 / (2 * np.sin(tilt) ** 2))
    assert dvl.twist.covariance[14] == pytest.approx(0.004**2 / (4 * np.cos(tilt) ** 2))
    _, imu = messages(bag, "/imu/data_raw")[0]
    assert imu.orientation_covariance[0] == -1


def test_the_filters_deviations_are_its_odometrys_covariance(run: Path, bag: Path) -> None:
    sigma = uuv.read_signals(run)["navigation.sigma"][-1]
    _, last = messages(bag, "/navigation/odometry")[-1]
    pose = np.reshape(last.pose.covariance, (6, 6))
    assert np.diag(pose) == pytest.approx(sigma[[1, 0, 2, 3, 4, 5]] ** 2)
    assert not (pose - np.diag(np.diag(pose))).any()


def test_sensors_hang_below_the_hull_in_tf_static(bag: Path) -> None:
    [(t, message)] = messages(bag, "/tf_static")
    frames = {tf.child_frame_id: tf for tf in message.transforms}
    assert t == 0
    assert {"imu_link", "pressure_link"} <= frames.keys()
    assert {tf.header.frame_id for tf in message.transforms} == {"base_link", "dvl_link"}
    assert xyz(frames["pressure_link"].transform.translation) == [-0.15, 0.0, 0.0]
    assert "TRANSIENT_LOCAL" in (bag / "metadata.yaml").read_text().upper()


def test_numbers_without_a_rule_keep_their_frames_and_units(run: Path, bag: Path) -> None:
    read = messages(bag, "/current/v_c")
    assert read[-1][1].data.tolist() == uuv.read_signals(run)["current.v_c"][-1].tolist()


def test_one_file_has_ros_profile_and_definitions(run: Path, tmp_path: Path) -> None:
    write_bag(run, tmp_path / "run.mcap")
    with (tmp_path / "run.mcap").open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
        assert summary is not None
        assert {s.encoding for s in summary.schemas.values()} == {"ros2msg"}
        [imu] = [s for s in summary.schemas.values() if s.name == "sensor_msgs/msg/Imu"]
        assert b"geometry_msgs/Vector3 angular_velocity" in imu.data
    assert sorted(p.name for p in tmp_path.iterdir()) == ["run.mcap"]


def test_a_file_of_topics_says_what_is_written(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(
        "topics:\n"
        "  - {topic: /imu, type: sensor_msgs/msg/Imu, frame: imu, rate: 10,\n"
        "     signals: {gyro: imu.gyro, acc: imu.acc}}\n"
    )
    topics, _ = write_bag(run, tmp_path / "bag", file)
    assert [t.name for t in topics] == ["/imu"]
    times = [t for t, _ in messages(tmp_path / "bag", "/imu")]
    assert 55 <= len(times) <= 61
    assert min(np.diff(times)) >= 1e8 - 1


def test_the_text_of_topics_is_the_topics(run: Path, tmp_path: Path) -> None:
    topics = recorded_topics(run)
    signals = uuv.read_signals(run)
    variables = {
        name: Variable(v.dtype.kind, v.shape[1] if v.ndim > 1 else 0) for name, v in signals.items()
    }
    file = tmp_path / "topics.yaml"
    topics[0] = replace(topics[0], rate=5, qos=QosProfile(best_effort=True, depth=3))
    topics[1] = replace(topics[1], qos=QosProfile(transient_local=True))
    file.write_text(topics_text(topics))
    assert read_topics(file, variables) == topics


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("type: sensor_msgs/msg/Imu, signals: {gyro: imu.gyr}", r":2: /x: .*; expected one such"),
        ("type: sensor_msgs/msg/Imu, signals: {gyro: imu.gyro}", r"signals gyro; expected gyro, a"),
        ("type: sensor_msgs/msg/Imu, signals: {gyro: imu.gyro, acc: hull.eta}",
         r"acc: hull.eta has 6 elements; expected 3"),
        ("type: std_msgs/msg/Float64, signals: {data: imu.gyro}",
         r"type std_msgs/msg/Float64 of imu.gyro; expected std_msgs/msg/Float64MultiArray"),
        ("type: a_msgs/msg/B, signals: {data: imu.gyro}", r"type a_msgs/msg/B; expected nav_msgs"),
        ("type: Imu, signals: {data: imu.gyro}", r"expected a type such as sensor_msgs/msg/Imu"),
        ("type: std_msgs/msg/Bool, qos: {reliability: best}, signals: {data: imu.valid}",
         r":2: .*reliability.*; expected reliable or best_effort"),
        ("type: std_msgs/msg/Bool, signals: {data: imu.valid}}\n"
         "  - {topic: /x, type: std_msgs/msg/Bool, qos: {depth: 1}, signals: {data: imu.valid}",
         r":3: /x: another qos; expected that of the topic's first entry"),
        ("type: sensor_msgs/msg/Imu, rate: 0, signals: {gyro: imu.gyro, acc: imu.acc}", "rate"),
    ],
)  # fmt: skip
def test_a_mistake_in_topics_is_said_with_its_line(
    run: Path, tmp_path: Path, entry: str, words: str
) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(f"topics:\n  - {{topic: /x, {entry}}}\n")
    with pytest.raises(InputInvalid, match=words):
        write_bag(run, tmp_path / "bag", file)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["topics.yaml"]


def test_a_bag_states_the_quality_of_service_of_its_topics(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(
        "topics:\n"
        "  - {topic: /imu, type: sensor_msgs/msg/Imu, qos: {reliability: best_effort, depth: 5},\n"
        "     signals: {gyro: imu.gyro, acc: imu.acc}}\n"
    )
    write_bag(run, tmp_path / "bag", file)
    with AnyReader([tmp_path / "bag"]) as reader:
        [imu] = [c for c in reader.connections if c.topic == "/imu"]
        [qos] = imu.ext.offered_qos_profiles  # type: ignore[union-attr]
    assert (qos.reliability.name, qos.durability.name, qos.depth) == ("BEST_EFFORT", "VOLATILE", 5)


def test_two_vehicles_share_the_topic_of_transforms(tmp_path: Path) -> None:
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy")
    both = uuv.System("both", "0.1").add("a", boat).add("b", boat)
    uuv.run(both, until=1.0, out=tmp_path / "run", backend="native")
    write_bag(tmp_path / "run", tmp_path / "bag")
    children = [m.transforms[0].child_frame_id for _, m in messages(tmp_path / "bag", "/tf")]
    assert children == ["a/base_link", "b/base_link"] * 11


def test_a_topic_of_two_types_is_refused(run: Path, tmp_path: Path) -> None:
    file = tmp_path / "topics.yaml"
    file.write_text(
        "topics:\n"
        "  - {topic: /x, type: std_msgs/msg/Float64MultiArray, signals: {data: imu.gyro}}\n"
        "  - {topic: /x, type: sensor_msgs/msg/Imu, signals: {gyro: imu.gyro, acc: imu.acc}}\n"
    )
    with pytest.raises(InputInvalid, match=r":3: /x: type sensor_msgs/msg/Imu; expected std_msgs"):
        write_bag(run, tmp_path / "bag", file)


def test_parts_of_a_nested_vehicle_carry_its_name() -> None:
    topics = topics_of(
        {
            "boat.hull.eta": Variable("f", 6),
            "boat.hull.nu": Variable("f", 6),
            "boat.hull.q": Variable("f", 4),
        }
    )
    assert [(t.name, t.frame, t.child) for t in topics] == [
        ("/boat/hull/odometry", "map", "boat/base_link"), ("/tf", "map", "boat/base_link"),
    ]  # fmt: skip


def test_what_exists_is_not_overwritten(run: Path, bag: Path) -> None:
    with pytest.raises(InputInvalid, match="exists; expected a name that does not exist yet"):
        write_bag(run, bag)


def test_without_the_system_covariances_are_reported_as_missing(run: Path, tmp_path: Path) -> None:
    alone = tmp_path / "signals.parquet"
    alone.write_bytes((run / "signals.parquet").read_bytes())
    _, notes = write_bag(alone, tmp_path / "bag")
    assert any(n.startswith("no system.ssd beside the recording: covariances") for n in notes)


def test_the_command_writes_a_file_a_folder_and_the_topics(
    run: Path, tmp_path: Path, uuvsim: Uuvsim
) -> None:
    for name in ("a.mcap", "a", "topics.yaml"):
        status, out, _ = uuvsim("export", str(run), "-o", str(tmp_path / name), "--ros2")
        assert status == 0
        assert name in out
    assert (tmp_path / "a" / "metadata.yaml").is_file()
    assert re.search(r"rosdistro|ros_distro", (tmp_path / "a" / "metadata.yaml").read_text())
    status, _, err = uuvsim("export", str(run), "-o", str(tmp_path / "a.csv"), "--ros2")
    assert (status, "expected .mcap, no ending for a folder, or .yaml" in err) == (2, True)
    status, _, err = uuvsim(
        "export", str(run), "-o", str(tmp_path / "b.mcap"), "--topics", "t.yaml"
    )
    assert (status, "expected --ros2 beside it" in err) == (2, True)
