"""Common parts of the learners of stable-baselines3: random numbers, networks, losses.

They are a check of this package's own learners by independent code. Each learner has its own random
generators, so a resumed training has the same bits.
"""

from __future__ import annotations

import random
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar, final

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from uuvsim_cosim.learn.shared.errors import LearningDiverged

if TYPE_CHECKING:
    from stable_baselines3.common.base_class import BaseAlgorithm

    from uuvsim_cosim.learn.algorithms.checkpoint import State

__all__ = ["Randomness", "layers", "logged_losses", "networks", "set_networks", "set_up"]

Array = NDArray[np.float32]
Model = TypeVar("Model", bound="BaseAlgorithm")


@final
class Randomness:
    """Random generators of one learner, in place of the global ones that stable-baselines3 uses."""

    def __init__(self, seed: int) -> None:
        self._torch = torch.Generator().manual_seed(seed).get_state()
        self._numpy: Any = np.random.RandomState(seed % 2**32).get_state()
        self._outer: Any = None

    def __enter__(self) -> None:
        """Replace the global generators' states by the learner's."""
        self._outer = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
        torch.set_rng_state(self._torch)
        np.random.set_state(self._numpy)  # noqa: NPY002

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Keep the learner's states, and restore the global ones."""
        self._torch, self._numpy = torch.get_rng_state(), np.random.get_state()  # noqa: NPY002
        torch.set_rng_state(self._outer[0])
        np.random.set_state(self._outer[1])  # noqa: NPY002
        random.setstate(self._outer[2])

    def state(self) -> dict[str, object]:
        """Return the generators' states as plain numbers."""
        words = np.asarray(self._numpy[1], np.int64)
        return {"torch": self._torch, "words": words, "rest": list(self._numpy[2:])}

    def set_state(self, state: State) -> None:
        """Restore the generators' states."""
        self._torch = state["torch"]
        place, has, cached = state["rest"]
        self._numpy = ("MT19937", state["words"].astype(np.uint32), place, has, cached)


def set_up(model: Model, observed: int, actions: gymnasium.Space[Any], n: int) -> Model:
    """Make a model's networks and buffers for spaces, as its own `load` does."""
    model.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (observed,), np.float32)
    model.action_space, model.n_envs = actions, n
    from stable_baselines3.common.logger import Logger

    model._setup_model()
    model.set_logger(Logger(None, []))
    return model


def logged_losses(model: BaseAlgorithm, name: str) -> dict[str, float]:
    """Return the logged losses; raises LearningDiverged for one that is not finite."""
    logged = model.logger.name_to_value
    losses = {
        k.removeprefix("train/"): float(v)
        for k, v in logged.items()
        if k.startswith("train/") and not k.endswith(("n_updates", "learning_rate", "clip_range"))
    }
    logged.clear()
    for what, value in losses.items():
        if not np.isfinite(value) and what != "explained_variance":
            raise LearningDiverged(name, what, value)
    for what, parameter in model.policy.named_parameters():
        if not bool(torch.isfinite(parameter).all()):
            raise LearningDiverged(name, what, float("nan"))
    return {k: v for k, v in losses.items() if np.isfinite(v)}


def layers(parts: list[nn.Module]) -> dict[str, Array]:
    """Return the linear layers of modules, in their order, as a `Policy` has them."""
    linear = [m for part in parts for m in part.modules() if isinstance(m, nn.Linear)]
    return {
        f"{i}.{what}": np.array(getattr(m, what).detach().numpy())
        for i, m in enumerate(linear)
        for what in ("weight", "bias")
    }


def networks(model: BaseAlgorithm) -> dict[str, object]:
    """Return networks and optimiser."""
    policy = model.policy
    return {"policy": policy.state_dict(), "adam": policy.optimizer.state_dict()}


def set_networks(model: BaseAlgorithm, state: State) -> None:
    """Restore networks and optimiser."""
    model.policy.load_state_dict(state["policy"])
    model.policy.optimizer.load_state_dict(state["adam"])
