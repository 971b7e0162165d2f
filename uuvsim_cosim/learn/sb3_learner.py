"""PPO and DQN of one agent by stable-baselines3: its networks, buffers and updates, in our loop.

They stand beside the learners of this package as a check on them: theirs is another's code. What
stable-baselines3 draws comes from generators of its own, so a training goes on to the same bits.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import asdict
from types import TracebackType
from typing import Any, final

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.dqn import DqnSettings
from uuvsim_cosim.learn.errors import LearningDiverged
from uuvsim_cosim.learn.grid import action_grid
from uuvsim_cosim.learn.ppo import PpoSettings
from uuvsim_cosim.learn.replay import Transitions

try:
    from stable_baselines3 import DQN, PPO
    from stable_baselines3.common.logger import Logger
except ModuleNotFoundError as error:
    raise InputInvalid(
        f"{error}; ppo and dqn expect stable-baselines3: pip install 'uuvsim-cosim[rl]'"
    ) from error

__all__ = ["Sb3Dqn", "Sb3Ppo"]

Array = NDArray[np.float32]
_COLUMNS = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs")
_ROWS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


@final
class Sb3Ppo:
    """stable-baselines3's PPO."""

    name = "ppo"

    def __init__(
        self, observed: int, acted: int, n: int, *, seed: int = 0,
        settings: PpoSettings | None = None,
    ) -> None:  # fmt: skip
        self.given = s = settings or PpoSettings()
        self._randomness = _Randomness(seed)
        with self._randomness:
            self.model = _set_up(
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
        self._drawn: tuple[Any, Any, Any] | None = None

    @property
    def settings(self) -> Mapping[str, Any]:
        """Give all numbers."""
        return asdict(self.given)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Give actions: drawn and cut to [-1, 1], or the mean."""
        with self._randomness:
            seen = torch.from_numpy(np.ascontiguousarray(observation[:, 0]))
            action, value, log_pi = self._policy(seen, deterministic=not explore)
        if explore:
            self._drawn = action.numpy(), value, log_pi
        return np.asarray(np.clip(action.numpy(), -1.0, 1.0)[:, None])

    def learn(self, lived: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Keep what was lived; every so often learn from it, and forget it."""
        if self._drawn is None:
            raise InputInvalid("ppo: nothing was drawn; expected act() before learn()")
        drawn, value, log_pi = self._drawn
        buffer, after = self.model.rollout_buffer, torch.from_numpy(lived.after[:, 0].copy())
        with torch.no_grad():
            worth = self._policy.predict_values(after)
        cut_short = over & (lived.terminated[:, 0] == 0)
        reward = lived.reward[:, 0] + self.given.gamma * np.where(
            cut_short, worth.numpy()[:, 0], 0.0
        )
        buffer.add(lived.observation[:, 0], drawn, reward, self._starts, value, log_pi)
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
        return _told(self.model, self.name)

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Give the actor's mean, to be cut to [-1, 1]."""
        return "clip", _layers([self._policy.mlp_extractor.policy_net, self._policy.action_net])

    def state(self) -> Mapping[str, Any]:
        """Give networks, optimiser, what is kept, random numbers."""
        buffer = self.model.rollout_buffer
        return {
            **_networks(self.model),
            "kept": {k: getattr(buffer, k)[: buffer.pos].copy() for k in _COLUMNS},
            "starts": self._starts.copy(),
            "random": self._randomness.state(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        try:
            _set_networks(self.model, state)
            buffer, kept = self.model.rollout_buffer, state["kept"]
            buffer.reset()
            buffer.pos = len(kept["rewards"])
            for k in _COLUMNS:
                getattr(buffer, k)[: buffer.pos] = kept[k]
            self._starts = np.array(state["starts"])
            self._randomness.set_state(state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise InputInvalid(f"checkpoint: {error}; expected one of this algorithm") from error


@final
class Sb3Dqn:
    """stable-baselines3's DQN, that chooses among `action_grid`."""

    name = "dqn"

    def __init__(
        self, observed: int, acted: int, n: int, *, seed: int = 0,
        settings: DqnSettings | None = None,
    ) -> None:  # fmt: skip
        self.given = s = settings or DqnSettings()
        self.grid = action_grid(acted)
        self._randomness = _Randomness(seed)
        with self._randomness:
            self.model = _set_up(
                DQN(
                    "MlpPolicy", None, learning_rate=s.lr, buffer_size=s.buffer,  # type: ignore[arg-type]
                    batch_size=s.batch, tau=s.tau, gamma=s.gamma, target_update_interval=n,
                    policy_kwargs={"net_arch": [s.hidden] * s.layers}, device="cpu",
                    _init_setup_model=False,
                ),
                observed, gymnasium.spaces.Discrete(len(self.grid)), n,
            )  # fmt: skip
        self._lived, self._due, self._updates = 0, 0.0, 0
        self._chosen: NDArray[np.int64] | None = None

    @property
    def settings(self) -> Mapping[str, Any]:
        """Give all numbers."""
        return asdict(self.given)

    @property
    def epsilon(self) -> float:
        """Give the share of random actions now."""
        s = self.given
        done = min(self._lived / max(s.epsilon_steps, 1), 1.0)
        return s.epsilon + done * (s.epsilon_end - s.epsilon)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Give the actions of greatest value, or now and then any."""
        seen = torch.from_numpy(np.ascontiguousarray(observation[:, 0]))
        chosen = np.asarray(self.model.q_net(seen).argmax(1).numpy())
        if explore:
            with self._randomness:
                any_ = np.random.randint(0, len(self.grid), len(chosen))  # noqa: NPY002
                at_random = np.random.rand(len(chosen)) < self.epsilon  # noqa: NPY002
            self._chosen = chosen = np.where(at_random, any_, chosen)
        return np.asarray(self.grid[chosen][:, None])

    def learn(self, lived: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Keep what was lived, and make the updates that are due."""
        buffer = self.model.replay_buffer
        if self._chosen is None or buffer is None:
            raise InputInvalid("dqn: nothing was chosen; expected act() before learn()")
        terminated = lived.terminated[:, 0] > 0
        infos = [{"TimeLimit.truncated": bool(t)} for t in over & ~terminated]
        buffer.add(
            lived.observation[:, 0], lived.after[:, 0], self._chosen, lived.reward[:, 0], over,
            infos,
        )  # fmt: skip
        self._lived += len(over)
        if self._lived < max(self.given.warm_up, self.given.batch):
            return {}
        self._due += self.given.updates
        learned = False
        with self._randomness:
            while self._due >= 1.0:
                self.model.train(1, self.given.batch)
                self.model._on_step()  # the soft update
                self._due -= 1.0
                self._updates += 1
                learned = True
        if not learned:
            return {}
        told = _told(self.model, self.name)
        return {**told, "updates": float(self._updates), "epsilon": self.epsilon}

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Give the network, and the grid whose row of greatest value it chooses."""
        return "grid", {**_layers([self.model.q_net.q_net]), "grid": self.grid}

    def state(self) -> Mapping[str, Any]:
        """Give networks, optimiser, buffer, counters, random numbers."""
        buffer: Any = self.model.replay_buffer
        count = buffer.buffer_size if buffer.full else buffer.pos
        return {
            **_networks(self.model),
            "kept": {k: getattr(buffer, k)[:count].copy() for k in _ROWS},
            "next": (buffer.pos, buffer.full),
            "counters": (self._lived, self._due, self._updates),
            "random": self._randomness.state(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        try:
            _set_networks(self.model, state)
            buffer: Any = self.model.replay_buffer
            for k in _ROWS:
                getattr(buffer, k)[: len(state["kept"][k])] = state["kept"][k]
            buffer.pos, buffer.full = state["next"]
            self._lived, self._due, self._updates = state["counters"]
            self._randomness.set_state(state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise InputInvalid(f"checkpoint: {error}; expected one of this algorithm") from error


@final
class _Randomness:
    """The global random numbers, which stable-baselines3 draws from, lent to one learner."""

    def __init__(self, seed: int) -> None:
        self._torch = torch.Generator().manual_seed(seed).get_state()
        self._numpy: Any = np.random.RandomState(seed % 2**32).get_state()
        self._outer: Any = None

    def __enter__(self) -> None:
        """Put the learner's in place of everybody's."""
        self._outer = torch.get_rng_state(), np.random.get_state(), random.getstate()  # noqa: NPY002
        torch.set_rng_state(self._torch)
        np.random.set_state(self._numpy)  # noqa: NPY002

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Keep the learner's, and give everybody's back."""
        self._torch, self._numpy = torch.get_rng_state(), np.random.get_state()  # noqa: NPY002
        torch.set_rng_state(self._outer[0])
        np.random.set_state(self._outer[1])  # noqa: NPY002
        random.setstate(self._outer[2])

    def state(self) -> dict[str, Any]:
        words = np.asarray(self._numpy[1], np.int64)
        return {"torch": self._torch, "words": words, "rest": list(self._numpy[2:])}

    def set_state(self, state: Mapping[str, Any]) -> None:
        self._torch = state["torch"]
        place, has, cached = state["rest"]
        self._numpy = ("MT19937", state["words"].astype(np.uint32), place, has, cached)


def _set_up(model: Any, observed: int, actions: gymnasium.Space[Any], n: int) -> Any:
    """Make a model's networks and buffers for spaces, as its own `load` does."""
    model.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (observed,), np.float32)
    model.action_space, model.n_envs = actions, n
    model._setup_model()
    model.set_logger(Logger(None, []))
    return model


def _told(model: Any, name: str) -> dict[str, float]:
    """Give what was logged; raises LearningDiverged for what is no number."""
    logged = model.logger.name_to_value
    told = {
        k.removeprefix("train/"): float(v)
        for k, v in logged.items()
        if k.startswith("train/") and not k.endswith(("n_updates", "learning_rate", "clip_range"))
    }
    logged.clear()
    for what, value in told.items():
        if not np.isfinite(value) and what != "explained_variance":
            raise LearningDiverged(name, what, value)
    for what, parameter in model.policy.named_parameters():
        if not bool(torch.isfinite(parameter).all()):
            raise LearningDiverged(name, what, float("nan"))
    return {k: v for k, v in told.items() if np.isfinite(v)}


def _layers(parts: list[nn.Module]) -> dict[str, Array]:
    linear = [m for part in parts for m in part.modules() if isinstance(m, nn.Linear)]
    return {
        f"{i}.{what}": np.array(getattr(m, what).detach().numpy())
        for i, m in enumerate(linear)
        for what in ("weight", "bias")
    }


def _networks(model: Any) -> dict[str, Any]:
    policy = model.policy
    return {"policy": policy.state_dict(), "adam": policy.optimizer.state_dict()}


def _set_networks(model: Any, state: Mapping[str, Any]) -> None:
    model.policy.load_state_dict(state["policy"])
    model.policy.optimizer.load_state_dict(state["adam"])
