"""ArduSub as a component, with a fake autopilot that has the faults of real ones."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega

import uuvsim_cosim as uuv
from tests.bridge.autopilots.conftest import at_free_instance
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.autopilots.ardusub import ArduSub, source, thruster_commands
from uuvsim_cosim.bridge.autopilots.commands import AutopilotCommands
from uuvsim_cosim.bridge.autopilots.json_interface import JsonLink
from uuvsim_cosim.bridge.autopilots.sitl_process import HOME
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import (
    configuration_matrix,
    thruster_geometry,
)
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.shipped.autopilot import with_autopilot, with_binary
from uuvsim_cosim.orchestrator.system.system import System

# ArduPilot, AP_Motors6DOF, frame vectored_6dof: roll, pitch, yaw, throttle (up), forward, lateral.
FACTORS = np.array([
    [0, 0, 1, 0, -1, 1], [0, 0, -1, 0, -1, -1], [0, 0, -1, 0, 1, 1], [0, 0, 1, 0, 1, -1],
    [1, -1, 0, -1, 0, 0], [-1, -1, 0, -1, 0, 0], [1, 1, 0, -1, 0, 0], [-1, 1, 0, -1, 0, 0],
])  # fmt: skip
DATA = Path(__file__).parent / "recorded_ardusub.npz"


SILENCE = 3  # s that the tests of a silent autopilot wait


def system(
    fake: Path, options: str = "", warm_up: float = 0.0, timeout: float = PATIENCE
) -> System:
    """The smallest vehicle, with the fake autopilot on board."""
    link = f"ardusub:?timeout={timeout}{options}"
    made = with_autopilot(uuv.load("bluerov2_hold"), "controller", link)
    made = with_binary(made.remove("guidance"), str(fake))
    return made.set("controller.eta_d", [0, 0, 5, 0, 0, 0]).set("controller.warm_up", warm_up)


def flown(
    fake: Path, out: Path, fault: str, monkeypatch: pytest.MonkeyPatch, until: float = 0.5,
    options: str = "",
) -> uuv.Signals:  # fmt: skip
    monkeypatch.setenv("FAKE", fault)
    timeout = SILENCE if fault.startswith("silent") else PATIENCE
    made = system(fake, options, timeout=timeout)
    return run(made, until=until, out=out, backend="native").signals()


def test_a_command_of_each_axis_pushes_this_vehicle_along_that_axis() -> None:
    B = configuration_matrix(thruster_geometry("bluerov2_heavy"))
    for axis, wanted in enumerate([3, 4, 5, 2, 0, 1]):  # of roll, pitch, …, lateral: K M N Z X Y
        widths = (1500 + 300 * FACTORS[:, axis]).astype(int)
        tau = B @ thruster_commands(widths.tolist())
        sign = -1.0 if axis == 3 else 1.0  # throttle is up, Z is down
        assert sign * tau[wanted] > 0
        # Forces in the plane of the horizontal thrusters, off CO, also turn the vehicle.
        others = np.delete(tau[:3], [a for a in (wanted,) if a < 3])
        np.testing.assert_allclose(others, 0.0, atol=1e-6)


def test_no_pulses_and_pulses_in_the_middle_are_no_command() -> None:
    np.testing.assert_array_equal(thruster_commands([0, 1500] * 4), np.zeros(8))


def test_it_dives_by_the_packets_and_leaves_no_process_and_no_folder(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    signals = flown(fake, tmp_path / "run", "", monkeypatch, until=12.0)
    assert signals["hull.eta"][-1, 2] == pytest.approx(5.0, abs=0.6)
    assert signals["controller.armed"][-1]
    assert signals["controller.mode_now"][-1] == 4
    np.testing.assert_array_equal(np.diff(signals["controller.frame"]), 1)
    assert not list(tmp_path.glob("uuvsim-ardusub-*"))


@pytest.mark.parametrize("fault", ["repeats", "lost", "short", "long", "magic", "early"])
def test_packets_that_are_wrong_or_repeated_change_no_bit(
    fake: Path, tmp_path: Path, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = flown(fake, tmp_path / "plain", "", monkeypatch)
    disturbed = flown(fake, tmp_path / "disturbed", f"{fault}:100", monkeypatch)
    for name in plain:
        np.testing.assert_array_equal(plain[name], disturbed[name], err_msg=name)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("silent", rf"no answer for {SILENCE} s; expected .*\?timeout="),
        ("dies", r"ended by signal 6; its last line is 'segmentation fault'"),
        ("restarts", r"it started again .*reset the simulation"),
        ("skips", r"frame 105 after 99; expected frame 100"),
        ("flood", r"packets in a row that are not the next one"),
    ],
)
def test_a_lost_autopilot_is_named_and_the_recording_is_complete(
    fake: Path, tmp_path: Path, fault: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ComponentFailed, match=message) as caught:
        flown(fake, tmp_path / "run", f"{fault}:100", monkeypatch)
    assert caught.value.path == "controller"
    assert caught.value.recording is not None
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    assert read_signals(caught.value.recording).time[-1] == pytest.approx(0.2475, abs=0.003)


def test_an_autopilot_that_ends_between_two_of_its_loops_gets_the_state_that_it_waits_for(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    flown(fake, tmp_path / "run", "polite", monkeypatch, until=0.1, options=f"&folder={folder}")
    assert (folder / "output.txt").read_text().splitlines()[-1] == "ends between two loops"
    lines = [x.split(" ", 1)[1] for x in (folder / "received.txt").read_text().splitlines() if x]
    last, before = (json.loads(x) for x in (lines[-1], lines[-2]))
    assert last.pop("timestamp") > before.pop("timestamp")
    assert last == before


def test_an_autopilot_that_ends_before_its_serial_port_is_there_is_named(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ComponentFailed, match=r"status 1; its last line is 'bind port failed'"):
        flown(fake, tmp_path / "run", "no_port", monkeypatch)


def test_each_run_needs_an_empty_folder(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "used").mkdir()
    (tmp_path / "used" / "eeprom.bin").write_bytes(b"0")
    with pytest.raises(ComponentFailed, match="is not empty"):
        flown(fake, tmp_path / "run", "", monkeypatch, options=f"&folder={tmp_path / 'used'}")


def test_commands_are_there_before_the_state_of_their_tick(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "arm.yaml"
    scenario.write_text("events:\n- {at: 0.13, set: controller.eta_d, value: [1, 2, 3, 0, 0, 0]}\n")
    monkeypatch.delenv("FAKE", raising=False)
    folder = tmp_path / "folder"
    run(system(fake, f"&folder={folder}").set("controller.setpoint_period", 0.0), until=0.2,
        out=tmp_path / "run", backend="native", scenario=scenario)  # fmt: skip
    lines = [text.split(" ", 1) for text in (folder / "received.txt").read_text().splitlines()]
    lines = [line for line in lines if len(line) == 2]
    sent = {json.loads(text)["timestamp"]: int(count) for count, text in lines}
    assert {t for t, count in sent.items() if count} == {0.0, 0.1, 0.13}
    assert sent[0.13] > 50  # the position; no other message is due


def test_a_target_that_moves_is_sent_with_its_velocity_and_a_waypoint_without() -> None:
    here, there = socket.socketpair()
    commands = AutopilotCommands(here)
    commands.position(12.5, [1.0, 2.0, 5.0, 0.0, 0.0, np.pi / 2])
    commands.position(13.0, [1.0, 2.0, 5.0, 0.0, 0.0, np.pi / 2], [0.4, 0.1, 0.2, 0.0, 0.0, 0.3])
    commands.flush()
    waypoint, target = ardupilotmega.MAVLink(None).parse_buffer(there.recv(4096))
    here.close()
    there.close()
    ignored = ardupilotmega.POSITION_TARGET_TYPEMASK_VX_IGNORE
    used = ardupilotmega.POSITION_TARGET_TYPEMASK_YAW_IGNORE
    accelerations = ardupilotmega.POSITION_TARGET_TYPEMASK_AX_IGNORE
    assert waypoint.type_mask & ignored
    assert not target.type_mask & ignored
    assert not waypoint.type_mask & used
    assert not target.type_mask & used
    assert target.type_mask & accelerations
    # 0.4 ahead is east when the bow points east, and 0.1 to starboard is south
    assert (target.vx, target.vy, target.vz) == pytest.approx((-0.1, 0.4, 0.2))
    assert (target.x, target.y, target.z) == pytest.approx((1.0, 2.0, 5.0))


def test_a_target_that_moved_is_sent_again_when_it_has_stopped(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "moves.yaml"
    scenario.write_text(
        "events:\n- {at: 0.1, set: controller.nu_d, value: [0.3, 0, 0, 0, 0, 0]}\n"
        "- {at: 0.2, set: controller.nu_d, value: [0, 0, 0, 0, 0, 0]}\n"
    )
    monkeypatch.delenv("FAKE", raising=False)
    folder = tmp_path / "folder"
    run(system(fake, f"&folder={folder}").set("controller.setpoint_period", 0.02), until=0.4,
        out=tmp_path / "run", backend="native", scenario=scenario)  # fmt: skip
    lines = [text.split(" ", 1) for text in (folder / "received.txt").read_text().splitlines()]
    sent = {json.loads(line[1])["timestamp"]: int(line[0]) for line in lines if len(line) == 2}
    assert not any(count for t, count in sent.items() if 0.06 <= t < 0.1)  # a waypoint, once
    assert sum(count > 50 for t, count in sent.items() if 0.1 <= t < 0.4) == 15  # each 0.02 s


def test_the_commands_that_were_sent_are_recorded(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "moves.yaml"
    scenario.write_text(
        "events:\n- {at: 0.1, set: controller.eta_d, value: [1, 2, 4, 0, 0, 1.5]}\n"
        "- {at: 0.1, set: controller.nu_d, value: [0.3, 0, 0.2, 0, 0, 0]}\n"
        "- {at: 0.1, set: controller.manual, value: [0.5, 0, 0, 0, 0, -1]}\n"
        "- {at: 0.3, set: controller.mode, value: 2}\n"
    )
    monkeypatch.delenv("FAKE", raising=False)
    signals = run(system(fake).set("controller.setpoint_period", 0.02), until=0.4,
                  out=tmp_path / "run", backend="native", scenario=scenario).signals()  # fmt: skip

    def at(time: float, name: str) -> list[float]:
        row = int(np.searchsorted(signals.time, time - 1e-6))
        return np.ravel(signals[f"controller.{name}"][row]).tolist()

    sent = [(at(t, "setpoint_kind"), at(t, "setpoint_pose")) for t in (0.0, 0.05, 0.2, 0.35)]
    assert sent == [
        ([0], [0, 0, 0, 0]), ([1], [0, 0, 5, 0]), ([2], [1, 2, 4, 1.5]), ([0], [0, 0, 0, 0]),
    ]  # fmt: skip
    assert at(0.05, "setpoint_velocity") == [0, 0, 0]
    assert at(0.2, "setpoint_velocity") == [0.3 * np.cos(1.5), 0.3 * np.sin(1.5), 0.2]
    assert (at(0.05, "pilot"), at(0.25, "pilot")) == ([0] * 6, [0.5, 0, 0, 0, 0, -1])
    assert not any(signals["controller.has_target"])  # the fake one reports none


def test_the_target_that_the_autopilot_reports_is_read_in_n() -> None:
    here, there = socket.socketpair()
    commands = AutopilotCommands(here)
    speaks = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
    place = [HOME[0] + np.degrees(12.0 / 6_378_100.0),
             HOME[1] + np.degrees(-7.0 / 6_378_100.0 / np.cos(np.radians(HOME[0])))]  # fmt: skip
    reported = []
    for message in (
        ardupilotmega.MAVLink_position_target_global_int_message(
            0, 5, 0xFFF8, *(round(1e7 * x) for x in place), -4.5, *[0.0] * 8
        ),
        ardupilotmega.MAVLink_position_target_local_ned_message(
            0, 1, 0xDF8, 1.0, 2.0, 3.0, *[0.0] * 8
        ),
        ardupilotmega.MAVLink_position_target_local_ned_message(
            0, 1, 0xDC7, 1.0, 2.0, 3.0, *[0.0] * 8
        ),
    ):
        there.sendall(message.pack(speaks))
        commands.read()
        reported.append(commands.target)
    here.close()
    there.close()
    assert reported[0] == pytest.approx((12.0, -7.0, 4.5), abs=0.02)
    assert reported[1:] == [(1.0, 2.0, 3.0), None]  # the last one has only a velocity


def test_a_target_that_is_no_longer_reported_ends(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    signals = flown(fake, tmp_path / "run", "reports:100", monkeypatch, until=2.5)
    has, target = signals["controller.has_target"], signals["controller.target"]
    assert signals.time[has][[0, -1]] == pytest.approx([0.25, 1.75], abs=0.02)
    np.testing.assert_array_equal(target[has], [[1, 2, 3]] * int(has.sum()))
    np.testing.assert_array_equal(target[~has], 0.0)


def test_before_the_start_the_vehicle_is_lowered_from_the_surface(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    folder = tmp_path / "folder"
    run(system(fake, f"&folder={folder}", warm_up=2.0), until=0.01, out=tmp_path / "run",
        backend="native")  # fmt: skip
    lines = [x.split(" ", 1)[1] for x in (folder / "received.txt").read_text().splitlines() if x]
    states = [json.loads(x) for x in lines][:800]
    depth = np.array([s["position"][2] for s in states])
    speed = np.array([s["velocity"][2] for s in states])
    assert depth[0] == 0.0
    assert depth[-1] == pytest.approx(1.0)
    np.testing.assert_allclose(np.gradient(depth, 0.0025), speed, atol=0.02)
    force = np.array([s["imu"]["accel_body"][2] for s in states])
    np.testing.assert_allclose(np.gradient(speed, 0.0025), force + 9.80665, atol=0.2)


def test_two_vehicles_have_two_autopilots(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    pair = System("pair", "0.0025").add("a", system(fake)).add("b", system(fake))
    signals = run(pair, until=0.5, out=tmp_path / "run", backend="native").signals()
    np.testing.assert_array_equal(signals["a.hull.eta"], signals["b.hull.eta"])
    assert signals["a.hull.eta"][-1, 2] > 1.0


def test_a_snapshot_is_refused_with_the_reason(fake: Path, tmp_path: Path) -> None:
    component = source(f"ardusub:?binary={fake}", tmp_path).instantiate("controller")
    with pytest.raises(FmuError, match=r"is in another process, which cannot copy it"):
        component.get_fmu_state()
    assert not component.description.can_get_and_set_state


def test_a_fail_safe_that_disarms_just_after_the_confirmation_is_not_overruled(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    armed = flown(fake, tmp_path / "run", "disarms:5", monkeypatch, until=2.5)["controller.armed"]
    assert armed.any()
    assert not armed[-1]


def test_two_autopilots_have_ports_ten_apart(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    pair = System("pair", "0.0025")
    links = at_free_instance(lambda n: [JsonLink(n, 1.0), JsonLink(n + 1, 1.0)])
    n = (links[0].port - 9002) // 10
    for link in links:
        link.close()
    for name, instance in (("a", n), ("b", n + 1)):
        options = f"&instance={instance}&folder={tmp_path / name}"
        pair = pair.add(name, system(fake, options))
    run(pair, until=0.01, out=tmp_path / "run", backend="native")
    ports = [(tmp_path / name / "output.txt").read_text().splitlines()[1] for name in "ab"]
    assert ports == [
        f"serial port {5760 + 10 * k}, physics port {9002 + 10 * k}" for k in (n, n + 1)
    ]


def test_a_fault_on_one_vehicle_does_not_reach_the_autopilot_of_another(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    scenario = tmp_path / "deaf.yaml"
    scenario.write_text(
        "events:\n- {at: 0.1, signal: 'a.hull.eta[3]', fault: override, value: 9.0, until: 9}\n"
    )
    pair = System("pair", "0.0025").add("a", system(fake)).add("b", system(fake))
    signals = run(pair, until=3.0, out=tmp_path / "run", backend="native",
                  scenario=scenario).signals()  # fmt: skip
    np.testing.assert_array_equal(signals["a.controller.u"][-1, 4:], np.ones(4))  # upwards
    assert (signals["b.controller.u"][-1, 4:] < 0.0).all()


# Place of each signal from the vehicle in a line of state.
STATE = {
    "hull.eta[1]": ("position", 0), "hull.eta[3]": ("position", 2), "hull.eta[6]": ("attitude", 2),
    "hull.q[2]": ("quaternion", 1), "hull.nu[4]": ("imu", "gyro", 0),
    "hull.nu_dot[1]": ("imu", "accel_body", 0), "battery.voltage": ("battery", "voltage"),
    "wrench.current_total": ("battery", "current"),
}  # fmt: skip


@pytest.mark.parametrize(
    ("signal", "fault", "value"),
    [
        *((s, "override", 0.5) for s in STATE), ("hull.eta[3]", "bias", 1.0),
        ("hull.eta[3]", "scale", 2.0), ("hull.eta[3]", "freeze", None),
        ("hull.eta[3]", "delay", 0.1), ("hull.eta[3]", "drop", 0.5),
    ],
)  # fmt: skip
def test_a_fault_of_any_kind_on_any_signal_of_the_state_reaches_the_autopilot(
    fake: Path, tmp_path: Path, signal: str, fault: str, value: float | None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.delenv("FAKE", raising=False)
    states: list[np.ndarray] = []
    for events in ("[]", f"[{{at: 0.5, signal: '{signal}', fault: {fault}"
                   + ("" if value is None else f", value: {value}") + "}]"):  # fmt: skip
        folder, scenario = tmp_path / f"folder{len(states)}", tmp_path / "scenario.yaml"
        scenario.write_text(f"events: {events}\n")
        vehicle = with_binary(uuv.load("bluerov2_ardusub"), str(fake)).set("controller.warm_up", 0)
        source = vehicle.components["controller"].source
        run(vehicle.replace("controller", f"{source}&folder={folder}"), until=1.0,
            out=tmp_path / f"run{len(states)}", backend="native", scenario=scenario)  # fmt: skip
        lines = [x.split(" ", 1) for x in (folder / "received.txt").read_text().splitlines() if x]
        read: Any = [json.loads(x[1]) for x in lines]
        for key in STATE[signal]:
            read = [x[key] for x in read]
        states.append(np.array(read))
    true, received = states
    np.testing.assert_array_equal(true[:200], received[:200])  # before the fault
    assert not np.array_equal(true[200:], received[200:])
    if fault == "override":
        np.testing.assert_array_equal(received[210:], 0.5)


def test_faults_of_the_dvl_and_the_usbl_reach_the_autopilot_by_mavlink(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        "events:\n- {at: 0, signal: 'dvl.velocity[1]', fault: override, value: 9}\n"
        "- {at: 2, signal: dvl.valid, fault: override, value: 0}\n"
        "- {at: 0, signal: 'usbl.position[3]', fault: override, value: 7}\n"
    )
    folder = tmp_path / "folder"
    text = f"ardusub:?navigation=sensors&folder={folder}"
    vehicle = with_binary(
        with_autopilot(uuv.load("bluerov2_survey"), "controller", text), str(fake)
    )
    run(vehicle.set("controller.warm_up", 0.0), until=4.0, out=tmp_path / "run",
        backend="native", scenario=scenario)  # fmt: skip
    mavlink = ardupilotmega.MAVLink(None)
    messages = mavlink.parse_buffer((folder / "serial.bin").read_bytes())
    moved = [m for m in messages if m.get_type() == "VISION_POSITION_DELTA"]
    speeds = [m.position_delta[0] / (1e-6 * m.time_delta_usec) for m in moved]
    assert speeds[1:] == pytest.approx([9.0] * (len(speeds) - 1))
    assert len(speeds) > 3
    assert max(m.time_usec for m in moved) <= 2.1e6  # then the DVL has no bottom track
    fixes = [m for m in messages if m.get_type() == "GPS_INPUT"]
    assert fixes[-1].alt == pytest.approx(-7.0)


def test_fixes_of_the_systems_gps_reach_the_autopilot_at_the_surface_and_none_below(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    folder = tmp_path / "folder"
    vehicle = uuv.load("bluerov2_hold").set("hull.eta_0", [0.0] * 6).add("gps", "model:gps")
    for signal in ("eta", "q", "nu"):
        vehicle = vehicle.connect(f"hull.{signal}", f"gps.{signal}")
    text = f"ardusub:?navigation=sensors&folder={folder}"
    vehicle = vehicle.set("gps.r_s", [0.0, 0.0, -0.6])  # a mast: CO lies 0.3 m deep at rest
    vehicle = with_autopilot(vehicle.remove("guidance"), "controller", text)
    vehicle = with_binary(vehicle.set("controller.warm_up", 0.0), str(fake))
    scenario = tmp_path / "dive.yaml"  # the fake one dives when it is armed
    scenario.write_text("events:\n- {at: 3.5, set: controller.arm, value: true}\n")
    signals = run(vehicle.set("controller.arm", False), until=8.0, out=tmp_path / "run",
                  backend="native", scenario=scenario).signals()  # fmt: skip
    messages = ardupilotmega.MAVLink(None).parse_buffer((folder / "serial.bin").read_bytes())
    fixes = [m for m in messages if m.get_type() == "GPS_INPUT"]
    assert [1e-6 * m.time_usec for m in fixes] == pytest.approx([2.0, 3.0], abs=0.01)
    altitudes = [-signals["gps.position"][np.searchsorted(signals.time, t), 2] for t in (2.5, 3.5)]
    assert [m.alt for m in fixes] == pytest.approx(altitudes)
    assert signals["gps.t_sample"][-1] == 3.0


@pytest.mark.parametrize("channel", range(1, 9))
def test_a_fault_on_a_command_of_the_autopilot_reaches_that_thruster_alone(
    fake: Path, tmp_path: Path, channel: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(
        f"events:\n- {{at: 0.1, signal: 'controller.u[{channel}]', fault: override, value: 0.7}}\n"
    )
    signals = run(system(fake), until=0.5, out=tmp_path / "run", backend="native",
                  scenario=scenario).signals()  # fmt: skip
    forced = np.isclose(signals["controller.u"][-1], 0.7)
    np.testing.assert_array_equal(np.flatnonzero(forced) + 1, [channel])
    assert abs(signals[f"thruster_{channel}.thrust"][-1]) > 1.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ardusub:?binry=x", "option 'binry'; expected .*binary"),
        ("ardusub:?instance=two", "instance 'two'; expected 0 or more"),
        ("ardusub:?timeout=soon", "timeout 'soon'; expected seconds"),
        ("ardusub:?navigation=stars", "navigation 'stars'; expected gps or sensors"),
        ("ardusub:?parameters=no.parm", "no such file"),
    ],
)
def test_a_wrong_option_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputInvalid, match=message):
        source(text, tmp_path)


def test_a_missing_binary_and_that_of_a_copter_are_refused_with_the_way_to_obtain_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputInvalid, match=r"ardusub in the PATH: no such file.*waf sub"):
        source("ardusub:", tmp_path).instantiate("controller")
    copter = tmp_path / "arducopter"
    copter.write_bytes(b"\x7fELF ArduCopter V4.6.0")
    with pytest.raises(InputInvalid, match=r"is ArduCopter; expected ArduSub's"):
        source(f"ardusub:?binary={copter}", tmp_path).instantiate("controller")
    copter.write_bytes(b"ArduSub V4.5")
    copter.chmod(0o644)
    if os.geteuid() != 0:
        with pytest.raises(InputInvalid, match=r"may not be executed"):
            source(f"ardusub:?binary={copter}", tmp_path).instantiate("controller")


def test_the_same_recorded_packets_give_the_same_bits_and_the_recorded_depth(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = np.load(DATA)
    file = tmp_path / "packets.bin"
    file.write_bytes(data["widths"].astype("<u2").tobytes())
    until = (len(data["widths"]) - 2) * 0.0025
    both = [flown(fake, tmp_path / str(i), f"replay:{file}", monkeypatch, until) for i in (1, 2)]
    for name in both[0]:
        np.testing.assert_array_equal(both[0][name], both[1][name], err_msg=name)
    np.testing.assert_array_equal(
        both[0]["controller.pwm"], data["widths"][: len(both[0].time), :16]
    )
    np.testing.assert_allclose(
        both[0]["hull.eta"][::40, 2], data["depth"][: len(both[0].time) : 40], atol=1e-9
    )


def test_recorded_bytes_of_the_autopilot_are_read() -> None:
    import socket

    ours, other = socket.socketpair()
    with ours, other:
        commands = AutopilotCommands(ours)
        other.sendall(np.load(DATA)["mavlink"].tobytes())
        commands.read()
        assert "ArduPilot Ready" in commands.texts
        assert (commands.armed, commands.mode) == (False, 19)
        other.sendall(b"\xfd\x09nonsense" * 20)
        commands.read()
        assert commands.mode == 19


def test_a_run_notes_packets_that_were_not_used(
    fake: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FAKE", "short:20")
    done = run(system(fake), until=0.1, out=tmp_path / "run", backend="native")
    assert done.warnings[-1] == "controller: packets that were not used: 2 invalid"


def test_commands_that_the_autopilot_refuses_are_counted_by_their_names() -> None:
    here, there = socket.socketpair()
    with here, there:
        commands = AutopilotCommands(here)
        speaks = ardupilotmega.MAVLink(None, srcSystem=1, srcComponent=1)
        for command, result in ((176, 4), (400, 0), (176, 4), (64_000, 3)):
            message = ardupilotmega.MAVLink_command_ack_message(command, result)
            there.sendall(message.pack(speaks))
        commands.read()
    assert commands.refused == {
        ("MAV_CMD_DO_SET_MODE", "MAV_RESULT_FAILED"): 2, (64_000, "MAV_RESULT_UNSUPPORTED"): 1,
    }  # fmt: skip


def test_an_autopilot_with_other_options_keeps_the_values_of_the_one_before() -> None:
    before = uuv.load("bluerov2_ardusub").set("controller.warm_up", 60.0)
    after = with_autopilot(before, "controller", "ardusub:?timeout=5")
    assert after.components["controller"].start == before.components["controller"].start
    px4 = with_autopilot(before, "controller", "px4:").components["controller"].start
    assert px4 == {"arm": True, "mode": 6, "eta_d": (0.0, 0.0, 5.0, 0.0, 0.0, 0.0)}


def test_a_file_with_the_name_of_the_scheme_in_the_current_folder_is_not_the_source(
    fake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(fake.parent)
    made = with_autopilot(uuv.load("bluerov2_ardusub"), "controller", "ardusub:?timeout=5")
    assert made.components["controller"].source == "ardusub:?timeout=5"


def test_a_component_is_not_an_autopilot_without_thrusters() -> None:
    with pytest.raises(InputInvalid, match="no allocation of 8 thrusters"):
        with_autopilot(uuv.load("bluerov2_hold").remove("allocation"), "controller")
    with pytest.raises(InputInvalid, match="no component of the system is ArduSub"):
        with_binary(uuv.load("bluerov2_hold"), "ardusub")


def test_the_interface_needs_no_binary(tmp_path: Path) -> None:
    described = source("ardusub:", tmp_path).describe()
    assert described.variables["u"].size == 8
    assert ArduSub is not None
