"""DQN of one agent by stable-baselines3: its networks, buffer and updates, in our loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, final

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.action_grid import action_grid
from uuvsim_cosim.learn.algorithms.checkpoint import State, unfit
from uuvsim_cosim.learn.algorithms.dqn import DqnSettings
from uuvsim_cosim.learn.algorithms.replay_buffer import Transitions
from uuvsim_cosim.learn.algorithms.sb3_parts import (
    Randomness,
    layers,
    logged_losses,
    networks,
    set_networks,
    set_up,
)

try:
    from stable_baselines3 import DQN
except ModuleNotFoundError as error:
    raise InputInvalid(
        f"{error}; dqn expects stable-baselines3: pip install 'uuvsim-cosim[rl]'"
    ) from error

__all__ = ["Sb3Dqn"]

Array = NDArray[np.float32]
_ROWS = ("observations", "next_observations", "actions", "rewards", "dones", "timeouts")


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
        self._randomness = Randomness(seed)
        with self._randomness:
            self.model = set_up(
                DQN(
                    "MlpPolicy", None, learning_rate=s.lr, buffer_size=s.buffer,  # type: ignore[arg-type]
                    batch_size=s.batch, tau=s.tau, gamma=s.gamma, target_update_interval=n,
                    policy_kwargs={"net_arch": [s.hidden] * s.layers}, device="cpu",
                    _init_setup_model=False,
                ),
                observed, gymnasium.spaces.Discrete(len(self.grid)), n,
            )  # fmt: skip
        self._steps, self._due, self._updates = 0, 0.0, 0
        self._chosen: NDArray[np.int64] | None = None

    @property
    def settings(self) -> Mapping[str, float]:
        """All numbers."""
        return asdict(self.given)

    @property
    def epsilon(self) -> float:
        """The share of random actions now."""
        s = self.given
        done = min(self._steps / max(s.epsilon_steps, 1), 1.0)
        return s.epsilon + done * (s.epsilon_end - s.epsilon)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return the actions of greatest value; epsilon-greedy while exploring."""
        seen = torch.from_numpy(np.ascontiguousarray(observation[:, 0]))
        chosen = np.asarray(self.model.q_net(seen).argmax(1).numpy())
        if explore:
            with self._randomness:
                any_ = np.random.randint(0, len(self.grid), len(chosen))  # noqa: NPY002
                at_random = np.random.rand(len(chosen)) < self.epsilon  # noqa: NPY002
            self._chosen = chosen = np.where(at_random, any_, chosen)
        return np.asarray(self.grid[chosen][:, None])

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Store the transitions, and make the updates that are due."""
        buffer = self.model.replay_buffer
        if self._chosen is None or buffer is None:
            raise InputInvalid("dqn: nothing was chosen; expected act() before learn()")
        terminated = transitions.terminated[:, 0] > 0
        infos = [{"TimeLimit.truncated": bool(t)} for t in over & ~terminated]
        buffer.add(
            transitions.observation[:, 0], transitions.after[:, 0], self._chosen,
            transitions.reward[:, 0], over, infos,
        )  # fmt: skip
        self._steps += len(over)
        if self._steps < max(self.given.warm_up, self.given.batch):
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
        losses = logged_losses(self.model, self.name)
        return {**losses, "updates": float(self._updates), "epsilon": self.epsilon}

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the network, and the grid whose row of greatest value it chooses."""
        return "grid", {**layers([self.model.q_net.q_net]), "grid": self.grid}

    def state(self) -> State:
        """Return networks, optimiser, buffer, counters, random numbers."""
        buffer: Any = self.model.replay_buffer
        count = buffer.buffer_size if buffer.full else buffer.pos
        return {
            **networks(self.model),
            "kept": {k: getattr(buffer, k)[:count].copy() for k in _ROWS},
            "next": (buffer.pos, buffer.full),
            "counters": (self._steps, self._due, self._updates),
            "random": self._randomness.state(),
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        try:
            set_networks(self.model, state)
            buffer: Any = self.model.replay_buffer
            for k in _ROWS:
                getattr(buffer, k)[: len(state["kept"][k])] = state["kept"][k]
            buffer.pos, buffer.full = state["next"]
            self._steps, self._due, self._updates = state["counters"]
            self._randomness.set_state(state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise unfit(error) from error
