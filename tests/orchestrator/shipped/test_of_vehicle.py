"""A complete system from a vehicle's folder: what it holds, and that it flies."""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.shipped.of_vehicle import flight_of, system_of
from uuvsim_cosim.orchestrator.ssp.ssd import write_ssd

THRUSTED = ["bluerov2", "bluerov2_heavy", "desistek_saga", "pool8", "rexrov", "rexrov2", "sphere"]


def copied(vehicle: str, folder: Path) -> Path:
    """Copy a vehicle's folder to a vehicle my_rov in the folder."""
    own = copytree(content("models", "vehicles", vehicle), folder / "my_rov")
    for file in own.glob("*.yaml"):
        file.write_text(file.read_text().replace(f": {vehicle}\n", ": my_rov\n"))
    return own


@pytest.mark.parametrize("vehicle", THRUSTED)
def test_hold_is_station_keeping_where_the_thrusters_make_the_forces(vehicle: str) -> None:
    kind = "loiter" if vehicle == "desistek_saga" else "station keeping"
    assert flight_of(vehicle).kind == kind


@pytest.mark.parametrize("vehicle", ["bluerov2", "rexrov2", "sphere"])
def test_a_vehicle_holds_its_place(vehicle: str, tmp_path: Path) -> None:
    run = uuv.run(system_of(vehicle), until=60, backend="native", out=tmp_path / "run")
    place = run.signals()["hull.eta"][-1]
    assert place == pytest.approx([0, 0, 5, 0, 0, 0], abs=0.02)


def test_a_vehicle_without_sway_loiters_around_its_circle(tmp_path: Path) -> None:
    flight = flight_of("desistek_saga")
    assert flight.radius is not None
    run = uuv.run(system_of("desistek_saga"), until=120, backend="native", out=tmp_path / "run")
    n, e, d = run.signals()["hull.eta"][6000:, :3].T
    away = np.hypot(n, e)
    assert np.all(np.abs(away - flight.radius) < 0.03 * flight.radius)
    assert np.all(np.abs(d - flight.waypoints[0][2]) < 0.05)


def test_a_passive_pitch_survives_a_dive(tmp_path: Path) -> None:
    system = system_of("bluerov2").set("hull.eta_0", [-0.9, 0, 1, 0, 0, 0])
    run = uuv.run(system, until=40, backend="native", out=tmp_path / "run")
    assert np.abs(run.signals()["hull.eta"][:, 3:5]).max() < 0.3


def test_the_assumed_figures_are_listed() -> None:
    remarks = "\n".join(system_of("rexrov", "survey").remarks)
    for text in ("margins of surge", "largest errors", "guidance: speed", "sensors: presets"):
        assert text in remarks


def test_an_unknown_mission_is_refused() -> None:
    with pytest.raises(InputInvalid, match="one of hold, survey"):
        system_of("bluerov2", "race")  # type: ignore[arg-type]


def test_a_system_of_a_relative_vehicle_is_loaded_from_any_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    copied("rexrov", tmp_path)
    monkeypatch.chdir(tmp_path)
    write_ssd(system_of("my_rov"), tmp_path / "my_rov.ssd")
    (tmp_path / "elsewhere").mkdir()
    write_ssd(uuv.load("my_rov.ssd"), tmp_path / "elsewhere" / "other.ssd")
    assert "vehicle=../my_rov" in (tmp_path / "elsewhere" / "other.ssd").read_text()
    monkeypatch.chdir(tmp_path / "elsewhere")
    for file in ("../my_rov.ssd", "other.ssd"):
        found = uuv.load(file).describe("hull").variables["m"].start
        assert found == pytest.approx(1862.87)


@pytest.mark.parametrize("vehicle", ["remus100", "lauv", "eca_a9", "npsauv", "tethys_lrauv"])
def test_a_vehicle_with_fins_loiters_at_its_depth(vehicle: str, tmp_path: Path) -> None:
    flight = flight_of(vehicle)
    assert flight.kind == "loiter"
    assert flight.radius is not None
    run = uuv.run(
        system_of(vehicle), until=600, backend="native", record_every=20, out=tmp_path / "run"
    )
    n, e, d = run.signals()["hull.eta"][1500:, :3].T
    assert np.abs(np.hypot(n, e) - flight.radius).max() < 0.06 * flight.radius
    assert np.abs(d - flight.waypoints[0][2]).max() < 0.05


def tethys_with_ballast() -> uuv.System:
    """Return hull, propeller, fins and ballast of the Tethys, connected as the page shows."""
    return (
        uuv.System("tethys", "0.05", "The Tethys with its buoyancy engine and its moving battery")
        .add("hull", "model:tethys_lrauv?surface=false")
        .add("propeller", "model:propeller?vehicle=tethys_lrauv")
        .add("ballast", "model:ballast?contact=true")
        .add("fins", "model:fins?vehicle=tethys_lrauv&contact=true")
        .connect("hull.nu_r", "propeller.nu_r")
        .connect("hull.nu_r", "fins.nu_r")
        .connect("hull.eta", "ballast.eta")
        .connect("propeller.tau", "ballast.contact")
        .connect("ballast.tau", "fins.contact")
        .connect("fins.tau", "hull.tau")
    )


def test_the_buoyancy_engine_of_the_tethys_sinks_it_bow_up(tmp_path: Path) -> None:
    """LRAUV's BuoyancyAction, Sink: to 5 m, pitch within 0.1 rad; the engine is behind CO."""
    system = tethys_with_ballast().set("ballast.V_d", 0.0)
    run = uuv.run(system, until=240, backend="native", out=tmp_path / "run")
    eta, nu = run.signals()["hull.eta"], run.signals()["hull.nu"]
    assert eta[-1, 2] - eta[0, 2] > 5.0
    assert 0.0 < eta[-1, 4] < 0.1
    force = 1025.0 * 9.80665 * 4.2e-4  # 80 mL are left of 500
    sinking = -np.sin(eta[-1, 4]) * nu[-1, 0] + np.cos(eta[-1, 4]) * nu[-1, 2]
    assert sinking == pytest.approx(np.sqrt(force / 601.27), rel=0.05)


def test_the_battery_of_the_tethys_moves_forward_slowly_and_turns_it_bow_down(
    tmp_path: Path,
) -> None:
    """LRAUV's MassShifter, DownwardTilt: 1 cm forward, nose below -0.15 rad."""
    system = tethys_with_ballast().set("ballast.x_d", 0.01)
    run = uuv.run(system, until=60, backend="native", out=tmp_path / "run")
    shift = run.signals()["ballast.shift"]
    assert shift[round(10 / 0.05)] == pytest.approx(7e-3, rel=0.01)  # 0.7 mm/s
    assert run.signals()["hull.eta"][:, 4].min() < -0.15
