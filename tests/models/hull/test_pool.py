"""Contact with a pool: continuous, one-sided, and it only ever takes energy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.hull.matrices import nominal

H = 0.02
M = np.array(nominal("pool8")[0])
R, HALF = 0.149, 0.06
K, B = 0.14 * M[0] / H**2, 0.14 * M[0] / H


def force(position: Any, nu: Any = (0,) * 6, q: Any = (1, 0, 0, 0), **parameters: Any) -> Any:
    obstacles = len(parameters.get("obstacles", []))
    f = Evaluation(declare("pool", obstacles=obstacles))
    p = f.values_of("parameter", parameters)
    inputs = f.values_of("input", {"position": position, "nu": nu, "q": q})
    return np.array(f.outputs(0, inputs, p, [], [], [])).ravel()


def test_free_water_does_not_push() -> None:
    np.testing.assert_array_equal(force((0.5, -1.0, 0.5), (0.4, 0.4, 0.1, 0, 0, 1)), np.zeros(6))


@pytest.mark.parametrize(
    ("position", "axis", "sign"),
    [
        ((1.3 - R + 0.01, 0, 0.5), 0, -1),
        ((-1.3 + R - 0.01, 0, 0.5), 0, 1),
        ((0, 2.4 - R + 0.01, 0.5), 1, -1),
        ((0, -2.4 + R - 0.01, 0.5), 1, 1),
        ((0, 0, 1.1 - HALF + 0.01), 2, -1),
    ],
)
def test_a_hull_at_rest_feels_the_spring_of_each_wall_and_the_floor(
    position: Any, axis: int, sign: int
) -> None:
    wanted = np.zeros(6)
    wanted[axis] = sign * K * 0.01
    np.testing.assert_allclose(force(position), wanted, atol=1e-9)


def test_force_is_given_in_the_bodys_axes() -> None:
    east = np.array([np.sqrt(0.5), 0, 0, np.sqrt(0.5)])  # bow to east
    tau = force((1.3 - R + 0.01, 0, 0.5), q=east)
    np.testing.assert_allclose(tau, [0, K * 0.01, 0, 0, 0, 0], atol=1e-9)


def test_a_hull_that_leaves_quickly_is_not_held() -> None:
    np.testing.assert_array_equal(force((1.3 - R + 0.001, 0, 0.5), (-0.4, 0, 0, 0, 0, 0)), 0.0)


def test_force_is_continuous_in_position_and_speed() -> None:
    for speed in (-0.2, 0.0, 0.3):
        x = np.linspace(1.05, 1.25, 401)
        f = np.array([force((s, 0, 0.5), (speed, 0, 0, 0, 0, 0))[0] for s in x])
        assert np.max(np.abs(np.diff(f))) <= K * (x[1] - x[0]) * (1 + 1e-9)


def test_an_obstacle_pushes_outwards_where_it_reaches_the_hull() -> None:
    tall = [[0.5, 0.0, 0.1, 0.8]]
    near = (0.5 - 0.1 - R + 0.01, 0, 0.6)
    np.testing.assert_allclose(force(near, obstacles=tall), [-K * 0.01, 0, 0, 0, 0, 0], atol=1e-9)
    assert not np.any(force(near, obstacles=[[0.5, 0.0, 0.1, 0.3]]))
    assert not np.any(force((0.5, 0.0, 0.6), obstacles=[[0.5, 0.0, 0.0, 0.8]]))


@pytest.mark.parametrize("seed", range(4))
def test_no_bounce_gains_energy(seed: int) -> None:
    """A hull without drag, the force held for each step: less in every free flight than before."""
    hull, rng = Evaluation(declare("pool8", surface=False)), np.random.default_rng(seed)
    free = {f"D_{k}_{i}{i}": 0.0 for k in "lq" for i in range(1, 7)} | {"nabla": 0.0022}
    start = {
        "eta_0": [1.1, 2.2, 0.9, 0, 0, rng.uniform(-3, 3)],
        "nu_0": [*rng.uniform(-0.8, 0.8, 3), 0, 0, rng.uniform(-3, 3)],
    }
    p = hull.values_of("parameter", free | start)
    d = np.array(hull.derived(p)).ravel()
    x = np.array(hull.initial(p, d)).ravel()
    pool = Evaluation(declare("pool"))
    pp = pool.values_of("parameter", {})
    edges = np.array([1.3 - R, 2.4 - R])

    def energy(x: Any) -> float:
        _, i, j, _ = x[3:7] / np.linalg.norm(x[3:7])
        upright = 1 - 2 * (i * i + j * j)
        return float(0.5 * np.sum(M * x[7:] ** 2) + 2.2 * 9.81 * 0.01 * (1 - upright))

    free_flight, bounces, touching = energy(x), 0, False
    for _ in range(1000):
        tau = np.array(pool.outputs(0, x, pp, [], [], [])).ravel()
        if not np.any(tau):
            assert energy(x) <= free_flight + 2e-6
            free_flight, bounces = energy(x), bounces + touching
        touching = bool(np.any(tau))
        u = hull.values_of("input", {"tau": tau})
        for _ in range(4):
            x = np.array(hull.rk4(0, H / 4, u, u, u, p, d, x, [])).ravel()
    assert bounces >= 2
    assert np.all(np.abs(x[:2]) < edges + 0.06)


def test_a_stiffness_that_a_held_force_cannot_bear_is_out_of_range() -> None:
    declared = declare("pool").variables["K"]
    assert declared.max == pytest.approx(0.5 * M[0] / H**2)
    with pytest.raises(ParameterInvalid, match="step = 0"):
        declare("pool", step=0)
    with pytest.raises(ParameterInvalid, match="65 obstacles"):
        declare("pool", obstacles=65)
