from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.sensors.leak import leak

DEPTH = [0, 0, 10.0, 0, 0, 0]


def test_a_hull_without_a_hole_stays_dry() -> None:
    run = simulate(leak(), until=5, inputs={"eta": DEPTH}, h=0.01)
    assert run["volume"][-1] == 0.0
    assert not np.any(run["leak"])


def test_the_first_water_comes_by_torricellis_law() -> None:
    run = simulate(leak(), until=0.5, inputs={"eta": DEPTH}, h=0.01, parameters={"A_hole": 1e-6})
    flow = 0.6 * 1e-6 * np.sqrt(2 * 9.81 * 10.0)
    assert run["volume"][-1] == pytest.approx(flow * 0.5, rel=1e-2)


def test_the_probe_is_wet_when_the_water_reaches_it() -> None:
    hole = {"A_hole": 1e-7, "t_leak": 1.0}
    run = simulate(leak(), until=5, inputs={"eta": DEPTH}, h=0.01, parameters=hole)
    when = 1.0 + 1e-6 / (0.6 * 1e-7 * np.sqrt(2 * 9.81 * 10.0))
    first = run.t[np.flatnonzero(run["leak"])[0]]
    assert when <= first <= when + 0.12


def test_the_air_inside_ends_the_flooding_at_boyles_law() -> None:
    run = simulate(leak(), until=5, inputs={"eta": DEPTH}, h=0.01, parameters={"A_hole": 1e-3})
    p = 101325.0 / (101325.0 + 1025.0 * 9.81 * 10.0)
    assert run["volume"][-1] == pytest.approx(0.0025 * (1 - p), rel=1e-3)


def test_at_the_surface_nothing_comes_in() -> None:
    run = simulate(leak(), until=2, inputs={"eta": [0] * 6}, h=0.01, parameters={"A_hole": 1e-4})
    assert run["volume"][-1] == 0.0
