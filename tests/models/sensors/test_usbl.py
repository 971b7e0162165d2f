from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.sensors.usbl import usbl
from uuvsim_cosim.models.water.seawater import sound_speed

NO_LEVER = {"r_s": [0, 0, 0], "p_transceiver": [0, 0, 0]}


def test_a_fix_is_not_visible_before_sound_has_brought_it(lanes: Any, silent: Any) -> None:
    m = usbl()
    run = lanes(m, parameters=silent(m) | NO_LEVER)
    latency = 2 * 300.0 / sound_speed(10.0, 35.0, 0.0)
    seen = []
    for k in range(60):
        run.step(k * 0.01, 0.01, eta=[300.0 + k, 0, 0, 0, 0, 0])  # it moves on meanwhile
        seen.append(float(run["valid"][0]))
    first = seen.index(1.0)
    assert first == int(np.ceil(latency / 0.01))
    assert run["t_sample"] == 0.0
    assert run["position"] == pytest.approx([300.0, 0, 0], abs=1e-9)


def test_before_the_first_fix_nothing_is_valid(lanes: Any) -> None:
    run = lanes(usbl()).step(0.0, 0.01, eta=[100.0, 0, 0, 0, 0, 0])
    assert run["valid"] == 0.0
    assert run["t_sample"] == -1.0


def test_far_away_a_ping_under_way_is_awaited(lanes: Any, silent: Any) -> None:
    m = usbl(period="0.5")
    run = lanes(m, parameters=silent(m) | NO_LEVER)  # 450 m: the fix takes 0.6 s
    times = set()
    for k in range(300):
        run.step(k * 0.01, 0.01, eta=[450.0, 0, 0, 0, 0, 0])
        times.add(float(run["t_sample"][0]))
    assert times == {-1.0, 0.0, 1.0, 2.0}


def test_out_of_range_there_is_no_fix(lanes: Any) -> None:
    run = lanes(usbl())
    for k in range(200):
        run.step(k * 0.01, 0.01, eta=[600.0, 0, 0, 0, 0, 0])
    assert run["valid"] == 0.0


def test_noise_grows_with_range_across_the_line_of_sight_only(lanes: Any) -> None:
    run = lanes(usbl(), 3000, parameters=NO_LEVER | {"dropout": 0.0})
    for k in range(30):
        run.step(k * 0.01, 0.01, eta=[0, 200.0, 0, 0, 0, 0])
    across = 200.0 * np.deg2rad(0.5)
    expected = [across, 0.1, across]
    assert np.std(run["position"], axis=1) == pytest.approx(expected, rel=0.06)
    assert run["sigma"][:, 0] == pytest.approx(expected, rel=1e-6)


def test_fixes_are_lost_as_often_as_stated(lanes: Any) -> None:
    run = lanes(usbl(), 3000, parameters={"dropout": 0.3})
    for k in range(5):
        run.step(k * 0.01, 0.01, eta=[3.0, 0, 0, 0, 0, 0])
    assert 1 - np.mean(run["valid"]) == pytest.approx(0.3, abs=4.5 * np.sqrt(0.21 / 3000))


def test_position_is_that_of_the_transponder(lanes: Any, silent: Any) -> None:
    m = usbl()
    run = lanes(m, parameters=silent(m) | {"r_s": [0, 0, -0.15]})
    for k in range(5):
        run.step(k * 0.01, 0.01, eta=[3.0, 2.0, 4.0, 0, 0, 0])
    assert run["position"] == pytest.approx([3.0, 2.0, 3.85], abs=1e-9)
