"""What target tracking calls a symmetry is one: of vehicles, observations and rewards."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.pool_tracking import PoolTracking
from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking

Array = NDArray[np.float64]
SIGNS = {"mirror": (1.0, -1.0), "half turn": (-1.0, -1.0), "mirror and half turn": (-1.0, 1.0)}


class Seen(TargetTracking):
    """Target tracking whose starts are as a symmetry has them."""

    image = ""

    def start(self, draws: Draws) -> Mapping[str, Array]:
        start = {k: np.array(v, float) for k, v in super().start(draws).items()}
        if self.image:
            north, east = SIGNS[self.image]
            turn = np.pi if north < 0 else 0.0  # of the heading's zero
            for name, value in start.items():
                if name.endswith(("eta_0", "position_0", "obstacles")):
                    value[..., :2] *= north, east
                heading = value[..., 5] if name.endswith("eta_0") else value
                if name.endswith(("eta_0", "psi_0")):
                    heading[...] = turn + north * east * heading
        return start


def lived(image: str, signs: Array, **options: Any) -> tuple[Array, Array]:
    """Return observations (k, N, n, d) and rewards of eight random actions, seen in the image."""
    task = Seen(2, 2, motion="rest", rules={"credit": "own"}, **options)
    task.image = image
    simulation, random = TeamSimulation(task, 6), np.random.default_rng(3)
    simulation.reset(seeds=list(range(6)))
    observed, rewards = [], []
    for _ in range(8):
        acts = {a: random.uniform(-1, 1, (6, 2)) * signs for a in task.agents}
        now = simulation.act(acts)
        observed.append([now.observation[a] for a in task.agents])
        rewards.append(now.reward)
    simulation.episodes.close()
    return np.array(observed), np.array(rewards)


@pytest.mark.parametrize("k", range(3), ids=list(SIGNS))
def test_transitions_and_rewards_are_the_same_in_each_image(k: int) -> None:
    symmetry = TargetTracking(2, 2).symmetries()[k]
    plain, image = lived("", np.ones(2)), lived(symmetry.name, symmetry.action)
    assert np.ptp(plain[1]) > 1  # some are punished, or come closer
    assert image[0] == pytest.approx(plain[0] * symmetry.observation, abs=2e-6)
    assert image[1] == pytest.approx(plain[1], abs=1e-9)


def test_there_is_none_where_the_way_round_is_given() -> None:
    assert TargetTracking(1, 0, motion="path").symmetries() == ()
    assert PoolTracking().symmetries() == ()
