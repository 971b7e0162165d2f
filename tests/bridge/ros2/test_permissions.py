"""Mutual TLS of a node: the role of a certificate tells what a ROS 2 machine may do."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh
from zenoh import ext

import uuvsim_cosim as uuv
from tests.bridge.ros2.ros_side import (
    Publisher,
    asked,
    call,
    header,
    made,
    pose,
    ros,
    tokens,
    twist,
)
from tests.bridge.waiting import until
from uuvsim_cosim.bridge.access.access_file import Access, read_access
from uuvsim_cosim.bridge.access.certificates import make_certificates
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.ros2.node import Ros2Node
from uuvsim_cosim.bridge.ros2.permissions import guarded_node
from uuvsim_cosim.bridge.ros2.services import NEEDED
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid

ME = Client("me", "local")
NODE = "bluerov2_hold"
TRIGGER, LIST = "std_srvs/srv/Trigger", "rcl_interfaces/srv/ListParameters"
SET = "rcl_interfaces/srv/SetParameters"
TWIST, POSE = "geometry_msgs/msg/Twist", "geometry_msgs/msg/PoseStamped"
LEVEL = (0.0, 0.0, 0.0, 1.0)
CERTIFICATES = ("see", "command", "drive", "stranger")
ACCESS = """tls:
  certificate: server.pem
  key: server-key.pem
  ca: ca.pem
  roles: {see: observer, command: operator, drive: controller}
"""


def shown(folder: Path, name: str, ca: Path | None = None) -> dict[str, object]:
    """Return the TLS settings of a peer with a certificate, or without one (an empty name)."""
    own = {"connect_certificate": str(folder / f"{name}.pem"),
           "connect_private_key": str(folder / f"{name}-key.pem"),
           "enable_mtls": True} if name else {}  # fmt: skip
    return {"root_ca_certificate": str((ca or folder) / "ca.pem"), **own}


@pytest.fixture(scope="module")
def pki(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pki")
    make_certificates(folder, clients=CERTIFICATES)
    (folder / "access.yaml").write_text(ACCESS)
    return folder


@dataclass
class Opened:
    conductor: Conductor
    node: Ros2Node
    pki: Path

    @contextmanager
    def peer(self, name: str, mode: str = "peer") -> Iterator[zenoh.Session]:
        with ros(self.node.port, shown(self.pki, name), mode) as session:
            yield session

    def gives(self, signal: str, expected: list[float], publish: Any) -> None:
        """Publish until a signal has values."""

        def value() -> Any:
            return self.conductor.get(ME, [signal])[signal]

        until(lambda: np.allclose(value(), expected, atol=1e-9), publish)


@pytest.fixture(scope="module")
def opened(pki: Path) -> Iterator[Opened]:
    with (
        Conductor(uuv.load(NODE).remove("guidance")) as conductor,
        Ros2Node(conductor, port=0, domain=0, access=read_access(pki / "access.yaml")) as node,
    ):
        yield Opened(conductor, node, pki)


@pytest.mark.parametrize("mode", ["client", "peer", "router"])
def test_a_certificate_of_the_authority_reads_topics(opened: Opened, mode: str) -> None:
    there = threading.Event()
    with opened.peer("see", mode) as peer:
        subscribed = peer.declare_subscriber("0/clock/**", lambda sample: there.set())
        until(there.is_set, lambda: opened.conductor.step(ME, 1, {}, ()))
        subscribed.undeclare()
        latched, urdf = threading.Event(), list[bytes]()

        def robot(sample: zenoh.Sample) -> None:
            urdf.append(sample.payload.to_bytes())
            latched.set()

        late = ext.declare_advanced_subscriber(
            peer, "0/robot_description/**", robot,
            history=ext.HistoryConfig(detect_late_publishers=True),
        )  # fmt: skip
        assert latched.wait(20.0)
        late.undeclare()
        kinds = {token.split("/")[5] for token in tokens(peer)}
    assert b"<robot" in urdf[0]
    assert {"NN", "MP", "MS", "SS"} <= kinds


def test_the_role_of_an_observer_neither_sets_nor_calls(opened: Opened) -> None:
    before = opened.conductor.get(ME, ["controller.nu_d"])["controller.nu_d"]
    tick = opened.conductor.moment().tick
    with opened.peer("see") as peer, opened.peer("command") as other:
        publisher = Publisher(peer, "/controller/cmd_vel", TWIST)
        # The session delivers in order: after the response, the message has been refused.
        publisher.put(twist((0.7, 0.0, 0.0), (0.0, 0.0, 0.0)))
        assert not [r for r in asked(peer, f"/{NODE}/step", TRIGGER) if r.ok is not None]
        assert not [r for r in asked(peer, f"/{NODE}/set_parameters", SET) if r.ok is not None]
        assert call(peer, f"/{NODE}/list_parameters", LIST)[0].result.names
        # One thread looks at all inputs, so that the first has been looked at after two others.
        poses = Publisher(other, "/controller/cmd_pose", POSE)
        for depth in (2.0, 3.0):
            goal = made(POSE, header=header("map"), pose=pose((0.0, 0.0, -depth), LEVEL))
            opened.gives(
                "controller.eta_d",
                [0, 0, depth, 0, 0, np.pi / 2],
                lambda goal=goal: poses.put(goal),
            )  # type: ignore[misc]
    assert np.array_equal(opened.conductor.get(ME, ["controller.nu_d"])["controller.nu_d"], before)
    assert opened.conductor.moment().tick == tick


def test_an_operator_sets_and_a_controller_steps(opened: Opened) -> None:
    tick = opened.conductor.moment().tick
    with opened.peer("command", "router") as peer:
        publisher = Publisher(peer, "/controller/cmd_vel", TWIST)
        command = twist((0.3, 0.0, 0.0), (0.0, 0.0, 0.0))
        opened.gives("controller.nu_d", [0.3, 0, 0, 0, 0, 0], lambda: publisher.put(command))
        assert call(peer, f"/{NODE}/set_parameters", SET)[0].results == []
        assert not [r for r in asked(peer, f"/{NODE}/step", TRIGGER) if r.ok is not None]
    assert opened.conductor.moment().tick == tick
    with opened.peer("drive", "router") as peer:
        assert call(peer, f"/{NODE}/step", TRIGGER)[0].success
    assert opened.conductor.moment().tick == tick + 1


def test_a_certificate_without_a_role_may_nothing(opened: Opened) -> None:
    with opened.peer("stranger") as peer:
        assert tokens(peer) == []
        assert not [r for r in asked(peer, f"/{NODE}/list_parameters", LIST) if r.ok is not None]


def test_a_certificate_of_another_authority_opens_no_session(
    opened: Opened, tmp_path: Path
) -> None:
    make_certificates(tmp_path, clients=["drive"])
    with (
        pytest.raises(zenoh.ZError),
        ros(opened.node.port, shown(tmp_path, "drive", opened.pki), "client"),
    ):
        pass


def test_a_peer_without_a_certificate_opens_no_session(opened: Opened) -> None:
    with pytest.raises(zenoh.ZError), ros(opened.node.port, shown(opened.pki, ""), "client"):
        pass


def test_a_peer_without_tls_opens_no_session(opened: Opened) -> None:
    with pytest.raises(zenoh.ZError), ros(opened.node.port, mode="client"):
        pass


def test_each_service_needs_a_permission(opened: Opened) -> None:
    assert opened.node.services.keys() == {f"/{NODE}/{name}" for name in NEEDED}


def test_an_access_file_without_an_authority_is_refused() -> None:
    with pytest.raises(InputInvalid, match="no tls with ca"):
        guarded_node(Access(anyone="observer"), 0, NODE)
