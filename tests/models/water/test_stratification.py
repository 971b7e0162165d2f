"""Stratified water: levels, EOS-80, and the recorded Baltic."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.water.seawater import density
from uuvsim_cosim.models.water.stratification import LEVELS, RHO_G, water_column
from uuvsim_cosim.studies.glider.flight import read_flight


def at(depth: float) -> dict[str, float]:
    run = simulate(water_column(), until=1.0, h=1.0, inputs={"eta": [0, 0, depth, 0, 0, 0]})
    return {name: float(run[name][-1]) for name in ("density", "temperature", "salinity")}


@pytest.mark.parametrize(("depth", "T", "S"), LEVELS)
def test_at_a_level_it_has_the_values_of_the_level(depth: float, T: float, S: float) -> None:
    found = at(depth)
    assert found["temperature"] == pytest.approx(T)
    assert found["salinity"] == pytest.approx(S)
    assert found["density"] == pytest.approx(density(S, T, RHO_G * depth))


def test_beyond_the_levels_temperature_is_held_and_pressure_is_not() -> None:
    deep, deeper = at(40.0), at(140.0)
    assert deeper["temperature"] == deep["temperature"]
    assert deeper["density"] > deep["density"] + 0.4
    assert at(-2.0) == at(0.0)


def test_the_default_water_is_that_of_the_recording() -> None:
    flight = read_flight()
    for depth in (5.0, 12.0, 25.0, 38.0):
        near = np.abs(flight.depth - depth) < 0.5
        assert at(depth)["density"] == pytest.approx(flight.density[near].mean(), abs=0.15)
