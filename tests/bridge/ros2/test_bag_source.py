"""Topics of a rosbag2 as the outputs of a component."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

import uuvsim_cosim as uuv
from tests.bridge.ros2.written import STORE
from tests.conftest import Uuvsim
from uuvsim_cosim.bridge.ros2.bag import write_bag
from uuvsim_cosim.bridge.ros2.bag_source import source
from uuvsim_cosim.bridge.ros2.frames import euler_quaternion, quaternion
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.orchestrator.system.resolve import resolve

EPOCH = 1_700_000_000_000_000_000  # [ns] a day of 2023


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("survey") / "run"
    uuv.run("bluerov2_survey", until=4.0, out=folder, backend="native")
    write_bag(folder, folder.parent / "survey.mcap")
    return folder


def made(name: str, **fields: Any) -> Any:
    return STORE.types[name](**fields)


def header(time: int, frame: str = "map") -> Any:
    stamp = made("builtin_interfaces/msg/Time", sec=time // 10**9, nanosec=time % 10**9)
    return made("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def vector(*v: float) -> Any:
    return made("geometry_msgs/msg/Vector3", **dict(zip("xyz", v, strict=True)))


def twist(x: float, z: float = 0.0) -> Any:
    return made("geometry_msgs/msg/Twist", linear=vector(x, 2.0, 3.0), angular=vector(0.1, 0.2, z))


def pose(time: int, psi: float, frame: str = "map") -> Any:
    x, y, z, w = quaternion(euler_quaternion(np.array([[0.0, 0.0, psi]])))[0]
    return made(
        "geometry_msgs/msg/PoseStamped", header=header(time, frame),
        pose=made("geometry_msgs/msg/Pose",
                  position=made("geometry_msgs/msg/Point", x=1.0, y=2.0, z=-3.0),
                  orientation=made("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)),
    )  # fmt: skip


def slack() -> Any:
    message = pose(EPOCH, 0.0)
    message.pose.orientation.w = 2.0
    return message


def bag_of(folder: Path, *messages: tuple[str, int, Any]) -> Path:
    """Write a bag of (topic, time [ns], message) in this order."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as out:
        topics = {
            topic: out.add_connection(topic, type_, typestore=STORE)
            for topic, type_ in {topic: m.__msgtype__ for topic, _, m in messages}.items()
        }
        for topic, time, message in messages:
            out.write(topics[topic], time, STORE.serialize_cdr(message, message.__msgtype__))
    return folder


def component(text: str) -> Component:
    return resolve(text).instantiate("replayed")


def value(replayed: Component, name: str, t: float) -> Any:
    replayed.do_step(t - 0.125, 0.125)
    return replayed.get(replayed.description.variables[name])


@pytest.mark.parametrize(
    ("path", "names", "tolerance"),
    [
        ("guidance", ("eta_d", "nu_d", "cross_track", "waypoint", "done"), 1e-12),
        ("controller", ("tau_d",), 0.0),
        ("imu", ("gyro", "acc", "t_sample", "valid"), 0.0),
        ("dvl", ("velocity", "altitude", "t_sample", "valid", "beam_valid"), 0.0),
        ("dvl", ("range", "beam_velocity"), 1e-6),  # beam_velocity is a float32
        ("pressure", ("pressure", "t_sample", "valid"), 0.0),
        ("usbl", ("position", "t_sample"), 0.0),
        ("usbl", ("sigma",), 1e-12),
        ("navigation", ("eta", "nu", "sigma", "t_sample", "gyro_bias"), 1e-12),
        ("hull", ("eta", "q", "nu", "nu_dot", "nu_r"), 1e-12),
        ("battery", ("voltage", "state_of_charge", "energy"), 1e-6),  # float32
        ("allocation", ("u", "f"), 0.0),
    ],
)
def test_an_exported_run_is_read_back_with_its_values(
    run: Path, path: str, names: tuple[str, ...], tolerance: float
) -> None:
    signals = uuv.read_signals(run)
    replayed = component(f"bag:{run.parent / 'survey.mcap'}?topic=/{path}/*")
    sample = f"{path}.t_sample"  # values before the first sample are in no message
    first = int(np.flatnonzero(signals[sample] >= 0)[0]) if sample in signals else 0
    replayed.enter_initialization_mode(0.0, None)
    for i in range(first, len(signals.time), 7):
        t = float(signals.time[i])
        for name in names:
            expected = np.asarray(signals[f"{path}.{name}"][i], float)
            read = np.asarray(value(replayed, name, t), float)
            assert read == pytest.approx(expected, rel=tolerance, abs=tolerance), (name, t)


def test_a_system_flies_the_same_with_its_replayed_guidance(tmp_path: Path) -> None:
    uuv.run("bluerov2_hold", until=8.0, out=tmp_path / "a", backend="native")
    write_bag(tmp_path / "a", tmp_path / "a.mcap")
    system = uuv.load("bluerov2_hold").replace(
        "guidance", f"bag:{tmp_path / 'a.mcap'}?topic=/guidance/*"
    )
    uuv.run(system, until=8.0, out=tmp_path / "b", backend="native")
    first, second = (uuv.read_signals(tmp_path / name)["hull.eta"] for name in "ab")
    assert np.abs(first - second).max() < 1e-9


def test_a_sensor_before_its_first_message_is_not_valid(run: Path) -> None:
    replayed = component(f"bag:{run.parent / 'survey.mcap'}?topic=/usbl/pose")
    assert (value(replayed, "valid", 0.0), value(replayed, "t_sample", 0.0)) == (False, -1.0)


def test_a_twist_is_held_from_the_message_on_and_converted_to_frd(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "b", ("/cmd_vel", EPOCH, twist(1.0)),
                 ("/cmd_vel", EPOCH + 10**9, twist(5.0)))  # fmt: skip
    replayed = component(f"bag:{bag}?topic=/cmd_vel")
    assert value(replayed, "nu_d", 0.999999).tolist() == [1.0, -2.0, -3.0, 0.1, -0.2, 0.0]
    assert value(replayed, "nu_d", 1.0)[0] == 5.0
    assert value(replayed, "nu_d", 99.0)[0] == 5.0


def test_a_message_at_a_communication_point_is_seen_there(tmp_path: Path) -> None:
    t = 2.05  # in floating point, 2.05e9 ns is 2049999999.9999998 after the step's addition
    bag = bag_of(tmp_path / "b", ("/u", 0, twist(0.0)), ("/u", 2_050_000_000, twist(1.0)))
    assert value(component(f"bag:{bag}?topic=/u"), "nu_d", t)[0] == 1.0


def test_between_two_messages_a_signal_can_be_linear(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "b", ("/cmd_vel", EPOCH, twist(1.0)),
                 ("/cmd_vel", EPOCH + 10**9, twist(5.0)))  # fmt: skip
    replayed = component(f"bag:{bag}?topic=/cmd_vel&between=linear")
    assert value(replayed, "nu_d", 0.25)[0] == pytest.approx(2.0)


def test_linear_angles_take_the_shorter_way(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "b", ("/p", EPOCH, pose(EPOCH, 3.0)),
                 ("/p", EPOCH + 10**9, pose(EPOCH, -3.0)))  # fmt: skip
    replayed = component(f"bag:{bag}?topic=/p&between=linear")
    eta = value(replayed, "eta_d", 0.5)
    assert eta[:3] == pytest.approx([2.0, 1.0, 3.0])
    assert abs(eta[5]) == pytest.approx(np.pi)


def test_the_time_that_is_zero_can_be_given_and_the_stamp_can_count(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "b", ("/p", EPOCH + 10**9, pose(EPOCH, 0.5)),
                 ("/p", EPOCH + 2 * 10**9, pose(EPOCH + 10**8, 1.0)))  # fmt: skip
    by_bag = component(f"bag:{bag}?topic=/p&zero=1700000000.5")
    assert value(by_bag, "eta_d", 1.4)[5] == pytest.approx(0.5)
    assert value(by_bag, "eta_d", 1.5)[5] == pytest.approx(1.0)
    by_stamp = component(f"bag:{bag}?topic=/p&zero=1700000000&stamp=header")
    assert value(by_stamp, "eta_d", 0.1)[5] == pytest.approx(1.0)


def test_gaps_old_stamps_and_equal_times_are_reported(tmp_path: Path) -> None:
    times = [0, 1, 2, 3, 3, 60]
    stamps = [0, 1, 0, 3, 3, 60]
    messages = [("/p", EPOCH + t * 10**9, pose(EPOCH + s * 10**9, 0.1 * i))
                for i, (t, s) in enumerate(zip(times, stamps, strict=True))]  # fmt: skip
    bag = bag_of(tmp_path / "b", *messages)
    found = source(f"bag:{bag}?topic=/p", Path())
    text = "\n".join(found.remarks)
    assert "b: t = 0 is the bag's begin, 1700000000.000000000 s; zero=SECONDS changes it" in text
    assert "6 messages from 0 to 60 s, held between them; frame 'map', read by REP 103" in text
    assert "the longest gap is 57 s, from 3 s on; the median is 1 s" in text
    assert "1 messages have an older stamp than the one before them" in text
    assert "1 messages have the time of the next one, which is used" in text
    assert value(found.instantiate("x"), "eta_d", 3.0)[5] == pytest.approx(0.4)
    by_stamp = source(f"bag:{bag}?topic=/p&stamp=header", Path())
    assert any("out of order, and are sorted" in remark for remark in by_stamp.remarks)


def test_the_remarks_of_a_bag_are_those_of_the_system(run: Path) -> None:
    system = uuv.load("bluerov2_survey").replace(
        "guidance", f"bag:{run.parent / 'survey.mcap'}?topic=/guidance/*"
    )
    assert any(
        n.startswith("guidance: survey.mcap: /guidance/pose: geometry_msgs") for n in system.notes
    )


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (lambda: twist(np.nan), r"b: /x, t = 1 s: nu_d \[ ?nan .*; expected finite numbers"),
        (lambda: pose(EPOCH, np.nan), r"b: /x, t = 0 s: eta_d .* nan.*; expected finite numbers"),
        (slack, r"b: /x: message 1: an orientation of norm 2.1.*; expected a unit quaternion"),
        (lambda: pose(EPOCH, 0.0, "map_ned"), r"/x: frame 'map_ned'; expected frames of REP 103"),
        (lambda: made("std_msgs/msg/String", data="no"), r"/x: std_msgs/msg/String; expected "),
    ],
)
def test_what_cannot_be_replayed_is_refused_with_its_place(
    tmp_path: Path, message: Callable[[], Any], expected: str
) -> None:
    first = {"geometry_msgs/msg/Twist": lambda: twist(0.0)}.get(message().__msgtype__, message)
    bag = bag_of(tmp_path / "b", ("/x", EPOCH, first()), ("/x", EPOCH + 10**9, message()))
    with pytest.raises(InputInvalid, match=expected):
        resolve(f"bag:{bag}?topic=/x").describe()


def test_arrays_that_change_their_length_are_refused(tmp_path: Path) -> None:
    def array(n: int) -> Any:
        layout = made("std_msgs/msg/MultiArrayLayout", dim=[], data_offset=0)
        return made("std_msgs/msg/Float64MultiArray", layout=layout, data=np.zeros(n))

    bag = bag_of(tmp_path / "b", ("/u", 0, array(8)), ("/u", 10**9, array(7)))
    with pytest.raises(InputInvalid, match="t = 1 s: another number of elements than before"):
        resolve(f"bag:{bag}?topic=/u").describe()
    one = bag_of(tmp_path / "c", ("/u", 0, array(8)))
    assert resolve(f"bag:{one}?topic=/u").describe().variables["u"].shape == (8,)


def test_two_topics_with_one_signal_are_refused(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "b", ("/a", 0, twist(0.0)), ("/b", 0, twist(0.0)))
    with pytest.raises(InputInvalid, match=r"/b: a second signal 'nu_d'; expected topics whose"):
        resolve(f"bag:{bag}?topic=/a&topic=/b").describe()


@pytest.mark.parametrize(
    ("query", "expected"),
    [
        ("", "no topic; expected bag:FILE"),
        ("topic=/cmd_vle", "no topic '/cmd_vle'; expected one such as /cmd_vel"),
        ("topic=/cmd_vel&betwen=linear", "option 'betwen'; expected one such as between"),
        ("topic=/cmd_vel&between=spline", "between=spline; expected held or linear"),
        ("topic=/cmd_vel&zero=nan", "zero=nan; expected seconds"),
    ],
)
def test_a_source_with_a_mistake_is_refused(tmp_path: Path, query: str, expected: str) -> None:
    bag = bag_of(tmp_path / "b", ("/cmd_vel", 0, twist(0.0)))
    with pytest.raises(InputInvalid, match=expected):
        resolve(f"bag:{bag}?{query}").describe()


@pytest.mark.parametrize("content", [None, b"", b"no bag at all", b"\x89MCAP0\r\n" + bytes(64)])
def test_a_file_that_is_no_bag_is_refused(tmp_path: Path, content: bytes | None) -> None:
    file = tmp_path / "x.mcap"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputInvalid, match=r"x\.mcap: (no such file|cannot be read)"):
        resolve(f"bag:{file}?topic=/x").describe()


def test_messages_that_are_cut_are_refused(tmp_path: Path) -> None:
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.MCAP) as out:
        topic = out.add_connection("/x", "geometry_msgs/msg/Twist", typestore=STORE)
        raw = bytes(STORE.serialize_cdr(twist(0.0), "geometry_msgs/msg/Twist"))
        out.write(topic, 0, raw)
        out.write(topic, 5 * 10**8, raw[:20])
    with pytest.raises(InputInvalid, match=r"/x, t = 0.5 s: a message cannot be read"):
        resolve(f"bag:{tmp_path / 'b'}?topic=/x").describe()


def test_the_text_of_a_source_leads_to_the_same_bag_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag_of(tmp_path / "b", ("/a b", 0, twist(0.0)))
    monkeypatch.chdir(tmp_path)
    found = source("bag:b?topic=/a%20*&between=linear", tmp_path / "elsewhere")
    monkeypatch.chdir("/")
    again = source(found.text, Path("/"))
    assert again == found
    assert list(again.describe().variables) == ["nu_d"]


def test_the_command_reports_what_was_assumed(
    run: Path, tmp_path: Path, uuvsim: Uuvsim, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(run.parent)
    status, out, _ = uuvsim(
        "run", "bluerov2_survey", "--until", "1", "--no-report", "-o", str(tmp_path / "back"),
        "--replace", "guidance=bag:survey.mcap?topic=/guidance/*",
    )  # fmt: skip
    assert status == 0
    assert "guidance: survey.mcap: the bag has simulated times" in " ".join(out.split())
