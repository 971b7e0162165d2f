"""The emergency ascent of a vehicle with fins, started by a scenario."""

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.orchestrator.scenarios.scenario import Change, Scenario

START = 20.0  # s, of the ascent
FROM = 40.0  # m, depth of the loiter before it


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> uuv.Run:
    """A REMUS 100 that loiters 40 m deep and ascends after 20 s."""
    loiter = uuv.system_of("remus100")
    waypoints = np.array(loiter.components["guidance"].start["waypoints"], float).reshape(-1, 3)
    eta = np.array(loiter.components["hull"].start["eta_0"], float)
    waypoints[:, 2] = eta[2] = FROM
    ascent = Scenario("up", (Change(START, "controller.ascend", 1.0),))
    return uuv.run(
        loiter.set("guidance.waypoints", waypoints).set("hull.eta_0", eta),
        until=52, backend="native", scenario=ascent, out=tmp_path_factory.mktemp("ascent") / "run",
    )  # fmt: skip


def between(flight: uuv.Run, name: str, first: float, last: float) -> np.ndarray:
    """Return a signal's rows from `first` to `last` [s]."""
    signals = flight.signals()
    t = signals.time
    return np.asarray(signals[name])[(t >= first) & (t <= last)]


def test_until_the_ascent_the_vehicle_keeps_its_depth(flight: uuv.Run) -> None:
    depth = between(flight, "hull.eta", 0.0, START)[:, 2]  # m
    assert np.abs(depth - FROM).max() < 0.3


def test_the_command_of_the_propeller_is_full_from_the_start_of_the_ascent(flight: uuv.Run) -> None:
    assert between(flight, "controller.u", START - 1.0, START - 0.1).max() < 0.7
    assert between(flight, "controller.u", START + 0.1, 52.0).min() == 1.0


def test_the_bow_rises_within_five_seconds_to_near_the_limit_of_pitch(flight: uuv.Run) -> None:
    """The wanted pitch is 25 degrees; without an integral, weight and buoyancy take 1.6 of them."""
    pitch = np.degrees(between(flight, "hull.eta", START + 5.0, START + 30.0)[:, 4])
    assert pitch.min() > 23.0
    assert pitch.max() < 25.0


def test_the_climb_is_steady_and_ends_at_the_surface(flight: uuv.Run) -> None:
    depth = between(flight, "hull.eta", START + 5.0, START + 29.0)[:, 2]
    rate = (depth[0] - depth[-1]) / 24.0
    assert rate == pytest.approx(1.37, abs=0.02)  # m/s
    assert np.all(np.diff(depth) < 0.0)
    assert between(flight, "hull.eta", 51.9, 52.0)[:, 2].max() < 0.5


def test_the_heading_still_follows_the_loiter(flight: uuv.Run) -> None:
    climb = between(flight, "hull.eta", START, START + 25.0)
    assert np.ptp(np.unwrap(climb[:, 5])) > np.radians(120.0)
    assert np.abs(climb[:, 3]).max() < np.radians(10.0)
