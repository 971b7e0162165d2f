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

from uuvsim_cosim.bridge.calls.service import Client
from uuvsim_cosim.bridge.mavlink import follower
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
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
        with Conductor(system) as shadow:
            names = ["hull.eta", "hull.nu", "hull.nu_r", "hull.link"]
            _, seen = shadow.step(ME, 1, outputs=names)
            true = vehicle.get(ME, ["hull.eta", "hull.nu"])
            assert np.allclose(seen["hull.eta"], true["hull.eta"], atol=1e-5)
            assert np.allclose(seen["hull.nu"], true["hull.nu"], atol=1e-5)
            assert seen["hull.link"] == 1.0
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
        vehicle.settimeout(1.0)
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
    monkeypatch.setenv(follower.KEY, str(key))
    data = _after_a_state(arm_real=True, key=key)
    for phrase, good in ((b"pass phrase", True), (b"another", False)):
        vehicle = mav.MAVLink(None)
        vehicle.robust_parsing = True
        vehicle.signing.secret_key = hashlib.sha256(phrase).digest()
        assert (vehicle.parse_buffer(data)[0].get_type() == "MANUAL_CONTROL") is good


def test_a_missing_key_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(follower.KEY, raising=False)
    with pytest.raises(InputInvalid, match="names no file with a pass phrase"):
        follower.allow(arm_real=True, unsigned=False)
    assert follower.allow(arm_real=True, unsigned=True)[-1].startswith("--unsigned")
