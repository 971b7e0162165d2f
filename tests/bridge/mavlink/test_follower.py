"""A component that follows a vehicle, which is simulated by another co-simulation."""

from __future__ import annotations

import hashlib
import math
import socket
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.mavlink import follower
from uuvsim_cosim.bridge.mavlink.codec import KEY, Codec
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.mavlink.vehicle import State
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.running.library import load

mav = pytest.importorskip("pymavlink.dialects.v20.ardupilotmega")
ME = Client("test", "local")


@pytest.fixture(autouse=True)
def _nothing_permitted() -> Any:
    follower.allow(arm_real=False, unsigned=False)
    yield
    follower.allow(arm_real=False, unsigned=False)


def test_shadow_has_the_state_of_the_vehicle_and_notes_a_lost_link() -> None:
    with Conductor("bluerov2_hold") as vehicle:
        vehicle.step(ME, 300)
        server = MavlinkServer(vehicle, "tcpin:127.0.0.1:0")
        port = server.ends[0].link.port
        system = load("bluerov2_hold").replace("hull", f"mavlink:tcp:127.0.0.1:{port}")
        system = system.set("hull.timeout", PATIENCE)
        with Conductor(system) as shadow:
            names = ["hull.eta", "hull.nu", "hull.nu_r", "hull.link"]
            _, seen = shadow.step(ME, 1, outputs=names)
            true = vehicle.get(ME, ["hull.eta", "hull.nu"])
            assert np.allclose(seen["hull.eta"], true["hull.eta"], atol=1e-5)
            assert np.allclose(seen["hull.nu"], true["hull.nu"], atol=1e-5)
            assert seen["hull.link"] == 1.0
            for _ in range(100_000):  # the messages arrive one after another
                _, seen = shadow.step(ME, 1, outputs=["hull.nu_dot", "hull.nu_dot_measured"])
                if seen["hull.nu_dot_measured"]:
                    break
            assert seen["hull.nu_dot_measured"]
            nu_dot = vehicle.get(ME, ["hull.nu_dot"])["hull.nu_dot"]
            assert np.allclose(seen["hull.nu_dot"], nu_dot, atol=0.006)
            server.close()
            shadow.set(ME, {"hull.timeout": 1e-9})
            _, seen = shadow.step(ME, 1, outputs=names)
            assert seen["hull.link"] == 0.0
            assert np.allclose(seen["hull.eta"], true["hull.eta"], atol=1e-5)


def _after_a_state(*, arm_real: bool, key: Path | None) -> bytes:
    """Return the bytes that a vehicle gets from a follower that wants to go ahead."""
    follower.allow(arm_real=arm_real, unsigned=arm_real and key is None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(PATIENCE)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            to = ("127.0.0.1", free.getsockname()[1])
        kind = type("Followed", (follower.Followed,), {})
        kind._receiver = receiver = follower._Receiver(follower.Address("udpin", *to), print)
        packer = mav.MAVLink(None, srcSystem=7, srcComponent=1)
        if key is not None:
            packer.signing.secret_key = hashlib.sha256(key.read_bytes().strip()).digest()
            packer.signing.timestamp = int((time.time() - 1420070400) * 1e5)
            packer.signing.sign_outgoing = True
        stranger = mav.MAVLink(None, srcSystem=9, srcComponent=1)
        still = mav.MAVLink_local_position_ned_message(0, 1, 2, 3, 0, 0, 0)
        for message, sender in (
            (mav.MAVLink_heartbeat_message(12, 3, 0, 0, 3, 3), packer),
            (mav.MAVLink_attitude_message(0, 0, 0, 1, 0, 0, 0), packer),
            (still, packer),
            (mav.MAVLink_local_position_ned_message(0, 9, 9, 9, 0, 0, 0), stranger),
            (mav.MAVLink_local_position_ned_message(0, math.nan, 9, 9, 0, 0, 0), packer),
        ):
            vehicle.sendto(bytes(message.pack(sender)), to)
        vehicle.sendto(b"\xfd\x09\x00noise", to)
        while not receiver.is_complete:
            receiver.receive(1.0)
        component = kind()
        for name, (value, _) in follower.Followed.parameters.items():
            setattr(component, name, value)
        component.timeout = PATIENCE
        made = component.step(0.0, 0.01, {"tau": [85.0, 0, 0, 0, 0, 0], "v_c": [0, 0, 0]})
        assert made["eta"] == [1, 2, 3, 0, 0, 1]
        try:
            return vehicle.recv(1000) if arm_real else b""
        finally:
            vehicle.setblocking(False)
            if not arm_real:
                with pytest.raises(BlockingIOError):
                    vehicle.recv(1000)
            receiver._link.close()


def test_commands_need_permission_and_are_signed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _after_a_state(arm_real=False, key=None)
    plain = mav.MAVLink(None).parse_buffer(_after_a_state(arm_real=True, key=None))[0]
    assert (plain.get_type(), plain.target, plain.x, plain.z) == ("MANUAL_CONTROL", 7, 1000, 500)
    assert not plain.get_signed()
    key = tmp_path / "key"
    key.write_text("pass phrase\n")
    monkeypatch.setenv(KEY, str(key))
    data = _after_a_state(arm_real=True, key=key)
    for phrase, good in ((b"pass phrase", True), (b"another", False)):
        vehicle = mav.MAVLink(None)
        vehicle.robust_parsing = True
        vehicle.signing.secret_key = hashlib.sha256(phrase).digest()
        assert (vehicle.parse_buffer(data)[0].get_type() == "MANUAL_CONTROL") is good


def _receiver(reports: list[str]) -> tuple[follower._Receiver, Codec]:
    """Return a follower of a vehicle of ArduPilot, and the vehicle's end."""
    receiver = follower._Receiver(follower.Address("udpin", "127.0.0.1", 0), reports.append)
    receiver._take(_from(Codec(mav, 7, 1), mav.MAVLink_heartbeat_message(12, 3, 0, 0, 3, 3)))
    return receiver, Codec(mav, 7, 1)


def _from(vehicle: Codec, message: Any) -> Any:
    (received,) = Codec(mav, 1, 1).parsed("vehicle", vehicle.packed(message))
    return received


@pytest.mark.parametrize("kind", ["RAW_IMU", "SCALED_IMU", "HIGHRES_IMU"])
def test_accelerations_are_those_of_the_vehicles_imu(kind: str) -> None:
    receiver, vehicle = _receiver([])
    nu, nu_dot = (0.4, -0.2, 0.1, 0.05, -0.1, 0.3), (0.3, -0.2, 0.1, 0.02, 0.01, -0.04)
    state = State(1.0, (1.0, 2.0, 3.0, 0.3, -0.2, 1.1), nu, nu_dot)
    angles, rates = state.eta[3:], nu[3:]
    before = [r - 0.1 * a for r, a in zip(rates, nu_dot[3:], strict=True)]
    f = state.specific_force
    milli = [round(x / 9.80665 * 1e3) for x in f]
    imu = {
        "RAW_IMU": lambda: mav.MAVLink_raw_imu_message(0, *milli, 0, 0, 0, 0, 0, 0),
        "SCALED_IMU": lambda: mav.MAVLink_scaled_imu_message(0, *milli, 0, 0, 0, 0, 0, 0),
        "HIGHRES_IMU": lambda: mav.MAVLink_highres_imu_message(0, *f, *[0] * 10, 7),
    }[kind]()
    for message in (
        mav.MAVLink_attitude_message(900, *angles, *before),
        mav.MAVLink_attitude_message(1000, *angles, *rates),
        mav.MAVLink_local_position_ned_message(1000, *state.eta[:3], *state.velocity),
        imu,
    ):
        receiver._take(_from(vehicle, message))
    assert receiver.accelerations(PATIENCE) == pytest.approx(nu_dot, abs=0.006)
    assert receiver.accelerations(0.0) is None  # they are too old
    receiver.close()


def test_missing_accelerations_are_reported_once_and_marked() -> None:
    reports: list[str] = []
    receiver, vehicle = _receiver(reports)
    receiver._autopilot = 12  # PX4, whose RAW_IMU has no unit
    for message in (
        mav.MAVLink_attitude_message(1000, *[0.0] * 6),
        mav.MAVLink_local_position_ned_message(1000, *[0.0] * 6),
        mav.MAVLink_raw_imu_message(0, 5, 5, 5, 0, 0, 0, 0, 0, 0),
        mav.MAVLink_highres_imu_message(0, math.nan, 0, 0, *[0] * 10, 7),
    ):
        receiver._take(_from(vehicle, message))
    kind = type("Followed", (follower.Followed,), {"_receiver": receiver})
    component = kind()
    component.timeout = 0.0
    for _ in range(3):
        made = component._outputs(receiver, (0.0, 0.0, 0.0))
        assert (made["nu_dot"], made["nu_dot_measured"]) == ([0.0] * 6, 0.0)
    (report,) = reports
    assert "sends no accelerations" in report
    receiver.close()


def test_wrong_signatures_of_the_vehicle_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    key = tmp_path / "key"
    key.write_text("pass phrase\n")
    monkeypatch.setenv(KEY, str(key))
    reports: list[str] = []
    follower.allow(arm_real=False, unsigned=False)
    receiver, _ = _receiver(reports)
    attitude = mav.MAVLink_attitude_message(0, 0.5, 0, 0, 0, 0, 0)
    to = ("127.0.0.1", receiver._link.port)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for phrase in (None, b"another", b"pass phrase"):
            secret = None if phrase is None else hashlib.sha256(phrase).digest()
            sender.sendto(Codec(mav, 7, 1, secret).packed(attitude), to)
            receiver.receive(1.0)
            assert receiver.eta[3] == (0.5 if phrase == b"pass phrase" else 0.0)
    assert len(reports) == 1
    receiver.close()


def test_a_missing_key_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY, raising=False)
    with pytest.raises(InputInvalid, match="names no file with a pass phrase"):
        follower.allow(arm_real=True, unsigned=False)
    assert follower.allow(arm_real=True, unsigned=True)[-1].startswith("--unsigned")
