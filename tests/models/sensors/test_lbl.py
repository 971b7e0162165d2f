from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.sensors.lbl import lbl
from uuvsim_cosim.models.water.seawater import sound_speed

PLACES = np.array([[300.0, 0, 0], [0, 150, 0], [0, 0, 75]])
C = float(sound_speed(10.0, 35.0, 0.0))
EXACT = {"r_s": [0, 0, 0], "p_beacon": PLACES.ravel(), "c_assumed": C, "turnaround": 0.05}


def test_all_ranges_show_when_the_last_reply_is_there(lanes: Any, silent: Any) -> None:
    m = lbl(beacons=3)
    run = lanes(m, parameters=silent(m) | EXACT)
    seen = []
    for k in range(80):
        run.step(k * 0.01, 0.01, eta=[0.1 * k, 0, 0, 0, 0, 0])
        seen.append(float(run["valid"][0]))
    assert seen.index(1.0) == int(np.ceil((2 * 300.0 / C + 0.05) / 0.01))
    assert run["range"] == pytest.approx([300.0, 150.0, 75.0], abs=1e-9)
    assert run["t_sample"] == 0.0


def test_a_wrong_speed_of_sound_stretches_every_range(lanes: Any, silent: Any) -> None:
    m = lbl(beacons=3)
    run = lanes(m, parameters=silent(m) | EXACT | {"c_assumed": 1.02 * C})
    for k in range(80):
        run.step(k * 0.01, 0.01)
    assert run["range"] == pytest.approx(1.02 * np.array([300.0, 150.0, 75.0]), abs=1e-9)


def test_a_beacon_out_of_range_is_marked_and_keeps_its_last_range(lanes: Any, silent: Any) -> None:
    m = lbl(beacons=3)
    run = lanes(m, parameters=silent(m) | EXACT | {"range_max": 250.0})
    for k in range(80):
        run.step(k * 0.01, 0.01)
    assert list(run["range_valid"]) == [0, 1, 1]
    assert run["range"] == pytest.approx([0.0, 150.0, 75.0], abs=1e-9)


def test_the_next_call_waits_for_the_last_reply(lanes: Any, silent: Any) -> None:
    m = lbl(beacons=1, period="0.25")  # the reply takes 0.45 s
    run = lanes(m, parameters=silent(m) | EXACT | {"p_beacon": PLACES[0]})
    times = {float(run.step(k * 0.01, 0.01)["t_sample"][0]) for k in range(150)}
    assert times == {-1.0, 0.0, 0.5, 1.0}


def test_replies_are_lost_as_often_as_stated_and_ranges_are_as_noisy(lanes: Any) -> None:
    run = lanes(lbl(beacons=3), 2000, parameters=EXACT | {"dropout": 0.3, "sigma_range": 0.2})
    for k in range(80):
        run.step(k * 0.01, 0.01)
    heard = run["range_valid"] > 0.5
    assert np.mean(heard) == pytest.approx(0.7, abs=0.02)
    noise = (run["range"] - np.array([[300.0], [150.0], [75.0]]))[heard]
    assert np.std(noise) == pytest.approx(0.2, rel=0.06)


def test_none_and_too_many_beacons_are_refused() -> None:
    for n in (0, 17):
        with pytest.raises(ParameterInvalid, match=f"{n} beacons; expected 1 to 16"):
            lbl(beacons=n)
