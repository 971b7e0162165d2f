"""Deep Q-learning of N independent agents, which choose among a grid of actions.

Mnih et al., "Human-level control through deep reinforcement learning", 2015. For each agent, with
the target network Q^-:

    L(Q) = huber(Q(s, a) - y),   y = r + gamma (1 - terminated) max_a' Q^-(s', a')
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Self, final

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import smooth_l1_loss

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import State, philox_state, set_philox_state, unfit
from uuvsim_cosim.learn.algorithms.gradients import descend
from uuvsim_cosim.learn.algorithms.replay_buffer import Replay, Transitions
from uuvsim_cosim.learn.algorithms.stacked import StackedMLP
from uuvsim_cosim.learn.algorithms.transfer import pass_on

__all__ = ["DqnLearner", "DqnSettings", "action_grid"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class DqnSettings:
    """Settings of DQN; those that the UUVSim paper names have the same values as for MASAC."""

    lr: float = 3e-4  # step size of Adam
    gamma: float = 0.99  # discount factor
    tau: float = 0.01  # soft update of the target networks
    epsilon: float = 1.0  # share of random actions at the start
    epsilon_end: float = 0.05  # the same at the end
    epsilon_steps: int = 20_000  # environment steps of the linear decrease between them
    batch: int = 256  # transitions in one update
    buffer: int = 100_000  # transitions that the replay buffer holds
    warm_up: int = 500  # environment steps before the first update
    updates: float = 1.0  # gradient updates each time that all environments have made one step
    hidden: int = 256  # width of each hidden layer
    layers: int = 2  # number of hidden layers


@final
class DqnLearner:
    """DQN of N agents with equal widths; each has a network of its own in one stacked batch."""

    def __init__(
        self,
        agents: int,
        observed: int,
        acted: int,
        *,
        seed: int = 0,
        settings: DqnSettings | None = None,
        name: str = "idqn",
    ) -> None:
        self.name = name
        self.agents, self.observed, self.acted = agents, observed, acted
        self.given = s = settings or DqnSettings()
        self.grid = action_grid(acted)
        generator = torch.Generator().manual_seed(seed)
        widths = [observed, *[s.hidden] * s.layers, len(self.grid)]
        self.network = StackedMLP(agents, widths, generator)
        self.target = StackedMLP(agents, widths, generator)
        self.target.load_state_dict(self.network.state_dict())
        self.target.requires_grad_(False)
        self._optimizer = torch.optim.Adam(self.network.parameters(), lr=s.lr)
        self._replay = Replay(s.buffer, agents, observed, 1)  # an action is a row of `grid`
        self._random = np.random.Generator(np.random.Philox(key=seed % 2**64))
        self._steps, self._due, self._updates = 0, 0.0, 0
        self._chosen: NDArray[np.int64] | None = None

    @property
    def settings(self) -> Mapping[str, float]:
        """All settings by name."""
        return asdict(self.given)

    @property
    def epsilon(self) -> float:
        """The share of random actions now."""
        s = self.given
        done = min(self._steps / max(s.epsilon_steps, 1), 1.0)
        return s.epsilon + done * (s.epsilon_end - s.epsilon)

    @torch.no_grad()
    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return the actions of greatest value; with `explore`, some are random (epsilon)."""
        o = torch.as_tensor(observation, dtype=torch.float32).transpose(0, 1)
        chosen = np.asarray(self.network(o).argmax(-1).T.numpy())
        if explore:
            any_ = self._random.integers(0, len(self.grid), chosen.shape)
            chosen = np.where(self._random.random(chosen.shape) < self.epsilon, any_, chosen)
            self._chosen = chosen
        return np.asarray(self.grid[chosen])

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Store the transitions, and make the updates that are due."""
        if self._chosen is None:
            raise InputInvalid("idqn", "nothing was chosen", "act() before learn()")
        number = self._chosen[:, :, None].astype(np.float32)
        self._replay.add(replace(transitions, action=number))
        self._steps += len(over)
        if self._steps < max(self.given.warm_up, self.given.batch):
            return {}
        self._due += self.given.updates
        losses: dict[str, float] = {}
        while self._due >= 1.0:
            losses = self._descend(self._replay.draw(self.given.batch, self._random))
            self._due -= 1.0
            self._updates += 1
        if not losses:
            return {}
        return {**losses, "updates": float(self._updates), "epsilon": self.epsilon}

    def _descend(self, drawn: Transitions) -> dict[str, float]:
        o, a, after = (
            torch.from_numpy(x).transpose(0, 1)
            for x in (drawn.observation, drawn.action, drawn.after)
        )
        r, ended = (torch.from_numpy(x).T for x in (drawn.reward, drawn.terminated))
        with torch.no_grad():
            y = r + self.given.gamma * (1.0 - ended) * self.target(after).amax(-1)
        q = self.network(o).gather(-1, a.long()).squeeze(-1)
        loss = smooth_l1_loss(q, y, reduction="none").mean(1).sum()
        value = descend(self.name, "q_loss", self._optimizer, loss, agents=self.agents, network="Q")
        with torch.no_grad():
            for slow, fast in zip(self.target.parameters(), self.network.parameters(), strict=True):
                slow.lerp_(fast, self.given.tau)
        return {"q_loss": value, "q": float(q.detach().mean())}

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return an agent's network, and the grid of actions; the greatest value selects a row."""
        return "grid", {**self.network.tensors(agent), "grid": self.grid}

    def go_on_from(self, last: Self, seed: int) -> None:
        """Copy the networks of `last`; raises InputInvalid for other shapes."""
        awake = last._replay.awake()
        nets = [i % last.agents for i in range(self.agents)]
        for of, to in ((last.network, self.network), (last.target, self.target)):
            pass_on(of, to, nets, [[(0, 0)]] * self.agents, awake)

    def state(self) -> State:
        """Return networks, optimiser, buffer, counters and random number generator."""
        return {
            "network": self.network.state_dict(),
            "target": self.target.state_dict(),
            "adam": self._optimizer.state_dict(),
            "replay": self._replay.state(),
            "random": philox_state(self._random),
            "counters": (self._steps, self._due, self._updates),
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        try:
            self.network.load_state_dict(state["network"])
            self.target.load_state_dict(state["target"])
            self._optimizer.load_state_dict(state["adam"])
            self._replay.set_state(state["replay"])
            self._steps, self._due, self._updates = state["counters"]
            set_philox_state(self._random, state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise unfit(error) from error


def action_grid(width: int) -> NDArray[np.float32]:
    """Return the actions to choose from, of shape (k, width), in [-1, 1].

    For two numbers, such as (a, omega) of target tracking, they are a grid of 3 x 5; for one
    number, 5 levels. For more numbers, an action is zero or has one number at -1 or 1 and the
    others at zero, which gives 2 width + 1 actions.
    """
    levels = np.linspace(-1.0, 1.0, 5)
    if width == 1:
        return levels[:, None].astype(np.float32)
    if width == 2:
        rows = list(itertools.product((-1.0, 0.0, 1.0), levels))
        return np.array(rows, np.float32)
    alone = np.eye(width)
    return np.concatenate([np.zeros((1, width)), alone, -alone]).astype(np.float32)
