"""`uuvsim serve --ros2`: what the node offers, and what it closes, is printed."""

from __future__ import annotations

from pathlib import Path

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.bridge.access.certificates import make_certificates
from uuvsim_cosim.cli import status_of

ANY = ("--port", "0", "--tcp-port", "0", "--http-port", "0", "--no-record", "--until", "0.1")


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.chdir(tmp_path)
    uuv.load("bluerov2_hold").remove("guidance").write("setpoints.ssd")
    return ["serve", "setpoints.ssd", "--ros2", "jazzy", "--ros2-port", "0", *ANY]


def test_inputs_and_services_are_listed(
    served: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of(served) == 0
    out, err = capsys.readouterr()
    assert "3 inputs, 11 services, router at tcp/127.0.0.1:" in out
    assert "can read, set and step them, without token" in out
    assert ("input  /controller/cmd_vel  geometry_msgs/msg/Twist: controller.nu_d, "
            "time-out 0.5 s") in out  # fmt: skip
    assert "ROS 2" not in err


def test_with_an_access_file_inputs_and_services_are_closed_with_the_reason(
    served: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("access.yaml").write_text("users: {}\nanyone: observer\n")
    assert status_of([*served, "--access", "access.yaml"]) == 0
    out, err = capsys.readouterr()
    assert "0 inputs, 0 services" in out
    assert "can read them, without token" in out
    assert "ROS 2: inputs and services are closed, because a ROS 2 node proves no identity" in err


def test_a_mistake_in_the_inputs_ends_the_command(
    served: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    Path("t.yaml").write_text(
        "topics: []\ninputs:\n"
        "  - {topic: /v, type: geometry_msgs/msg/Twist, signals: {nu: controller.nu_f}}\n"
    )
    assert status_of([*served, "--topics", "t.yaml"]) == 2
    assert "t.yaml:3: /v: no signal 'controller.nu_f'; expected one such" in capsys.readouterr().err


def test_with_an_authority_of_certificates_the_node_is_reachable_by_roles(
    served: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    make_certificates("pki", clients=["rov-1"])
    Path("access.yaml").write_text(
        "tls: {certificate: pki/server.pem, key: pki/server-key.pem, ca: pki/ca.pem, "
        "roles: {rov-1: controller}}\n"
    )
    assert status_of([*served, "--access", "access.yaml", "--host", "0.0.0.0"]) == 0
    out, err = capsys.readouterr()
    assert "3 inputs, 11 services, router at tls/0.0.0.0:" in out
    assert "a certificate of its CA can use them by their role: rov-1 (controller), others: " in out
    assert "ROS 2" not in err


def test_without_an_authority_the_node_stays_on_this_machine_with_the_reason(
    served: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert status_of([*served, "--anyone", "--host", "0.0.0.0"]) == 0
    out, err = capsys.readouterr()
    assert "router at tcp/127.0.0.1:" in out
    assert "ROS 2: stays at tcp/127.0.0.1:" in err
    assert "expected tls with `ca` in the file of --access" in err
