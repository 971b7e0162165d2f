from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.view.recorded.metrics import (
    cross_track_error,
    energy,
    energy_of,
    figures,
    navigation_errors,
    tracking,
    wrapped,
)
from uuvsim_cosim.view.recorded.traces import Traces, joined, traces_of

CORNER = np.array([[0.0, 0.0, 5.0], [10.0, 0.0, 5.0], [10.0, 10.0, 5.0]])


@pytest.mark.parametrize(
    ("position", "error"),
    [
        ((5.0, 2.0), 2.0),  # east of a leg northwards: to starboard
        ((5.0, -2.0), -2.0),
        ((12.0, 5.0), -2.0),  # north of a leg eastwards: to port
        ((-3.0, 4.0), 5.0),  # before the first waypoint: distance to it
        ((13.0, 14.0), -5.0),  # behind the last
        ((4.0, 0.0), 0.0),
    ],
)
def test_cross_track_error_is_the_signed_distance_to_the_nearest_leg(
    position: tuple[float, float], error: float
) -> None:
    north, east = np.array([position]).T
    found = np.asarray(cross_track_error(north, east, CORNER))
    assert found[0] == pytest.approx(error, abs=1e-12)


def test_cross_track_error_does_not_depend_on_repeated_waypoints() -> None:
    repeated = np.vstack([CORNER[:1], CORNER[:1], CORNER[1:], CORNER[2:]])
    assert np.asarray(cross_track_error(np.array([5.0]), np.array([2.0]), repeated))[
        0
    ] == pytest.approx(2.0)


def test_a_sine_beside_the_path_has_the_rms_of_a_sine() -> None:
    n = np.linspace(0.0, 10.0, 10_001)
    eta = np.column_stack([n, 0.3 * np.sin(2 * np.pi * n), 5 + 0 * n, 0 * n, 0 * n, 0 * n])
    found = tracking(n, eta.T, CORNER[:2], eta[:, 2])
    assert found.rms == pytest.approx(0.3 / np.sqrt(2), rel=1e-3)
    assert found.max == pytest.approx(0.3, rel=1e-6)
    assert found.depth_rms == 0.0


def test_the_approach_does_not_count() -> None:
    time = np.arange(11.0)
    eta = np.zeros((11, 6))
    eta[:, 1] = 10.0 - time  # from 10 m beside the path onto it
    found = tracking(time, eta.T, CORNER[:2])
    assert found.approach_ends == 9.0
    assert found.max == pytest.approx(1.0)
    assert np.isnan(np.asarray(found.error)[:9]).all()


def test_a_vehicle_that_never_comes_close_counts_from_the_start() -> None:
    eta = np.zeros((5, 6))
    eta[:, 1] = 7.0
    found = tracking(np.arange(5.0), eta.T, CORNER[:2])
    assert found.rms == pytest.approx(7.0)
    assert found.approach_ends == 0.0


def test_heading_errors_are_taken_the_short_way_round() -> None:
    np.testing.assert_allclose(wrapped(np.array([np.pi + 0.1, -np.pi - 0.1, 6.2])),
                               [-np.pi + 0.1, np.pi - 0.1, 6.2 - 2 * np.pi])  # fmt: skip
    true, hat = np.zeros((4, 6)), np.zeros((4, 6))
    true[:, 5], hat[:, 5] = 3.1, -3.1
    assert navigation_errors(hat.T, true.T).heading_rms == pytest.approx(2 * np.pi - 6.2)


def test_a_gaussian_error_of_its_own_sigma_lies_inside_3_sigma_as_often_as_it_should() -> None:
    random = np.random.default_rng(1)
    true = np.zeros((200_000, 6))
    sigma = np.full_like(true, 0.2)
    found = navigation_errors(0.2 * random.standard_normal(true.shape).T, true.T, sigma.T)
    for share in found.inside.values():
        assert share == pytest.approx(0.9973, abs=6e-4)
    assert found.horizontal_rms == pytest.approx(0.2 * np.sqrt(2), rel=5e-3)


def test_energy_of_constant_power_is_power_times_time() -> None:
    time = np.linspace(0.0, 100.0, 33)
    assert energy(time, np.full(33, 16.0), np.full(33, 5.0)) == pytest.approx(8000.0)


def test_the_batterys_own_count_of_energy_is_preferred() -> None:
    time = np.linspace(0.0, 10.0, 11)
    values = {"battery.voltage": 16 + 0 * time, "wrench.current_total": 1 + 0 * time}
    assert energy_of(Traces(time, values)) == pytest.approx(160.0)
    assert energy_of(Traces(time, {**values, "battery.energy": 7.0 * time})) == pytest.approx(70.0)


def test_thrusters_without_an_electrical_model_have_no_energy() -> None:
    """At rest they use none, which is a figure."""
    time = np.linspace(0.0, 10.0, 11)
    values = {"battery.energy": 0.0 * time, "thruster_1.thrust": 0.0 * time}
    assert energy_of(Traces(time, values)) == 0.0
    pushing = Traces(time, {**values, "thruster_2.thrust": np.ones(11)})
    assert energy_of(pushing) is None
    assert figures(pushing, None) == []


def test_figures_name_only_what_was_recorded() -> None:
    time = np.arange(3.0)
    assert figures(Traces(time, {"tank.level": time}), None) == []


def test_a_nested_vehicles_signals_are_found_by_the_end_of_their_name() -> None:
    time = np.arange(3.0)
    columns = {f"rov.hull.eta[{i}]": time for i in range(1, 7)}
    traces = Traces(time, joined(columns))
    found = traces.elements("hull.eta", 6)
    assert found is not None
    assert len(found) == 6


@pytest.mark.parametrize(("speed", "until"), [(0.5, True), (0.0, False)])
def test_the_error_ends_where_a_vehicle_circles_but_not_where_it_holds(
    speed: float, until: bool
) -> None:
    """At 10 s the path is done; the vehicle is 8 m away from then on."""
    time = np.arange(21.0)
    eta = np.zeros((21, 6))
    eta[:, 0] = np.minimum(time, 10.0)
    eta[11:, 1] = 8.0
    nu_d = np.zeros((21, 6))
    nu_d[:, 0] = np.where(time < 10, 0.5, speed)
    done = (time > 10).astype(float)
    values = {"hull.eta": eta, "guidance.nu_d": nu_d, "guidance.done": done}
    found = {f.key: f for f in figures(Traces(time, values), CORNER[:2])}
    assert found["cross_track_max"].value == (0.0 if until else 8.0)
    assert ("until the path's end (11 s)" in found["cross_track_rms"].note) == until


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs") / "survey"
    return uuv.run("bluerov2_survey", until=1.0, backend="native", out=folder).folder


@pytest.mark.parametrize("rows", [1, 7, 100, 101])
def test_figures_of_a_recording_that_is_read_by_block_are_those_of_arrays(
    rows: int, recording: Path, tmp_path: Path
) -> None:
    table = pq.read_table(recording / "signals.parquet")
    pq.write_table(table, tmp_path / "signals.parquet", row_group_size=rows)
    traces = traces_of(tmp_path)
    in_memory, by_block = (
        figures(t, CORNER) for t in (replace(traces, values=dict(traces.values)), traces)
    )
    assert len(by_block) > 8
    assert [f.key for f in by_block] == [f.key for f in in_memory]
    for a, b in zip(in_memory, by_block, strict=True):
        assert (a.value, a.note) == (pytest.approx(b.value, rel=1e-12), b.note), a.key
