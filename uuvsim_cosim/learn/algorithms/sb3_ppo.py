"""PPO of one agent by stable-baselines3: its networks, buffer and updates, in our loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, final

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import State, unfit
from uuvsim_cosim.learn.algorithms.ppo import PpoSettings
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.algorithms.sb3_parts import (
    Randomness,
    layers,
    logged_losses,
    networks,
    set_networks,
    set_up,
)
from uuvsim_cosim.learn.shared.errors import LearningDiverged

try:
    from stable_baselines3 import PPO
except ModuleNotFoundError as error:
    raise InputInvalid(
        f"{error}; ppo expects stable-baselines3: pip install 'uuvsim-cosim[rl]'"
    ) from error

__all__ = ["Sb3Ppo"]

Array = NDArray[np.float32]
_COLUMNS = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs")


@final
class Sb3Ppo:
    """stable-baselines3's PPO."""

    name = "ppo"

    def __init__(
        self, observed: int, acted: int, n: int, *, seed: int = 0,
        settings: PpoSettings | None = None,
    ) -> None:  # fmt: skip
        self.given = s = settings or PpoSettings()
        self._randomness = Randomness(seed)
        with self._randomness:
            self.model = set_up(
                PPO(
                    "MlpPolicy", None, learning_rate=s.lr, n_steps=-(-s.samples // n),  # type: ignore[arg-type]
                    batch_size=s.batch, n_epochs=s.epochs, gamma=s.gamma,
                    gae_lambda=s.gae_lambda, clip_range=s.clip, ent_coef=s.entropy,
                    vf_coef=s.value, max_grad_norm=s.max_norm, device="cpu",
                    policy_kwargs={"net_arch": [s.hidden] * s.layers, "activation_fn": nn.ReLU,
                                   "log_std_init": s.log_std},
                    _init_setup_model=False,
                ),
                observed, gymnasium.spaces.Box(-1.0, 1.0, (acted,), np.float32), n,
            )  # fmt: skip
        self._policy: Any = self.model.policy
        self._starts = np.ones(n, bool)
        self._drawn: tuple[Array, torch.Tensor, torch.Tensor] | None = None

    @property
    def settings(self) -> Mapping[str, float]:
        """All numbers."""
        return asdict(self.given)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions: drawn and cut to [-1, 1], or the mean."""
        with self._randomness:
            seen = torch.from_numpy(np.ascontiguousarray(observation[:, 0]))
            action, value, log_pi = self._policy(seen, deterministic=not explore)
        if explore:
            self._drawn = action.numpy(), value, log_pi
        return np.asarray(np.clip(action.numpy(), -1.0, 1.0)[:, None])

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Store the transitions; after `samples` steps learn from them, and discard them."""
        if self._drawn is None:
            raise InputInvalid("ppo: nothing was drawn; expected act() before learn()")
        drawn, value, log_pi = self._drawn
        buffer, after = self.model.rollout_buffer, torch.from_numpy(transitions.after[:, 0].copy())
        with torch.no_grad():
            worth = self._policy.predict_values(after)
        cut_short = over & (transitions.terminated[:, 0] == 0)
        reward = transitions.reward[:, 0] + self.given.gamma * np.where(
            cut_short, worth.numpy()[:, 0], 0.0
        )
        buffer.add(transitions.observation[:, 0], drawn, reward, self._starts, value, log_pi)
        self._starts = over.copy()
        if not buffer.full:
            return {}
        buffer.compute_returns_and_advantage(last_values=worth, dones=over)
        try:
            with self._randomness:
                self.model.train()
        except ValueError as error:  # a distribution's mean that is no number
            raise LearningDiverged(self.name, "the mean of an action", float("nan")) from error
        buffer.reset()
        return logged_losses(self.model, self.name)

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the actor's mean, to be cut to [-1, 1]."""
        return "clip", layers([self._policy.mlp_extractor.policy_net, self._policy.action_net])

    def state(self) -> State:
        """Return networks, optimiser, what is kept, random numbers."""
        buffer = self.model.rollout_buffer
        return {
            **networks(self.model),
            "kept": {k: getattr(buffer, k)[: buffer.pos].copy() for k in _COLUMNS},
            "starts": self._starts.copy(),
            "random": self._randomness.state(),
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        try:
            set_networks(self.model, state)
            buffer, kept = self.model.rollout_buffer, state["kept"]
            buffer.reset()
            buffer.pos = len(kept["rewards"])
            for k in _COLUMNS:
                getattr(buffer, k)[: buffer.pos] = kept[k]
            self._starts = np.array(state["starts"])
            self._randomness.set_state(state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise unfit(error) from error
