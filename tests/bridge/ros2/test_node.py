"""A running system as a node of ROS 2, seen by an independent Zenoh session."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh import ext

import uuvsim_cosim as uuv
from tests.bridge.ros2.ros_side import Said, dds, ros, tokens
from tests.bridge.waiting import PATIENCE, until
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.ros2 import node as node_module
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.ros2.rmw_zenoh import attachment, gid
from uuvsim_cosim.bridge.ros2.topic_writer import typestore
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.bridge.zenoh.session import listening
from uuvsim_cosim.errors import InputInvalid

ME = Client("me", "local")
IMU = "sensor_msgs/msg/Imu"
HASH = "RIHS01_7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b"  # Imu's, jazzy


@pytest.fixture
def conductor() -> Iterator[Conductor]:
    with Conductor("bluerov2_survey") as made:
        yield made


class Heard:
    """Samples of a topic; `wait` returns the first."""

    def __init__(self) -> None:
        self._there, self.samples = threading.Event(), list[zenoh.Sample]()

    def __call__(self, sample: zenoh.Sample) -> None:
        self.samples.append(sample)
        self._there.set()

    def wait(self, meanwhile: Callable[[], object]) -> zenoh.Sample:
        for _ in range(600):
            meanwhile()
            if self._there.wait(0.1):
                return self.samples[0]
        raise AssertionError("nothing was heard")


def test_a_session_finds_the_node_and_its_publishers_by_their_tokens(conductor: Conductor) -> None:
    with Ros2Node(conductor, port=0, domain=7) as node:
        assert node.is_router
        with ros(node.port) as session:
            found = tokens(session)
    zid = node.node.session
    assert f"@ros2_lv/7/{zid}/0/0/NN/%/%/bluerov2_survey" in found
    [imu] = [t for t in found if "imu%data_raw" in t]
    begin, number, kind, *rest = imu.split("/")[2:3] + imu.split("/")[4:]
    assert (begin, kind) == (zid, "MP")
    assert int(number) > 0
    assert rest == ["%", "%", "bluerov2_survey", "%imu%data_raw",
                    "sensor_msgs::msg::dds_::Imu_", HASH, "::,:,:,:,,"]  # fmt: skip
    [static] = [t for t in found if "%tf_static" in t]
    assert static.endswith("/:1:,1:,:,:,,")
    kinds = [t.split("/")[5] for t in found]
    assert kinds.count("MP") == len(node.topics) + 3  # /clock, /tf_static, /robot_description
    assert kinds.count("NN") == 1
    assert len({t.split("/")[4] for t in found}) == len(found)  # each has a number of its own


def test_a_subscriber_gets_messages_of_its_type_with_number_time_and_publisher(
    conductor: Conductor,
) -> None:
    store, heard, clock = typestore("jazzy"), Heard(), Heard()
    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        subscribed = [
            peer.declare_subscriber(f"0/imu/data_raw/sensor_msgs::msg::dds_::Imu_/{HASH}", heard),
            peer.declare_subscriber("0/clock/**", clock),
        ]
        sample = heard.wait(lambda: conductor.step(ME, 10, {}, ()))
        tick = clock.wait(lambda: conductor.step(ME, 10, {}, ()))
        [token] = [t for t in tokens(peer) if "imu%data_raw" in t]
        for one in subscribed:
            one.undeclare()
    message = store.deserialize_cdr(sample.payload.to_bytes(), IMU)
    assert message.header.frame_id == "imu_link"
    assert message.linear_acceleration.z == pytest.approx(9.8, abs=1.0)
    assert sample.attachment is not None
    number, time, length = struct.unpack_from("<qqB", sample.attachment.to_bytes())
    assert (number >= 1, length) == (True, 16)  # the first may have been dropped
    assert time > 1.7e18  # the time of day: ROS measures latency by it
    assert sample.attachment.to_bytes()[17:] == gid(token)
    assert store.deserialize_cdr(tick.payload.to_bytes(), "rosgraph_msgs/msg/Clock").clock.sec >= 0


def test_a_later_subscriber_gets_the_frames_of_the_sensors(conductor: Conductor) -> None:
    heard = Heard()
    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        subscribed = ext.declare_advanced_subscriber(
            peer, "0/tf_static/**", heard, history=ext.HistoryConfig(detect_late_publishers=True)
        )
        sample = heard.wait(lambda: None)
        subscribed.undeclare()
    message = typestore("jazzy").deserialize_cdr(
        sample.payload.to_bytes(), "tf2_msgs/msg/TFMessage"
    )
    assert "imu_link" in {tf.child_frame_id for tf in message.transforms}


def test_a_topic_has_the_quality_of_service_of_the_file(
    conductor: Conductor, tmp_path: Path
) -> None:
    (file := tmp_path / "topics.yaml").write_text(
        "topics:\n"
        "  - {topic: /imu, type: sensor_msgs/msg/Imu, qos: {reliability: best_effort, depth: 5},\n"
        "     signals: {gyro: imu.gyro, acc: imu.acc}}\n"
        "  - {topic: /pose, type: nav_msgs/msg/Odometry, signals: {eta: hull.eta, nu: hull.nu},\n"
        "     qos: {durability: transient_local, depth: 2}}\n"
    )
    with Ros2Node(conductor, topics=file, port=0, domain=0) as node, ros(node.port) as peer:
        found = {t.split("/")[9]: t.split("/")[12] for t in tokens(peer) if "/MP/" in t}
        assert (found["%imu"], found["%pose"]) == ("2::,5:,:,:,,", ":1:,2:,:,:,,")
        imu, kept = Heard(), Heard()
        live = peer.declare_subscriber("0/imu/**", imu)
        until(lambda: len(imu.samples) > 3, lambda: conductor.step(ME, 10, {}, ()))
        later = ext.declare_advanced_subscriber(
            peer, "0/pose/**", kept, history=ext.HistoryConfig(detect_late_publishers=True)
        )
        until(lambda: len(kept.samples) == 2)
        for one in (live, later):
            one.undeclare()


def test_a_client_of_the_router_describes_its_vehicle_to_a_later_subscriber(
    conductor: Conductor,
) -> None:
    heard = Heard()
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy")
    with (
        Conductor(boat) as other,
        Ros2Node(other, port=0, domain=1) as router,
        Ros2Node(conductor, port=router.port, domain=0) as node,
        ros(router.port) as peer,
    ):
        assert not node.is_router
        subscribed = ext.declare_advanced_subscriber(
            peer,
            "0/robot_description/**",
            heard,
            history=ext.HistoryConfig(detect_late_publishers=True),
        )
        sample = heard.wait(lambda: None)
        subscribed.undeclare()
    text = typestore("jazzy").deserialize_cdr(sample.payload.to_bytes(), "std_msgs/msg/String").data
    assert '<link name="thruster_8_link">' in text


def test_a_subscriber_gets_clouds_and_diagnostics_of_a_sonar() -> None:
    store, cloud, states = typestore("jazzy"), Heard(), Heard()
    system = uuv.System("sonar", "0.1").add("sonar", "model:multibeam?beams=5")
    with (
        Conductor(system) as conductor,
        Ros2Node(conductor, port=0, domain=0) as node,
        ros(node.port) as peer,
    ):
        kept = [
            peer.declare_subscriber("0/sonar/points/**", cloud),
            peer.declare_subscriber("0/diagnostics/**", states),
        ]
        seen = cloud.wait(lambda: conductor.step(ME, 10, {}, ())).payload.to_bytes()
        state = states.wait(lambda: conductor.step(ME, 10, {}, ())).payload.to_bytes()
        for one in kept:
            one.undeclare()
    message = store.deserialize_cdr(seen, "sensor_msgs/msg/PointCloud2")
    assert (message.width, message.header.frame_id) == (5, "sonar_link")
    [status] = store.deserialize_cdr(state, "diagnostic_msgs/msg/DiagnosticArray").status
    assert (status.name, status.level) == ("sonar", 0)


WIDE = """
import numpy as np
N = 100_000
class Clouds:
    inputs = {}
    outputs = {"range": (N, "m")}
    parameters = {"tilt": (np.zeros(N), "rad"), "azimuth": (np.zeros(N), "rad"),
                  "r_s": (np.zeros(3), "m"), "Theta_s": (np.zeros(3), "rad")}
    def step(self, t, dt, u):
        return {"range": np.full(N, 1.0 + t)}
"""


def test_a_subscriber_that_blocks_loses_clouds_and_stays_connected(tmp_path: Path) -> None:
    (tmp_path / "clouds.py").write_text(WIDE)
    system = uuv.System("wide", "0.1").add("sonar", f"{tmp_path}/clouds.py:Clouds")
    blocked, free, clock = threading.Event(), threading.Event(), Heard()
    numbers, alive = list[int](), list[zenoh.Sample]()

    def hear(sample: zenoh.Sample) -> None:
        numbers.append(struct.unpack_from("<q", sample.attachment.to_bytes())[0])
        blocked.set()
        free.wait(PATIENCE)

    with (
        Conductor(system) as conductor,
        Ros2Node(conductor, port=0, domain=0) as node,
        ros(node.port) as slow,
        ros(node.port, mode="client") as other,
    ):
        # In the thread that receives, so that what it does not take stays in the connection.
        at_once = zenoh.handlers.Callback(hear, indirect=False)
        kept = [
            slow.declare_subscriber("0/sonar/points/**", at_once),
            other.declare_subscriber("0/clock/**", clock),
            slow.liveliness().declare_token("slow"),
            other.liveliness().declare_subscriber("slow", alive.append, history=True),
        ]
        until(blocked.is_set, lambda: conductor.step(ME, 1, {}, ()))
        until(  # 120 MB of clouds, more than the connection holds
            lambda: len(clock.samples) > 100, lambda: conductor.step(ME, 1, {}, ())
        )
        assert len(numbers) == 1
        free.set()
        until(lambda: numbers[-1] > 100 > len(numbers), lambda: conductor.step(ME, 1, {}, ()))
        assert [sample.kind for sample in alive] == [zenoh.SampleKind.PUT]
        for one in kept:
            one.undeclare()


def test_a_message_that_is_not_sent_delays_no_step(
    conductor: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    sending, free = threading.Event(), threading.Event()

    def put(*_: object) -> None:
        sending.set()
        free.wait()

    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        monkeypatch.setattr(node_module._Publisher, "put", put)
        subscribed = peer.declare_subscriber("0/clock/**", Heard())
        until(sending.is_set, lambda: conductor.step(ME, 1, {}, ()))
        stepped = threading.Thread(target=lambda: conductor.step(ME, 5000, {}, ()))
        stepped.start()
        try:
            until(lambda: not stepped.is_alive())
        finally:
            free.set()
        assert node.dropped > 0
        subscribed.undeclare()


def test_a_topic_without_a_subscriber_is_not_published(
    conductor: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard, sent, put = Heard(), set[str](), node_module._Publisher.put

    def noted(publisher: Any, message: bytes) -> None:
        sent.add(str(publisher._raw.key_expr))
        put(publisher, message)

    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        monkeypatch.setattr(node_module._Publisher, "put", noted)
        subscribed = peer.declare_subscriber("0/clock/**", heard)
        until(lambda: len(heard.samples) > 3, lambda: conductor.step(ME, 10, {}, ()))
        subscribed.undeclare()
    assert {key.split("/")[1] for key in sent} == {"clock"}


def names(session: zenoh.Session) -> set[str]:
    """Return the names of the nodes; the router learns those of its clients one by one."""
    return {t.split("/")[8] for t in tokens(session)}


def test_two_nodes_share_one_router_and_one_goes_without_the_other(conductor: Conductor) -> None:
    boat = uuv.System("boat", "0.1").add("hull", "model:bluerov2_heavy")
    with Ros2Node(conductor, port=0, domain=0) as first, Conductor(boat) as other:
        port = first.port
        with Ros2Node(other, port=port, domain=0) as second, ros(port) as session:
            assert (first.is_router, second.is_router) == (True, False)
            until(lambda: names(session) == {"bluerov2_survey", "boat"})
        with ros(port) as session:
            until(lambda: names(session) == {"bluerov2_survey"})


def test_humble_has_no_hashes(conductor: Conductor) -> None:
    with Ros2Node(conductor, "humble", port=0, domain=0) as node, ros(node.port) as session:
        found = [t for t in tokens(session) if "/MP/" in t]
    assert found
    assert {t.split("/")[11] for t in found} == {"TypeHashNotSupported"}


def test_a_subscriber_with_keys_for_buffers_gets_each_cloud_once_by_the_ordinary_key() -> None:
    """Since lyrical, rmw_zenoh also subscribes to `<key>/_buf_cpu`, and its token has backends."""
    heard, type_ = Heard(), "sensor_msgs/msg/PointCloud2"
    system = uuv.System("sonar", "0.1").add("sonar", "model:multibeam?beams=5")
    key = f"0/sonar/points/{dds(type_)}/{typestore('lyrical').hash_rihs01(type_)}"
    with (
        Conductor(system) as conductor,
        Ros2Node(conductor, "lyrical", port=0, domain=0, report=(said := Said())) as node,
        ros(node.port) as peer,
    ):
        lv = "@ros2_lv/0/f/0/1/MS/%/%/rviz/%sonar%points/x/y/::,5:,:,:,,/backends:cpu:"
        kept = [peer.liveliness().declare_token(lv)]
        kept += [peer.declare_subscriber(k, heard) for k in (key, f"{key}/_buf_cpu")]
        until(lambda: len(heard.samples) > 3, lambda: conductor.step(ME, 10, {}, ()))
        for one in kept:
            one.undeclare()
    assert {str(sample.key_expr) for sample in heard.samples} == {key}
    numbers = [struct.unpack_from("<q", s.attachment.to_bytes())[0] for s in heard.samples]
    assert len(set(numbers)) == len(numbers)
    assert not said.texts


def test_a_reset_keeps_the_publishers(conductor: Conductor) -> None:
    heard = Heard()
    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        subscribed = peer.declare_subscriber("0/hull/odometry/**", heard)
        heard.wait(lambda: conductor.step(ME, 10, {}, ()))
        before = tokens(peer)
        conductor.reset(ME)
        n = len(heard.samples)
        Heard.wait(heard, lambda: conductor.step(ME, 10, {}, ()))
        assert tokens(peer) == before
        assert len(heard.samples) >= n
        subscribed.undeclare()


def test_after_a_reset_a_sensor_is_published_from_the_start(conductor: Conductor) -> None:
    times, later, store = list[float](), threading.Event(), typestore("jazzy")

    def heard(sample: zenoh.Sample) -> None:
        stamp = store.deserialize_cdr(sample.payload.to_bytes(), IMU).header.stamp
        times.append(stamp.sec + stamp.nanosec * 1e-9)
        if times[-1] < max(times):
            later.set()

    with Ros2Node(conductor, port=0, domain=0) as node, ros(node.port) as peer:
        subscribed = peer.declare_subscriber("0/imu/data_raw/**", heard)
        for _ in range(600):
            conductor.step(ME, 100, {}, ())
            if times:
                break
            later.wait(0.1)
        conductor.reset(ME)
        for _ in range(50):
            conductor.step(ME, 1, {}, ())
        assert later.wait(60)
        subscribed.undeclare()


def test_another_program_at_the_routers_port_is_named(conductor: Conductor) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]

        def refuse() -> None:
            with suppress(OSError):  # the end of the test
                while True:
                    taken.accept()[0].close()

        thread = threading.Thread(target=refuse)
        thread.start()
        try:
            with pytest.raises(
                InputInvalid, match=rf"port {port} of this machine is in use by another"
            ):
                Ros2Node(conductor, port=port, domain=0)
        finally:
            taken.shutdown(socket.SHUT_RDWR)
            thread.join()


def test_a_domain_that_is_none_is_refused(
    conductor: Conductor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "233")
    with pytest.raises(InputInvalid, match=r"ROS_DOMAIN_ID '233'; expected a number from 0 to 232"):
        Ros2Node(conductor, port=0)


def test_another_node_of_the_same_name_is_reported_once(conductor: Conductor) -> None:
    said = Said()
    with (
        Ros2Node(conductor, port=0, domain=0, report=said) as node,
        Ros2Node(conductor, port=node.port, domain=0, commands=False) as other,
    ):
        assert said.next() == (
            "/bluerov2_survey: another node in domain 0 has this name; expected one node of a "
            "name, for example by another ROS_DOMAIN_ID"
        )
        until(lambda: other.reports.texts)
        assert node.node != other.node
    assert len(other.reports.texts) == 1
    assert len(said.texts) == 1


def test_a_router_that_disappears_is_reported_and_the_node_comes_back(
    conductor: Conductor,
) -> None:
    said, heard, router = Said(), Heard(), listening(0)
    port = router.port
    with Ros2Node(conductor, port=port, domain=0, report=said) as node:
        assert not node.is_router
        router.close()
        place = f"router tcp/127.0.0.1:{port}"
        assert said.next().startswith(f"{place}: has disappeared; the simulation goes on")
        moment, _ = conductor.step(ME, 10, {}, ())
        assert moment.time == pytest.approx(0.1)
        with listening(port), ros(port) as peer:
            assert said.next() == f"{place}: is there again"
            subscribed = peer.declare_subscriber("0/clock/**", heard)
            heard.wait(lambda: conductor.step(ME, 10, {}, ()))
            subscribed.undeclare()
            until(lambda: len(tokens(peer)) > len(node.topics))
    assert len(said.texts) == 2


def test_an_attachment_is_what_zenohs_serialisation_makes() -> None:
    id_ = gid("@ros2_lv/0/a/0/1/MP/%/%/talker/%chatter/x/y/::,:,:,:,,")
    integers: Any = (ext.Int64(5), ext.Int64(17), [ext.UInt8(b) for b in id_])
    assert attachment(5, 17, id_) == ext.z_serialize(integers).to_bytes()
