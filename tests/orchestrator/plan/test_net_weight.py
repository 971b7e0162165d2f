"""A vehicle that its actuators cannot carry is refused, however its system was built."""

from __future__ import annotations

import re
from pathlib import Path
from shutil import copytree

import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import SystemInvalid
from uuvsim_cosim.fmus.export.fmu_file import build_fmu
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import propelled_ids
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle
from uuvsim_cosim.orchestrator.plan.flatten import flatten

# Thrusters of a BlueROV2 Heavy push with 0.9 x 159.7 N; its buoyancy is 131.6 N.
CARRIED = 143.69


def refusal(system: uuv.System) -> str:
    """Return the message of a refused system; empty if it is built."""
    try:
        flatten(system)
    except SystemInvalid as error:
        return str(error)
    return ""


def lauv_with_net(net: float) -> uuv.System:
    """Return the loiter of the LAUV (buoyancy 177 N, g 9.81) with a net weight [N]."""
    return uuv.system_of("lauv").set("hull.m", (177.0 + net) / 9.81)


def depth_of(system: uuv.System, until: float, folder: Path) -> float:
    run = uuv.run(system, until=until, out=folder / "run", progress=False)
    return float(run.signals()["hull.eta"][-1, 2])


def test_a_mass_without_its_weight_is_a_warning_for_a_hull_that_has_both() -> None:
    system = uuv.system_of("remus100")
    assert not [w for w in flatten(system).warnings if "W" in w]
    (warning,) = [w for w in flatten(system.set("hull.m", 60.0)).warnings if "weight W" in w]
    assert warning.startswith("hull: m is set, and the weight W")
    assert "stays 299 N" in warning
    both = system.set("hull.m", 31.0).set("hull.W", 31.0 * 9.81)
    assert not [w for w in flatten(both).warnings if "weight W" in w]


@pytest.mark.parametrize("vehicle", propelled_ids())
def test_the_shipped_vehicles_are_carried(vehicle: str) -> None:
    for mission in ("hold", "survey"):
        plan = flatten(uuv.system_of(vehicle, mission=mission))  # type: ignore[arg-type]
        assert not [w for w in plan.warnings if "net weight" in w]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("m", 30.0, "it sinks, because its weight of 294.6 N is 163 N more than its buoyancy of "
         "131.6 N, and its thrusters push up with 144 N (90 % of the largest vertical force both "
         "ways, 160 N at 16 V); expected m near 13.4 kg, the mass at neutral buoyancy, stronger "
         "vertical thrusters, or --force (in Python: with_mismatches('warn'))"),
        ("nabla", 0.0300, "it rises, because its weight of 132.6 N is 162 N less than its buoyancy "
         "of 294.6 N, and its thrusters push down with 144 N"),
        ("rho", 2300.0, "it rises"),
    ],
)  # fmt: skip
def test_a_value_that_a_user_sets_may_not_sink_the_vehicle(
    name: str, value: float, said: str
) -> None:
    assert refusal(uuv.load("bluerov2_hold").set(f"hull.{name}", value)).startswith(f"hull: {said}")


def test_the_limit_is_what_the_thrusters_carry() -> None:
    hold, g = uuv.load("bluerov2_hold"), 9.82
    assert not refusal(hold.set("hull.m", 13.4 + 0.99 * CARRIED / g))
    assert "it sinks" in refusal(hold.set("hull.m", 13.4 + 1.01 * CARRIED / g))
    assert not refusal(hold.set("hull.nabla", (13.5 + 0.99 * CARRIED / g) / 1000))
    assert "it rises" in refusal(hold.set("hull.nabla", (13.5 + 1.01 * CARRIED / g) / 1000))


def test_a_forced_system_is_warned_and_sinks(tmp_path: Path) -> None:
    heavy = uuv.load("bluerov2_hold").set("hull.m", 30.0).with_mismatches("warn")
    (text,) = [w for w in flatten(heavy).warnings if "sinks" in w]
    assert "--force" not in text
    assert depth_of(heavy, 20.0, tmp_path) > 5.0  # it was to hold 2 m


def test_weight_and_buoyancy_are_read_too() -> None:
    hold = uuv.system_of("bluerov2")
    assert "expected W near B, 114.8 N, stronger" in refusal(hold.set("hull.W", 200.0))
    assert "it rises" in refusal(hold.set("hull.B", 200.0))
    assert not refusal(hold.set("hull.W", 180.0))


def test_a_heavy_vehicle_of_files_is_refused_by_the_same_check(tmp_path: Path) -> None:
    file = write_vehicle("my_rov", tmp_path) / "parameters.yaml"
    file.write_text(re.sub(r"m: {value: [\d.]+", "m: {value: 40", file.read_text(), count=1))
    system = uuv.system_of(str(file.parent))
    assert "its weight of 392.4 N is 185 N more than its buoyancy of 207.3 N" in refusal(system)
    assert flatten(system.with_mismatches("warn"))


def test_fins_that_cannot_carry_a_vehicle_of_files_are_refused_by_the_same_check(
    tmp_path: Path,
) -> None:
    folder = copytree(content("models", "vehicles", "lauv"), tmp_path / "lauv")
    file = folder / "parameters.yaml"
    file.write_text(file.read_text("utf-8").replace("m: {value: 18", "m: {value: 36", 1), "utf-8")
    system = uuv.system_of(str(folder))
    assert "176 N more than its buoyancy" in refusal(system)
    assert any("gains without the net weight of 176 N" in r for r in system.remarks)
    assert flatten(system.with_mismatches("warn"))


def test_level_flight_at_the_speed_of_the_guidance_carries_the_net_weight() -> None:
    """Lift grows with the square of the speed: 40.6 N at 2.5 m/s, and 0.16 of it at 1 m/s."""
    text = refusal(lauv_with_net(45.0))
    assert "level flight at 2.5 m/s carries 40.6 N with 70 % of the fins' deflection" in text
    assert "expected m near 18.04 kg, the mass at neutral buoyancy, larger fins, a higher" in text
    assert not refusal(lauv_with_net(38.0))
    assert "level flight at 1 m/s carries" in refusal(lauv_with_net(10.0).set("guidance.speed", 1))
    assert not refusal(lauv_with_net(5.0).set("guidance.speed", 1))
    assert not refusal(lauv_with_net(45.0).set("guidance.speed", 3))


def test_a_net_weight_far_from_that_of_the_gains_is_a_warning() -> None:
    assert not [w for w in flatten(lauv_with_net(7.0)).warnings if "net weight" in w]
    (text,) = [w for w in flatten(lauv_with_net(9.0)).warnings if "net weight" in w]
    assert "is 9 N, and the autopilot is designed for -0.42 N; the fins carry 40.6 N" in text


@pytest.mark.parametrize("net", [-7.0, 7.0])
def test_a_net_weight_without_a_warning_is_flown(net: float, tmp_path: Path) -> None:
    assert depth_of(lauv_with_net(net), 60.0, tmp_path) == pytest.approx(5.0, abs=0.1)


def test_a_net_weight_beyond_level_flight_sinks(tmp_path: Path) -> None:
    sinks = lauv_with_net(80.0).with_mismatches("warn")
    assert depth_of(sinks, 60.0, tmp_path) > 20.0


def test_variable_ballast_carries_its_share() -> None:
    system = uuv.system_of("tethys_lrauv")
    heavy = system.set("hull.W", 1450.58 + 15.0)
    assert "level flight at 0.95 m/s carries 11.3 N" in refusal(heavy)
    v = declare("ballast").variables
    spare = float(v["rho"].start[0] * v["g"].start[0] * (v["V_max"].start[0] - v["V_0"].start[0]))
    assert spare > 4.0
    assert not refusal(heavy.add("ballast", "model:ballast"))


def test_a_hull_without_actuators_may_sink() -> None:
    system = uuv.System("stone", "0.01").add("hull", "model:bluerov2_heavy", {"m": 50.0})
    assert not refusal(system)


def test_thrusters_of_a_users_own_figures_are_not_judged() -> None:
    hold = uuv.load("bluerov2_hold").set("hull.m", 30.0)
    for i in range(1, 9):
        hold = hold.replace(f"thruster_{i}", "model:thruster").set(f"thruster_{i}.K_n", 1e-3)
    assert not refusal(hold)


def test_an_exported_hull_is_judged_by_its_own_parameters() -> None:
    hold = uuv.load("bluerov2_hold").replace("hull", str(build_fmu(declare("bluerov2_heavy"))))
    assert not refusal(hold)
    assert "it sinks" in refusal(hold.set("hull.m", 30.0))


def test_each_vehicle_of_a_mission_is_judged_with_its_own_actuators() -> None:
    one = uuv.system_of("pool8").set("hull.m", 5.0)
    two = uuv.system_of("bluerov2")
    both = uuv.System("both", "0.01").add("a", one).add("b", two)
    text = refusal(both)
    assert text.startswith("a.hull: it sinks")
    assert "b.hull" not in text
