from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from uuvsim_cosim.models.declaration.kinematics import q_of_euler
from uuvsim_cosim.models.sensors.pressure import pressure
from uuvsim_cosim.models.water.seawater import (
    density,
    depth_of_pressure,
    gravity,
    pressure_at_depth,
    sound_speed,
)


@pytest.mark.parametrize(
    ("S", "T", "p_bar", "rho"),
    [
        (0, 5, 0, 999.96675),
        (0, 5, 1000, 1044.12802),
        (35, 5, 0, 1027.67547),
        (35, 5, 1000, 1069.48914),
        (35, 25, 0, 1023.34306),
        (35, 25, 1000, 1062.53817),
    ],
)
def test_density_meets_the_check_values_of_eos_80(
    S: float, T: float, p_bar: float, rho: float
) -> None:
    assert density(S, T, p_bar * 1e5) == pytest.approx(rho, abs=6e-6)


def test_sound_speed_meets_the_check_value_of_mackenzie() -> None:
    assert sound_speed(25.0, 35.0, 1000.0) == pytest.approx(1550.744, abs=5e-4)


def test_gravity_at_the_equator_and_at_the_pole() -> None:
    assert float(gravity(0.0)) == pytest.approx(9.780318)
    assert float(gravity(np.pi / 2)) == pytest.approx(9.83218, abs=1e-5)


def test_pressure_agrees_with_the_column_integrated_over_eos_80() -> None:
    column = solve_ivp(
        lambda _, p: density(35.0, 10.0, p) * 9.81, (0, 1000), [0.0], rtol=1e-10, atol=1e-3
    )
    assert pressure_at_depth(1000.0, 35.0, 10.0, 9.81) == pytest.approx(column.y[0, -1], rel=3e-5)


def test_depth_is_the_inverse_of_pressure() -> None:
    for h in (0.0, 1.0, 300.0, 6000.0):
        p = pressure_at_depth(h, 35.0, 4.0, 9.81)
        assert depth_of_pressure(p, 35.0, 4.0, 9.81) == pytest.approx(h, abs=1e-8)


def test_sea_water_weighs_more_than_the_fresh_water_gradient() -> None:
    assert 10.06e3 < pressure_at_depth(1.0, 35.0, 10.0, 9.81) < 10.10e3


def test_reading_is_absolute_and_taken_where_the_sensor_sits(lanes: Any, silent: Any) -> None:
    m = pressure()
    run = lanes(m, parameters=silent(m) | {"r_s": [-0.5, 0, 0]})
    q = np.array(ca.DM(q_of_euler(0.0, 0.3, 0.0))).ravel()  # bow up, stern deeper
    run.step(0.0, 0.1, eta=[0, 0, 10, 0, 0.3, 0], q=q)
    g = float(gravity(0.7854))
    expected = 101325.0 + pressure_at_depth(10 + 0.5 * np.sin(0.3), 35.0, 10.0, g)
    assert run["pressure"] == pytest.approx([expected], rel=1e-12)


def test_above_the_water_it_reads_the_air(lanes: Any, silent: Any) -> None:
    m = pressure()
    run = lanes(m, parameters=silent(m)).step(0.0, 0.1, eta=[0, 0, -2, 0, 0, 0])
    assert run["pressure"] == pytest.approx([101325.0])


def test_beyond_its_range_it_saturates_and_is_not_valid(lanes: Any, silent: Any) -> None:
    m = pressure("bar30")
    run = lanes(m, parameters=silent(m))
    run.step(0.0, 0.1, eta=[0, 0, 280.0, 0, 0, 0])
    assert run["valid"] == 1.0
    run.step(0.1, 0.1, eta=[0, 0, 320.0, 0, 0, 0])
    assert (run["valid"], run["pressure"]) == (0.0, 30e5)


def test_in_fresh_water_a_metre_is_less_pressure_than_in_the_sea(lanes: Any, silent: Any) -> None:
    m = pressure()
    sea, lake = (
        lanes(m, parameters=silent(m) | {"salinity": s, "r_s": [0, 0, 0]}).step(
            0.0, 0.1, eta=[0, 0, 100.0, 0, 0, 0]
        )["pressure"][0]
        - 101325.0
        for s in (35.0, 0.0)
    )
    assert lake / sea == pytest.approx(1000.0 / 1027.0, rel=2e-3)
