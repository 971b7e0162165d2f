"""MASAC and SAC as a `Learner`: warm-up, replay buffer, updates for each environment step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Self, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Symmetry
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.algorithms.checkpoint import State, philox_state, set_philox_state, unfit
from uuvsim_cosim.learn.algorithms.masac import Masac, MasacSettings
from uuvsim_cosim.learn.algorithms.replay_buffer import NStep, Replay, Transitions
from uuvsim_cosim.learn.algorithms.transfer import transfer

__all__ = ["MasacLearner", "OffPolicySettings"]

Array = NDArray[np.float32]


@dataclass(frozen=True)
class OffPolicySettings:
    """Settings of the replay buffer and of the updates."""

    batch: int = 256  # transitions in one update
    buffer: int = 100_000  # transitions that the replay buffer holds
    warm_up: int = 500  # environment steps with random actions and without updates
    critic_only: int = 0  # first updates after a transfer, which change the critics only
    updates: float = 1.0  # gradient updates each time that all environments have made one step
    actor_every: int = 1  # updates of the critics for each update of actors and temperatures
    n_step: int = 1  # number of rewards that a transition sums
    mirror: bool = False  # transitions are also sampled as mirror images (the task's symmetries)


@final
class MasacLearner:
    """SAC or MASAC of N agents with equal widths; each has an actor and two critics."""

    def __init__(
        self,
        agents: int,
        observed: int,
        acted: int,
        *,
        seed: int = 0,
        network: MasacSettings | None = None,
        schedule: OffPolicySettings | None = None,
        symmetries: Sequence[Symmetry] = (),
    ) -> None:
        self.schedule, self.symmetries = schedule or OffPolicySettings(), tuple(symmetries)
        if self.schedule.mirror and not self.symmetries:
            raise InputInvalid("mirror", "the task has no symmetry", "mirror=false")
        for symmetry in self.symmetries:
            symmetry.check(observed, acted)
        self.masac = m = Masac(agents, observed, acted, network or MasacSettings(), seed)
        self._replay = Replay(self.schedule.buffer, m.agents, m.observed, m.acted)
        self._random = np.random.Generator(np.random.Philox(key=seed % 2**64))
        self._several = NStep(self.schedule.n_step, m.settings.gamma)
        self._steps, self._due, self._updates = 0, 0.0, 0

    @property
    def name(self) -> str:
        """The name: "sac" for one agent, "masac" with central critics, else "isac"."""
        if self.masac.agents == 1:
            return "sac"
        return "masac" if self.masac.settings.central else "isac"

    @property
    def settings(self) -> Mapping[str, float]:
        """All settings by name."""
        return {**asdict(self.masac.settings), **asdict(self.schedule)}

    def act(self, observation: Array, explore: bool = True) -> Array:
        """Return actions (n, N, a); with `explore`, they are random during the warm-up."""
        if explore and self._steps < self.schedule.warm_up:
            shape = (*observation.shape[:2], self.masac.acted)
            return self._random.uniform(-1.0, 1.0, shape).astype(np.float32)
        return self.masac.act(observation, explore)

    def learn(self, transitions: Transitions, over: NDArray[np.bool_]) -> Mapping[str, float]:
        """Store the transitions, and make the updates that are due."""
        summed = self._several(transitions, over)
        if summed is not None:
            self._replay.add(summed)
        self._steps += len(transitions.reward)
        if summed is None or self._steps < max(self.schedule.warm_up, self.schedule.batch):
            return {}
        self._due += self.schedule.updates
        losses: Mapping[str, float] = {}
        while self._due >= 1.0:
            drawn = self._replay.draw(
                self.schedule.batch, self._random, self.symmetries if self.schedule.mirror else ()
            )
            skipped = self._updates % self.schedule.actor_every > 0
            early = self._updates < self.schedule.critic_only
            losses = {**losses, **self.masac.update(drawn, critic_only=early or skipped)}
            self._due -= 1.0
            self._updates += 1
        return {**losses, "updates": float(self._updates)} if losses else {}

    def tensors(self, agent: int) -> tuple[str, Mapping[str, Array]]:
        """Return the kind "tanh" and the tensors of an agent's mean action."""
        return "tanh", self.masac.tensors(agent)

    def go_on_from(self, last: Self, seed: int) -> None:
        """Continue with the networks of `last`, see `transfer`; raises InputInvalid."""
        m = self.masac
        awake = last._replay.awake()
        self.masac = transfer(last.masac, m.agents, awake, seed=seed, settings=m.settings)

    def state(self) -> State:
        """Return networks, optimisers, buffer, counters and random number generators."""
        return {
            "masac": self.masac.state(),
            "replay": self._replay.state(),
            "several": self._several.state(),
            "random": philox_state(self._random),
            "counters": (self._steps, self._due, self._updates),
        }

    def set_state(self, state: State) -> None:
        """Restore a state; raises InputInvalid for another shape."""
        try:
            self.masac.set_state(state["masac"])
            self._replay.set_state(state["replay"])
            self._several.set_state(state["several"])
            self._steps, self._due, self._updates = state["counters"]
            set_philox_state(self._random, state["random"])
        except (KeyError, RuntimeError, ValueError, TypeError) as error:
            raise unfit(error) from error
