"""Top speeds are where thrust and drag balance."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids
from uuvsim_cosim.models.importing.new_vehicle import write_vehicle
from uuvsim_cosim.models.vehicles.top_speeds import (
    DIRECTIONS,
    PublishedSpeed,
    published_speeds,
    top_speeds,
)

AHEAD, ASTERN = 51.4849, 39.9131  # N, of a T200 at 16 V


def speeds_of(address: str, voltage: float | None = None) -> dict[str, float]:
    return {s.direction: s.speed for s in top_speeds(address, voltage)}


def root(d_l: float, d_q: float, force: float) -> float:
    """Return the speed at which d_l U + d_q U² is the force."""
    return (-d_l + math.sqrt(d_l * d_l + 4.0 * d_q * force)) / (2.0 * d_q)


@pytest.mark.parametrize(
    ("set", "d"),
    [
        ("von_benzon_2022", ((13.7, 141.0), (0.0, 217.0), (33.0, 190.0))),
        ("wu_2018", ((4.03, 18.18), (6.22, 21.66), (5.18, 36.99))),
    ],
)
def test_the_speeds_of_the_heavy_are_those_of_the_closed_form(
    set: str, d: tuple[tuple[float, float], ...]
) -> None:
    found = speeds_of(f"bluerov2_heavy@{set}")
    level = 2.0 * math.sqrt(0.5) * (AHEAD + ASTERN)  # two push, two pull, at 45 degrees
    sinks = {"von_benzon_2022": 13.5 * 9.82 - 1000 * 9.82 * 0.0134, "wu_2018": 112.8 - 114.8}[set]
    wanted = {
        "ahead": root(*d[0], level),
        "astern": root(*d[0], level),
        "starboard": root(*d[1], level),
        "port": root(*d[1], level),
        "up": root(*d[2], 4.0 * AHEAD - sinks),
        "down": root(*d[2], 4.0 * ASTERN + sinks),
    }
    assert found == pytest.approx(wanted, rel=1e-5)


def test_the_default_set_of_the_heavy_has_the_speed_that_was_measured_in_a_pool() -> None:
    """Von Benzon et al. (2022): 0.72 m/s with 30.4 N of each thruster."""
    (measured,) = (s for s in published_speeds("bluerov2_heavy") if s.by == "measurement")
    force = 4.0 * math.sqrt(0.5) * 30.4
    assert root(13.7, 141.0, force) == pytest.approx(measured.speed, rel=0.02)
    assert root(4.03, 18.18, force) > 2.8 * measured.speed


@pytest.mark.parametrize(("D_q_11", "speed"), [(141.0, 0.91), (58.42, 1.37), (48.0, 1.50)])
def test_the_page_states_the_surge_damping_that_the_maker_s_speed_needs(
    D_q_11: float, speed: float
) -> None:
    """The closed form of the row of docs/vehicles/top_speeds.md, at 16 V."""
    level = 2.0 * math.sqrt(0.5) * (AHEAD + ASTERN)
    assert root(13.7, D_q_11, level) == pytest.approx(speed, abs=5e-3)
    page = (Path(__file__).parents[3] / "docs" / "vehicles" / "top_speeds.md").read_text("utf-8")
    row = next(r for r in page.splitlines() if r.startswith(f"| {D_q_11:g} |"))
    assert float(row.split("|")[3]) == speed


def test_thrust_that_falls_with_the_flow_gives_the_published_speed_of_the_remus() -> None:
    assert speeds_of("remus100@fossen_2021")["ahead"] == pytest.approx(2.5536, rel=3e-4)


def test_a_lower_voltage_is_slower() -> None:
    at_12, at_16 = (speeds_of("bluerov2_heavy", v) for v in (12.0, 16.0))
    assert all(0.0 < at_12[d] < at_16[d] for d in DIRECTIONS)
    assert at_16 == speeds_of("bluerov2_heavy")


def test_a_vehicle_with_one_propeller_has_speeds_ahead_and_astern_alone() -> None:
    assert [d for d, speed in speeds_of("tethys_lrauv").items() if speed] == ["ahead", "astern"]


def test_drag_that_drives_has_no_top_speed() -> None:
    assert math.isnan(speeds_of("eca_a9@eca_a9_gazebo_signed")["astern"])


def test_a_voltage_beyond_the_bench_is_refused_with_its_range() -> None:
    for voltage in (24.0, 11.0, float("nan")):
        with pytest.raises(InputInvalid, match=r"thruster_t200 at .* V.*12 to 16.8 V"):
            top_speeds("bluerov2_heavy", voltage)


def test_published_speeds_have_a_source_and_a_direction() -> None:
    found = [s for id in vehicle_ids() for s in published_speeds(id)]
    assert all(isinstance(s, PublishedSpeed) and s.direction in DIRECTIONS for s in found)
    assert published_speeds("lauv") == ()


def test_a_vehicle_without_thrusters_is_refused(tmp_path: object) -> None:
    with pytest.raises(ParameterInvalid, match="no thruster geometry"):
        top_speeds(str(tmp_path))


def test_a_voltage_without_effect_is_refused_or_reported(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert status_of(["models", "speeds", "rexrov", "--voltage", "18"]) == 2
    assert "the thrust of rexrov does not depend on its supply" in capsys.readouterr().err
    assert status_of(["models", "speeds", "--voltage", "15"]) == 0
    assert "note: --voltage 15 has no effect on desistek_saga" in capsys.readouterr().out


def test_thrusters_that_cannot_lift_the_vehicle_are_shown_as_too_weak(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_vehicle("my_rov", tmp_path) / "parameters.yaml"
    file.write_text(re.sub(r"m: {value: [\d.]+", "m: {value: 40", file.read_text("utf-8"), count=1))
    assert status_of(["models", "speeds", str(file.parent)]) == 0
    shown = capsys.readouterr().out
    assert shown.count("too weak") == 2
    assert "too weak: the largest force of the thrusters that way is less than the net" in shown
