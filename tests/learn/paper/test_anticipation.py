"""Anticipation shows a policy what will be when its action arrives, on motions in closed form."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper.anticipation import Anticipating

T, V = 0.4, 0.4
TARGET, SPEED = np.array([0.5, -0.3]), np.array([0.10, 0.05])


def pose(t: float) -> tuple[float, float, float]:
    """Return a vehicle that has always gone ahead at 0.2 m/s, turning by 0.3 rad/s."""
    psi = 0.3 * t
    return 0.2 / 0.3 * math.sin(psi), 0.2 / 0.3 * (1.0 - math.cos(psi)), psi


def observed(own: float, target: float) -> NDArray[np.float64]:
    """Return an observation of where it was at time `own`, and the target at `target`."""
    x, y, psi = pose(own)
    c, s = math.cos(psi), math.sin(psi)
    away = TARGET + target * SPEED - [x, y]
    ahead = [c * away[0] + s * away[1], c * away[1] - s * away[0]]
    moved = np.array([c * SPEED[0] + s * SPEED[1], c * SPEED[1] - s * SPEED[0]]) / V
    o = np.zeros((1, 31))
    o[0, :8] = [x / 1.3, y / 2.4, c, s, 0.2 / V, 0.0, 0.3, 0.2 / V]
    o[0, 8:14] = [1.0, *ahead, math.hypot(*ahead), *moved]
    return o


@pytest.mark.parametrize("late", [(0.0, 0.0), (0.4, 0.0), (0.0, 0.4), (0.4, 0.4), (0.2, 0.3)])
def test_the_policy_sees_the_time_when_its_action_arrives(late: tuple[float, float]) -> None:
    seen: list[Any] = []

    def act(o: NDArray[Any]) -> NDArray[np.float64]:
        seen.append(o.copy())
        return np.array([[0.0, 0.3 / 1.5]])  # that goes on as it has gone

    policy = Anticipating(act, *late)
    for k in range(12):
        known = k * T - late[0]
        policy(observed(known, known))
    wanted = observed(11 * T + late[1], 11 * T + late[1])
    np.testing.assert_allclose(seen[-1][0, :8], wanted[0, :8], atol=3e-3)
    np.testing.assert_allclose(seen[-1][0, 8:14], wanted[0, 8:14], atol=0.02)


def test_begin_forgets_what_was_before() -> None:
    policy = Anticipating(lambda o: np.zeros((len(o), 2)), 0.4, 0.4)
    for k in range(3):
        policy(observed(k * T, k * T))
    policy.begin()
    assert policy(np.repeat(observed(0, 0), 5, axis=0)).shape == (5, 2)


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(InputInvalid, match="acted_late"):
        Anticipating(lambda o: o, 0.0, float("nan"))
    with pytest.raises(InputInvalid, match=r"expected \(n, 31\)"):
        Anticipating(lambda o: o, 0.0, 0.0)(np.zeros((1, 30)))
