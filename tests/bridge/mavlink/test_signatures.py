"""Signatures of MAVLink 2: what is sent is signed, and what has no valid signature is refused."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path
from typing import Any

import pytest

from tests.bridge.mavlink.ground import ME, Ground, mav, piloted
from uuvsim_cosim.bridge.mavlink.codec import KEY, Codec, key_of_environment
from uuvsim_cosim.bridge.mavlink.server import MavlinkServer
from uuvsim_cosim.bridge.server.conductor import Conductor
from uuvsim_cosim.errors import InputInvalid

RIGHT, WRONG = (hashlib.sha256(phrase).digest() for phrase in (b"pass phrase", b"another"))
_ARM = (1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> bytes:
    path = tmp_path / "key"
    path.write_text("pass phrase\n")
    monkeypatch.setenv(KEY, str(path))
    return RIGHT


def packed(key: bytes | None) -> bytes:
    return Codec(mav, 255, 190, key).packed(mav.MAVLink_command_long_message(*_ARM))


def test_only_messages_with_a_valid_signature_are_taken_and_the_first_other_is_reported() -> None:
    reports: list[str] = []
    receiver = Codec(mav, 1, 1, RIGHT, reports.append)
    assert [m.get_type() for m in receiver.parsed("a", packed(RIGHT))] == ["COMMAND_LONG"]
    assert reports == []
    for other in (None, WRONG, WRONG):
        assert receiver.parsed("a", packed(other)) == []
    assert reports == ["MAVLink: messages without a valid signature are refused"]
    assert receiver.refused == 3
    assert len(Codec(mav, 1, 1).parsed("a", packed(None))) == 1


def test_a_recorded_message_is_refused_also_from_another_address() -> None:
    receiver, sent = Codec(mav, 1, 1, RIGHT), packed(RIGHT)
    assert len(receiver.parsed("a", sent)) == 1
    assert receiver.parsed("a", sent) == []
    assert receiver.parsed("b", sent) == []


def test_an_old_message_is_refused_after_a_restart(monkeypatch: pytest.MonkeyPatch) -> None:
    sent, now = packed(RIGHT), time.time()
    monkeypatch.setattr("uuvsim_cosim.bridge.mavlink.codec.time", lambda: now + 61.0)
    assert Codec(mav, 1, 1, RIGHT).parsed("a", sent) == []


def test_a_forged_time_does_not_lock_the_sender_out() -> None:
    sender = Codec(mav, 255, 190, RIGHT)
    forged = bytearray(sender.packed(mav.MAVLink_command_long_message(*_ARM)))
    forged[-12:-6] = b"\xff" * 6
    receiver = Codec(mav, 1, 1, RIGHT)
    assert receiver.parsed("a", bytes(forged)) == []
    good = sender.packed(mav.MAVLink_command_long_message(*_ARM))
    assert len(receiver.parsed("a", good)) == 1


def test_a_key_that_is_named_has_to_exist(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(KEY, raising=False)
    assert key_of_environment() is None
    empty = tmp_path / "empty"
    empty.write_text("\n")
    for path in (empty, tmp_path / "none"):
        monkeypatch.setenv(KEY, str(path))
        with pytest.raises(InputInvalid, match="is no file with a pass phrase"):
            key_of_environment()


def test_a_vehicle_with_a_key_signs_and_obeys_only_signed_commands(key: bytes) -> None:
    reports: list[str] = []
    with (
        Conductor(piloted()) as conductor,
        MavlinkServer(conductor, "tcpin:127.0.0.1:0", report=reports.append) as server,
    ):
        conductor.ask("run", ME, None, 5.0, ())
        port = server.ends[0].link.port
        stranger, owner = Ground(conductor, port), Ground(conductor, port)
        owner.wait("HEARTBEAT")  # pymavlink has changed to MAVLink 2, with a new parser
        owner.link.setup_signing(key, sign_outgoing=True)
        stranger.link.mav.command_long_send(*_ARM)
        refused: Any = stranger.wait("STATUSTEXT")
        assert "without a valid signature" in refused.text
        assert not server.ends[0].services.armed
        owner.arm(4)  # raises unless the answers carry a valid signature
        assert server.ends[0].services.armed
        assert owner.wait("HEARTBEAT").get_signed()
        assert len(reports) == 1
        for ground in (stranger, owner):
            ground.link.close()
