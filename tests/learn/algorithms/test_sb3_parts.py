"""What Stable-Baselines3 logs of an update, as the losses of this project's learners."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from uuvsim_cosim.learn.algorithms.sb3_parts import logged_losses
from uuvsim_cosim.learn.shared.errors import LearningDiverged

LOGGED = {"train/loss": 0.5, "train/n_updates": 10.0, "train/learning_rate": 3e-4,
          "rollout/ep_rew_mean": 7.0, "train/explained_variance": float("nan")}  # fmt: skip


def model(logged: dict[str, float], weight: float = 1.0) -> Any:
    parameters = [("w", torch.tensor([weight]))]
    return SimpleNamespace(
        logger=SimpleNamespace(name_to_value=dict(logged)),
        policy=SimpleNamespace(named_parameters=lambda: parameters),
    )


def test_losses_of_an_update_are_passed_on_and_the_log_is_emptied() -> None:
    updated = model(LOGGED)
    assert logged_losses(updated, "ppo") == {"loss": 0.5}
    assert updated.logger.name_to_value == {}


@pytest.mark.parametrize("wrong", [float("nan"), float("inf")])
def test_a_loss_or_a_weight_that_is_not_finite_is_divergence(wrong: float) -> None:
    with pytest.raises(LearningDiverged, match="loss is"):
        logged_losses(model({**LOGGED, "train/loss": wrong}), "ppo")
    with pytest.raises(LearningDiverged, match="w is"):
        logged_losses(model(LOGGED, wrong), "ppo")
