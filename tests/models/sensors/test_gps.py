from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.models.declaration.kinematics import q_of_euler
from uuvsim_cosim.models.sensors.gps import gps
from uuvsim_cosim.models.sensors.usbl import usbl

UP = [10.0, -4.0, 0.0, 0, 0, 0]  # antenna 0.25 m above the water
DOWN = [10.0, -4.0, 0.3, 0, 0, 0]


def test_there_is_no_fix_under_water_and_the_last_one_stays(lanes: Any, silent: Any) -> None:
    m = gps(period="0.5")
    run = lanes(m, parameters=silent(m) | {"reacquisition": 0.0})
    run.step(0.0, 0.5, eta=UP)
    assert (run["valid"], run["t_sample"]) == (1.0, 0.0)
    run.step(0.5, 0.5, eta=DOWN)
    assert (run["valid"], run["t_sample"]) == (0.0, 0.0)
    assert run["position"] == pytest.approx([10, -4, -0.25], abs=1e-12)


def test_a_fix_takes_its_time_after_every_dive(lanes: Any, silent: Any) -> None:
    m = gps(period="0.5")
    run = lanes(m, parameters=silent(m) | {"reacquisition": 1.0})
    seen = []
    for k, eta in enumerate([UP] * 4 + [DOWN] + [UP] * 4):
        seen.append(float(run.step(0.5 * k, 0.5, eta=eta)["valid"][0]))
    assert seen == [0, 0, 1, 1, 0, 0, 0, 1, 1]


def test_an_antenna_in_the_waves_is_under_water(lanes: Any, silent: Any) -> None:
    m = gps()
    run = lanes(m, parameters=silent(m) | {"reacquisition": 0.0, "clearance": 0.3})
    assert run.step(0.0, 1.0, eta=UP)["valid"] == 0.0


def test_a_hull_on_its_side_has_its_antenna_in_the_water(lanes: Any, silent: Any) -> None:
    m = gps()
    run = lanes(m, parameters=silent(m) | {"reacquisition": 0.0})
    q = np.array(ca.DM(q_of_euler(np.pi / 2, 0, 0))).ravel()
    assert run.step(0.0, 1.0, eta=UP, q=q)["valid"] == 0.0


def test_position_and_velocity_are_those_of_the_antenna(lanes: Any, silent: Any) -> None:
    m = gps()
    run = lanes(m, parameters=silent(m) | {"reacquisition": 0.0, "r_s": [0.5, 0, -0.4]})
    q = np.array(ca.DM(q_of_euler(0, 0, np.pi / 2))).ravel()
    run.step(0.0, 1.0, eta=UP, q=q, nu=[1.0, 0, 0, 0, 0, 0.2])
    assert run["position"] == pytest.approx([10, -3.5, -0.4], abs=1e-12)
    assert run["velocity"] == pytest.approx([-0.1, 1.0, 0], abs=1e-12)


def test_errors_have_the_deviation_that_it_states(lanes: Any) -> None:
    run = lanes(gps(), 4000, parameters={"reacquisition": 0.0}).step(0.0, 1.0, eta=UP)
    assert np.std(run["position"], axis=1) == pytest.approx(run["sigma"][:, 0], rel=0.06)
    half = np.median(np.hypot(run["position"][0] - 10, run["position"][1] + 4))
    assert half == pytest.approx(1.5, rel=0.06)  # the receiver's circle


def test_it_stands_in_for_a_usbl() -> None:
    mine, other = (
        {(v.name, v.shape, v.units, v.unit) for v in m.of_kind("output")} for m in (gps(), usbl())
    )
    assert other <= mine
