"""PX4 as a component, with a PX4 end that was written from the protocol's pages alone."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import uuvsim_cosim as uuv
from tests.bridge.waiting import PATIENCE
from uuvsim_cosim.bridge.autopilots.px4 import source, thruster_commands
from uuvsim_cosim.errors import ComponentFailed, FmuError, InputInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import (
    configuration_matrix,
    thruster_geometry,
)
from uuvsim_cosim.orchestrator.running.run import run
from uuvsim_cosim.orchestrator.shipped.autopilot import with_autopilot, with_binary
from uuvsim_cosim.orchestrator.system.system import System

# PX4, airframe 60002_gz_uuv_bluerov2_heavy: CA_ROTORi_A and CA_ROTORi_P, axes and positions in FRD.
AXES = np.array([
    [1, -1, 0], [1, 1, 0], [1, 1, 0], [1, -1, 0], [0, 0, -1], [0, 0, 1], [0, 0, 1], [0, 0, -1],
])  # fmt: skip
PLACES = np.array([
    [0.14, 0.1, 0.06], [0.14, -0.1, 0.06], [-0.14, 0.1, 0.06], [-0.14, -0.1, 0.06],
    [0.12, 0.22, 0], [0.12, -0.22, 0], [-0.12, 0.22, 0], [-0.12, -0.22, 0],
])  # fmt: skip
FIELD = np.array([0.18580, 0.04954, 0.48860])  # G
RHO, G, P_ATM = 1025.0, 9.80665, 101325.0


SILENCE = 3  # s that the tests of a silent PX4 wait


def system(
    px4: Path, options: str = "", warm_up: float = 0.0, noise: bool = False,
    timeout: float = PATIENCE,
) -> System:  # fmt: skip
    """The smallest vehicle, with the PX4 end on board."""
    link = f"px4:?timeout={timeout}{options}"
    made = with_autopilot(uuv.load("bluerov2_hold"), "controller", link)
    made = with_binary(made.remove("guidance"), str(px4), "px4")
    made = made.set("controller.eta_d", [0, 0, 5, 0, 0, 0]).set("controller.warm_up", warm_up)
    return made if noise else made.set("controller.noise", [0.0] * 4)


def flown(
    px4: Path, out: Path, fault: str, monkeypatch: pytest.MonkeyPatch, until: float = 0.5,
    options: str = "", warm_up: float = 0.0, noise: bool = False, scenario: Path | None = None,
) -> uuv.Signals:  # fmt: skip
    monkeypatch.setenv("FAKE", fault)
    is_silent = fault.startswith(("silent", "wrong", "never_connects"))
    made = system(px4, options, warm_up, noise, SILENCE if is_silent else PATIENCE)
    return run(made, until=until, out=out, backend="native", scenario=scenario).signals()


def received(folder: Path, name: str, api: bool = False) -> list[dict[str, Any]]:
    """Messages that the PX4 end has read, by name."""
    lines = [json.loads(line) for line in (folder / "received.txt").read_text().splitlines()]
    return [m for m in lines if m["name"] == name and ("api" in m) == api]


def test_each_demand_of_px4s_allocation_pushes_this_vehicle_along_its_axis() -> None:
    axes = AXES / np.linalg.norm(AXES, axis=1, keepdims=True)
    effect = np.hstack([axes, np.cross(PLACES, axes)]).T  # force and moment of each motor
    B = configuration_matrix(thruster_geometry("bluerov2_heavy"))
    for axis in range(6):
        controls = np.linalg.pinv(effect)[:, axis]
        tau = B @ thruster_commands((controls / np.abs(controls).max()).tolist())
        assert tau[axis] > 0.1
        others = np.delete(tau[:3], [a for a in (axis,) if a < 3])
        np.testing.assert_allclose(others, 0.0, atol=1e-6)


def test_it_dives_by_the_controls_and_leaves_no_process_and_no_folder(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    signals = flown(px4, tmp_path / "run", "", monkeypatch, until=12.0, noise=True)
    assert signals["hull.eta"][-1, 2] == pytest.approx(5.0, abs=0.6)
    assert signals["controller.armed"][-1]
    assert signals["controller.mode_now"][-1] == 6
    np.testing.assert_array_equal(np.diff(signals["controller.frame"]), 1)
    assert signals["controller.lights"][-1] == 0.25
    assert signals["controller.gripper"][-1] == -0.5
    assert signals["controller.tilt"][-1] == 0.75
    assert not list(tmp_path.glob("uuvsim-px4-*"))


def test_it_starts_unarmed_and_the_commands_of_the_first_step_arm_it(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    signals = flown(px4, tmp_path / "run", "", monkeypatch, options=f"&folder={folder}")
    assert not signals["controller.armed"][0]
    assert signals["controller.armed"][1]
    ticks = [m["time_usec"] for m in received(folder, "HIL_SENSOR")]
    assert ticks[0] == 1
    np.testing.assert_array_equal(np.diff(ticks), 2500)


@pytest.mark.parametrize("fault", ["garbage", "twice", "pieces"])
def test_bytes_that_are_damaged_repeated_or_in_pieces_change_no_bit(
    px4: Path, tmp_path: Path, fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = flown(px4, tmp_path / "plain", "", monkeypatch)
    disturbed = flown(px4, tmp_path / "disturbed", f"{fault}:100", monkeypatch)
    for name in plain:
        np.testing.assert_array_equal(plain[name], disturbed[name], err_msg=name)


def test_the_same_controls_give_the_same_bits_of_the_plant(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = np.random.default_rng(5).uniform(-1.2, 1.2, (500, 8)).astype("<f4")
    file = tmp_path / "controls.bin"
    file.write_bytes(rows.tobytes())
    both = [
        flown(px4, tmp_path / str(i), f"replay:{file}", monkeypatch, 1.0, noise=True)
        for i in (1, 2)
    ]
    for name in both[0]:
        np.testing.assert_array_equal(both[0][name], both[1][name], err_msg=name)
    # The first outputs are those before the command to arm.
    flown_by = both[0]["controller.controls"][1:, :8]
    np.testing.assert_array_equal(flown_by, rows[: len(flown_by)])
    assert np.abs(both[0]["hull.nu"][-1]).max() > 0.01


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("silent", rf"time \d+ µs: no answer for {SILENCE} s; expected .*\?timeout="),
        ("wrong", rf"no answer for {SILENCE} s"),
        ("dies", r"ended by signal 6; its last line is 'ERROR \[px4\] segmentation fault'"),
        ("disconnects", r"it closed its connection; expected one connection until the end"),
        ("reconnects", r"it closed its connection and connected again"),
        ("nan", r"control 3 is nan at \d+ µs; expected finite controls"),
        ("no_lockstep", r"it runs without lockstep .*make px4_sitl_default"),
        ("back", r"its time fell from \d+ to -?\d+ µs; expected one start for each run"),
        ("ahead", r"µs after HIL_SENSOR of \d+ µs; expected a clock that only this"),
        ("flood", r"10000 messages in a row that are not the answer"),
    ],
)
def test_a_lost_autopilot_is_named_and_the_recording_is_complete(
    px4: Path, tmp_path: Path, fault: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ComponentFailed, match=message) as caught:
        flown(px4, tmp_path / "run", f"{fault}:500", monkeypatch, until=3.0)
    assert caught.value.path == "controller"
    assert caught.value.recording is not None
    from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

    assert read_signals(caught.value.recording).time[-1] == pytest.approx(500 * 0.0025)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("ends", r"ended with status 1; its last line is .*already running for instance 0"),
        ("never_connects", rf"before its first output: did not connect for {SILENCE} s"),
        ("never_answers", r"PX4: no actuator output for 0.2 s; expected .*\?boot="),
    ],
)
def test_an_autopilot_that_does_not_start_is_named(
    px4: Path, tmp_path: Path, fault: str, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ComponentFailed, match=message):
        flown(px4, tmp_path / "run", fault, monkeypatch, options="&boot=0.2")


def test_at_rest_the_sensors_have_their_closed_forms(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    monkeypatch.setenv("FAKE", "")
    made = system(px4, f"&folder={folder}")
    phi, theta, psi = 0.3, -0.2, 1.1
    half = np.array([phi, theta, psi]) / 2
    (a, b, c), (d, e, f) = np.cos(half), np.sin(half)
    q = [a * b * c + d * e * f, d * b * c - a * e * f, a * e * c + d * b * f, a * b * f - d * e * c]
    component = source(str(made.components["controller"].source), tmp_path).instantiate("px4")
    known = component.description.variables
    component.set(known["warm_up"], 0.0)
    component.set(known["noise"], np.zeros(4))
    component.set(known["eta"], np.array([30.0, -20.0, 12.0, phi, theta, psi]))
    component.set(known["q"], np.array(q))
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    component.do_step(0.0, 0.0025)
    component.terminate()
    m = received(folder, "HIL_SENSOR")[-1]
    sf, cf, st, ct = math.sin(phi), math.cos(phi), math.sin(theta), math.cos(theta)
    force = [G * st, -G * ct * sf, -G * ct * cf]
    assert [m["xacc"], m["yacc"], m["zacc"]] == pytest.approx(force, rel=1e-6)
    assert [m["xgyro"], m["ygyro"], m["zgyro"]] == [0.0] * 3
    assert m["abs_pressure"] == pytest.approx((P_ATM + RHO * G * 12.0) / 100.0, rel=1e-6)
    # The field has the same components along and across the vertical in each attitude.
    mag = np.array([m["xmag"], m["ymag"], m["zmag"]])
    down = -np.array(force) / G
    assert np.linalg.norm(mag) == pytest.approx(np.linalg.norm(FIELD), rel=1e-6)
    assert mag @ down == pytest.approx(FIELD[2], rel=1e-6)
    bow = np.array([ct * math.cos(psi), ct * math.sin(psi), -st])  # in NED
    assert mag[0] == pytest.approx(FIELD @ bow, rel=1e-6)


def test_hil_gps_comes_at_the_surface_only(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    flown(px4, tmp_path / "run", "", monkeypatch, until=0.01, options=f"&folder={folder}",
          warm_up=4.0)  # fmt: skip
    sensors = {m["time_usec"]: m for m in received(folder, "HIL_SENSOR")}
    fixes = received(folder, "HIL_GPS")
    assert len(fixes) > 5
    times = sorted(sensors)
    depths = [(sensors[t]["abs_pressure"] * 100.0 - P_ATM) / (RHO * G) for t in times]
    assert depths[-1] == pytest.approx(1.0, abs=0.02)
    surfaced = max(t for t, d in zip(times, depths, strict=True) if d <= 0.2)
    assert max(m["time_usec"] for m in fixes) <= surfaced
    first = fixes[0]
    assert (first["lat"], first["lon"], first["alt"]) == (473_000_000, -1_225_000_000, 0)
    assert (first["fix_type"], first["eph"]) == (3, 100)
    # From then on the lowering is ODOMETRY, in NED, with its downward velocity in b.
    late = [m for m in received(folder, "ODOMETRY") if m["time_usec"] > surfaced]
    assert late[-1]["z"] == pytest.approx(1.0, abs=0.05)
    assert {(m["frame"], m["child"], m["estimator"]) for m in late} == {(1, 12, 2)}


def test_readings_of_dvl_and_usbl_become_one_odometry_each(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "folder"
    monkeypatch.setenv("FAKE", "")
    made = with_binary(uuv.load("bluerov2_px4"), str(px4), "px4")
    made = made.replace("controller", f"px4:?timeout={PATIENCE}&binary={px4}&folder={folder}")
    signals = run(made.set("controller.warm_up", 0.0), until=3.0, out=tmp_path / "run",
                  backend="native").signals()  # fmt: skip
    seen = received(folder, "ODOMETRY")
    moved = [m for m in seen if math.isnan(m["x"])]
    fixed = [m for m in seen if math.isnan(m["vx"])]
    assert len(moved) + len(fixed) == len(seen)
    fresh = np.diff(signals["dvl.t_sample"]) > 0
    assert abs(len(moved) - np.count_nonzero(fresh & (signals["dvl.valid"][1:] > 0))) <= 2
    velocities = set(signals["dvl.velocity"][:, 0].astype("f4").tolist())
    assert {m["vx"] for m in moved} <= velocities
    assert fixed[-1]["z"] in signals["usbl.position"][:, 2].astype("f4").tolist()
    sigma = signals["usbl.sigma"][-1]
    assert [fixed[-1][f"c{i}"] for i in (0, 6, 11)] == pytest.approx((sigma**2).tolist(), rel=1e-3)


def test_commands_are_there_before_the_sensors_of_their_tick(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, scenario = tmp_path / "folder", tmp_path / "moves.yaml"
    scenario.write_text("events:\n- {at: 0.13, set: controller.mode, value: 7}\n")
    flown(px4, tmp_path / "run", "", monkeypatch, until=0.2, options=f"&folder={folder}",
          scenario=scenario)  # fmt: skip
    start = next(m["at"] for m in received(folder, "COMMAND_LONG", api=True))
    modes = [m for m in received(folder, "COMMAND_LONG", api=True) if m["command"] == 176]
    assert [(m["p2"], m["at"] - start) for m in modes] == [(6.0, 0), (7.0, 130_000)]
    wanted = received(folder, "SET_POSITION_TARGET_LOCAL_NED", api=True)
    assert [m["z"] for m in wanted] == [5.0, 5.0]


def test_two_vehicles_have_two_autopilots(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FAKE", raising=False)
    pair = System("pair", "0.0025").add("a", system(px4)).add("b", system(px4))
    signals = run(pair, until=0.5, out=tmp_path / "run", backend="native").signals()
    np.testing.assert_array_equal(signals["a.hull.eta"], signals["b.hull.eta"])
    assert signals["a.controller.armed"][-1]


def test_neither_noise_nor_times_of_messages_depend_on_the_time_until_the_first_output(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []
    for silent in (20, 33):
        monkeypatch.setenv("SILENT", str(silent))
        folder = tmp_path / str(silent)
        flown(px4, tmp_path / f"run{silent}", "", monkeypatch, until=0.1,
              options=f"&folder={folder}", noise=True)  # fmt: skip
        sensors = [m for m in received(folder, "HIL_SENSOR") if m["told"]]
        seen.append([{k: v for k, v in m.items() if k != "time_usec"} for m in sensors])
    assert len(seen[0]) > 30
    assert seen[0] == seen[1]


def test_a_message_that_breaks_the_protocol_ends_the_px4_end(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uuvsim_cosim.bridge.autopilots.px4._IMU", 0b1111)
    with pytest.raises(ComponentFailed, match=r"status 3; .*fields_updated 0b1111'"):
        flown(px4, tmp_path / "run", "", monkeypatch)


def test_a_snapshot_is_refused_with_the_reason(px4: Path, tmp_path: Path) -> None:
    component = source(f"px4:?binary={px4}", tmp_path).instantiate("controller")
    with pytest.raises(FmuError, match=r"the state of PX4 is in another process"):
        component.get_fmu_state()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("px4:?binry=x", "option 'binry'; expected .*binary"),
        ("px4:?instance=two", "instance 'two'; expected 0 or more"),
        ("px4:?boot=soon", "boot 'soon'; expected seconds"),
        ("px4:?parameters=no.params", "no such file"),
        ("px4:?parameters=bad.params", r"bad.params:2: 'EKF2_EV_CTRL'; expected a name and"),
    ],
)
def test_a_wrong_option_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "bad.params").write_text("# vision\nEKF2_EV_CTRL\n")
    with pytest.raises(InputInvalid, match=message):
        source(text, tmp_path)


def test_parameters_of_a_file_and_those_of_the_airframe_are_in_the_environment(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: dict[str, str] = {}

    def start(*given: Any) -> None:
        seen.update(given[-1])
        raise InputInvalid("stop", "here", "")

    monkeypatch.setattr("uuvsim_cosim.bridge.autopilots.px4.SitlProcess", start)
    (tmp_path / "own.params").write_text("EKF2_EV_CTRL 3 # no velocity\n")
    with pytest.raises(ComponentFailed):
        flown(px4, tmp_path / "run", "", monkeypatch, options=f"&parameters={tmp_path}/own.params")
    assert seen["PX4_PARAM_EKF2_EV_CTRL"] == "3"
    assert seen["PX4_SYS_AUTOSTART"] == "60002"
    assert seen["PX4_SIM_MODEL"] == "gz_uuv_bluerov2_heavy"
    assert seen["PX4_PARAM_SIM_GZ_EN"] == "0"


def test_what_is_no_build_of_px4_is_refused_with_the_way_to_obtain_it(
    px4: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputInvalid, match=r"px4 in the PATH: no such file.*px4_sitl_default"):
        source("px4:", tmp_path).instantiate("controller")
    with pytest.raises(InputInvalid, match=r"bin/px4: no such file.*px4_sitl_default"):
        source(f"px4:?binary={tmp_path}", tmp_path).instantiate("controller")
    (tmp_path / "bin").mkdir()
    binary = tmp_path / "bin" / "px4"
    binary.touch(0o755)
    with pytest.raises(InputInvalid, match=r"rcS: no such file, a start script of PX4"):
        source(f"px4:?binary={binary}", tmp_path).instantiate("controller")
    (tmp_path / "etc" / "init.d-posix" / "airframes").mkdir(parents=True)
    (tmp_path / "etc" / "init.d-posix" / "rcS").touch()
    with pytest.raises(InputInvalid, match=r"has no airframe uuv_bluerov2_heavy"):
        source(f"px4:?binary={binary}", tmp_path).instantiate("controller")
    with pytest.raises(InputInvalid, match="no component of the system is PX4"):
        with_binary(uuv.load("bluerov2_hold"), "px4", "px4")


def test_paths_on_the_command_line_are_relative_to_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from uuvsim_cosim.commands.shared.system_options import edited_system

    monkeypatch.chdir(tmp_path)
    (tmp_path / "a+b.params").write_text("EKF2_EV_CTRL 3\n")
    changes: dict[str, dict[str, str]] = {"rate": {}, "map": {}, "set": {}, "replace": {}}
    changes["replace"]["controller"] = "px4:?parameters=a%2Bb.params"
    made = edited_system("bluerov2_hold", None, changes, binaries={"px4": "build & co"})
    found = source(str(made.components["controller"].source), Path("/elsewhere"))
    options = dict(found.options)
    assert options["binary"] == str(tmp_path / "build & co")
    assert options["parameters"] == str(tmp_path / "a+b.params")
    shipped = edited_system("bluerov2_px4", None, changes | {"replace": {}}, binaries={"px4": "b"})
    assert f"binary={tmp_path}/b" in str(shipped.components["controller"].source)
