"""The yo-yo mission: phases, actuators, and the glider that flies it as the recorded one did."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.guidance.yo_yo import yo_yo
from uuvsim_cosim.studies.glider.flight import GliderFlight, depth_rate, read_flight


@cache
def flown() -> uuv.Signals:
    with TemporaryDirectory() as folder:
        return uuv.run("slocum_yo", backend="native", out=Path(folder) / "run").signals()


def recorded() -> GliderFlight:
    return read_flight()


def mean_rate(depth: np.ndarray, time: np.ndarray, down: bool) -> float:
    """Return the mean rate of depth between 12 and 38 m, in descents or in climbs."""
    rate = np.gradient(depth, time)
    rows = (depth > 12.0) & (depth < 38.0) & ((rate > 0.05) if down else (rate < -0.05))
    return float(np.mean(rate[rows]))


def test_it_turns_at_its_depths_as_often_as_wanted() -> None:
    signals = flown()
    depth, climbs = signals["hull.eta"][:, 2], signals["mission.climbs"]
    turns = np.flatnonzero(np.diff(climbs))
    assert len(turns) == 5
    assert signals["mission.dives"][-1] == 3
    assert depth[turns[0::2]] == pytest.approx(40.0, abs=1.5)
    assert depth[turns[1::2]] == pytest.approx(4.0, abs=1.5)


@pytest.mark.parametrize("down", [True, False])
def test_its_vertical_speed_is_that_of_the_recorded_glider(down: bool) -> None:
    """Pitch, speed and turns are computed here, from pump, battery and water alone."""
    signals, flight = flown(), recorded()
    simulated = mean_rate(signals["hull.eta"][:, 2], signals.time, down)
    rows = (flight.depth > 12.0) & (flight.depth < 38.0)
    rate = depth_rate(flight, 11)[rows]
    measured = float(np.mean(rate[rate > 0.05] if down else rate[rate < -0.05]))
    assert simulated == pytest.approx(measured, rel=0.03)


@pytest.mark.parametrize("down", [True, False])
def test_its_pitch_is_that_of_the_recorded_glider(down: bool) -> None:
    signals, flight = flown(), recorded()
    sign = -1.0 if down else 1.0
    depth, pitch = signals["hull.eta"][:, 2], signals["hull.eta"][:, 4]
    simulated = np.mean(pitch[(depth > 12) & (depth < 35) & (sign * pitch > 0.2)])
    rows = flight.gliding(12.0) & (sign * flight.pitch > 0.2)
    assert simulated == pytest.approx(np.mean(flight.pitch[rows]), abs=np.radians(1.0))


def test_the_rudder_keeps_the_heading() -> None:
    system = uuv.load("slocum_yo").set("hull.eta_0", (0, 0, 10, 0, -0.38, 0.8))
    with TemporaryDirectory() as folder:
        signals = uuv.run(system, until=200, backend="native", out=Path(folder) / "r").signals()
    assert abs(signals["hull.eta"][-1, 5]) < 0.02


def test_the_water_makes_the_glider_slower_at_depth() -> None:
    """Density rises by 2 kg/m3 over 30 m: descents lose what climbs gain."""
    signals = flown()
    depth, u = signals["hull.eta"][:, 2], signals["hull.nu_r"][:, 0]
    pitch = signals["hull.eta"][:, 4]
    top, bottom = ((depth > a) & (depth < a + 3) & (pitch < -0.3) for a in (12.0, 34.0))
    assert np.mean(u[top]) > 1.2 * np.mean(u[bottom])


@pytest.mark.parametrize(("D", "phase"), [(39.0, 0.0), (40.5, 1.0)])
def test_it_begins_to_climb_at_the_bottom_depth(D: float, phase: float) -> None:
    run = simulate(yo_yo(), until=4.0, h=4.0, inputs={"eta": [0, 0, D, 0, 0, 0]})
    assert run["climbs"][-1] == phase
    assert run["V_d"][-1] == pytest.approx(4.625e-4 if phase else 2.4e-6)
