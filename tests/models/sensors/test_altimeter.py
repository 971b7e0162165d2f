from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.models.declaration.kinematics import q_of_euler
from uuvsim_cosim.models.sensors.altimeter import altimeter

HALF = np.deg2rad(12.5)


def ping(
    lanes: Any, silent: Any, phi: float = 0.0, n: int = 1, depth: float = 5.0, **p: Any
) -> Any:
    m = altimeter()
    still = silent(m) | {"r_s": [0, 0, 0], "sigma_range_relative": 0.0} | p
    q = np.array(ca.DM(q_of_euler(phi, 0, 0))).ravel()
    return lanes(m, n, parameters=still).step(0.0, 0.1, eta=[0, 0, depth, 0, 0, 0], q=q)


def test_straight_down_it_reads_the_height(lanes: Any, silent: Any) -> None:
    assert ping(lanes, silent)["altitude"] == pytest.approx([20.0], abs=1e-12)


def test_within_half_its_beam_width_a_tilt_changes_nothing(lanes: Any, silent: Any) -> None:
    assert ping(lanes, silent, 0.9 * HALF)["altitude"] == pytest.approx([20.0], abs=1e-12)


def test_beyond_it_the_edge_of_the_beam_gives_the_range(lanes: Any, silent: Any) -> None:
    expected = 20.0 / np.cos(0.4 - HALF)
    assert ping(lanes, silent, 0.4)["altitude"] == pytest.approx([expected], abs=1e-12)


@pytest.mark.parametrize(
    ("phi", "depth"), [(1.2, 5.0), (np.pi, 5.0), (0.0, 24.9), (0.0, -90.0), (0.0, 30.0)]
)
def test_too_flat_upside_down_too_near_in_the_air_and_below_the_bottom_there_is_no_echo(
    lanes: Any, silent: Any, phi: float, depth: float
) -> None:
    run = ping(lanes, silent, phi, depth=depth)
    assert (run["valid"], run["t_sample"]) == (0.0, -1.0)
    assert np.all(np.isfinite(run.y))


def test_noise_grows_with_range_and_pings_are_lost_as_often_as_stated(
    lanes: Any, silent: Any
) -> None:
    wild = {"sigma_range": 0.03, "sigma_range_relative": 0.002, "dropout": 0.2}
    run = ping(lanes, silent, n=4000, **wild)
    heard = run["valid"][0] > 0.5
    assert np.mean(heard) == pytest.approx(0.8, abs=4.5 * np.sqrt(0.16 / 4000))
    assert np.std(run["altitude"][0][heard]) == pytest.approx(0.05, rel=0.06)
