"""What is to be done in a system: names of signals, not solvers; arrays with a batch axis.

A task is written once and serves one environment and ten thousand: n is the number of
environments, and every array that a method gets or gives has n rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.argument_checks import seconds
from uuvsim_cosim.envs.task.channel import Channel
from uuvsim_cosim.envs.task.draws import Draws
from uuvsim_cosim.envs.task.symmetry import Symmetry
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Moment", "Randomised", "Task", "TeamTask"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
T = TypeVar("T")


class Moment(Protocol):
    """What a task sees at the end of an action, or after a reset; nobody may change its arrays."""

    @property
    def n(self) -> int:
        """The number of environments."""

    @property
    def time(self) -> Array:
        """Seconds since the reset, of shape (n,)."""

    @property
    def step(self) -> NDArray[np.int64]:
        """Actions since the reset, of shape (n,)."""

    @property
    def action(self) -> Mapping[str, Array]:
        """The actions that led here, by agent, in [-1, 1], of shape (n, width); 0 after a reset."""

    @property
    def before(self) -> Moment:
        """The moment when the action began; after a reset this moment itself."""

    @property
    def start(self) -> Mapping[str, Array]:
        """The start values that the episodes drew, by variable, of shape (n, *shape)."""

    def __getitem__(self, name: str) -> Array:
        """Return a signal of the task, in the variable's own unit, of shape (n, *shape)."""


class Randomised(Protocol):
    """Where the start values of an episode come from."""

    @property
    def names(self) -> tuple[str, ...]:
        """The variables that are drawn, "hull.m"."""

    def draw(self, draws: Draws) -> Mapping[str, Array]:
        """Draw start values by variable, of shape (n, *shape)."""


class _Common:
    """What a task of one agent and a task of several have in common.

    `system` has free inputs that are acted on. An action lasts `action_step` seconds, a whole
    number of the system's communication steps. An episode is truncated after `horizon` seconds.
    `signals` names what the methods read of a moment, beside the channels observed.
    `failure_reward` is given, to each agent that acted, in the step in which a component fails.
    """

    failure_reward: float = 0.0

    def __init__(
        self,
        system: System,
        *,
        action_step: Fraction | str | float,
        horizon: Fraction | str | float,
        signals: Sequence[str] = (),
        randomisation: Randomised | None = None,
    ) -> None:
        self.system = system
        self.action_step = seconds(action_step, "action_step")
        self.horizon = seconds(horizon, "horizon")
        self.signals = _several(signals, "signals", "names")
        # A Randomisation may be declared without a system; here it gets one, and is checked.
        bound = getattr(randomisation, "bound", None)
        self.randomisation: Randomised | None = randomisation if bound is None else bound(system)

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw an episode's start values, by variable ("hull.eta_0"), of shape (n, *shape)."""
        return {} if self.randomisation is None else self.randomisation.draw(draws)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return what else is worth knowing, of shape (n, …): metrics, the terms of a reward."""
        return {}

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Return what leaves transitions and rewards as they are; learners may draw on it."""
        return ()

    def view(self, m: Moment, row: int) -> View | None:
        """Say what to draw of one environment; None draws every hull there is."""
        return None


class Task(_Common, ABC):
    """A task of one agent."""

    def __init__(
        self,
        system: System,
        *,
        actions: Sequence[Channel],
        observations: Sequence[Channel],
        action_step: Fraction | str | float,
        horizon: Fraction | str | float,
        signals: Sequence[str] = (),
        randomisation: Randomised | None = None,
    ) -> None:
        super().__init__(
            system,
            action_step=action_step,
            horizon=horizon,
            signals=signals,
            randomisation=randomisation,
        )
        self.actions = _channels(actions, "actions")
        self.observations = _channels(observations, "observations")

    @abstractmethod
    def reward(self, m: Moment) -> Array:
        """Return the reward of the action that led to this moment, of shape (n,)."""

    def extra(self, m: Moment) -> Array | None:
        """Return observations that no connector has, after the channels, of shape (n, k)."""
        return None

    def unclipped(self, m: Moment) -> Array | None:
        """Return `extra` as it is beyond its limits, where that clips by itself."""
        return self.extra(m)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The least and the greatest value of each number of `extra`."""
        return (), ()

    def terminated(self, m: Moment) -> Mask:
        """Say which episodes have ended by themselves: the goal, a collision; shape (n,)."""
        return np.zeros(m.n, bool)


class TeamTask(_Common, ABC):
    """A task of several agents, which act at the same time; an agent may come and go.

    `agents` names all that can ever be there. What a method gives by agent has n rows for each.
    `team_reward` says that each agent is given the reward of the team, not a part of it.
    """

    team_reward: bool = False

    def __init__(
        self,
        system: System,
        *,
        agents: Sequence[str],
        actions: Mapping[str, Sequence[Channel]],
        action_step: Fraction | str | float,
        horizon: Fraction | str | float,
        signals: Sequence[str] = (),
        randomisation: Randomised | None = None,
    ) -> None:
        super().__init__(
            system,
            action_step=action_step,
            horizon=horizon,
            signals=signals,
            randomisation=randomisation,
        )
        self.agents = _several(agents, "agents", "names")
        if not self.agents or len(set(self.agents)) < len(self.agents):
            raise InputInvalid(f"agents {self.agents}; expected at least one, each named once")
        if set(actions) != set(self.agents):
            expected = f"actions for each of the agents {', '.join(self.agents)}, and no others"
            raise InputInvalid(f"actions for {', '.join(actions) or 'nobody'}; expected {expected}")
        self.actions = {a: _channels(actions[a], f"actions of {a!r}") for a in self.agents}

    @abstractmethod
    def limits(self, agent: str) -> tuple[Array, Array]:
        """Return the least and the greatest value of an agent's observation."""

    @abstractmethod
    def observe(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's observation, of shape (n, width)."""

    def unclipped(self, m: Moment) -> Mapping[str, Array]:
        """Return observations as they are beyond their limits, where `observe` clips by itself."""
        return self.observe(m)

    @abstractmethod
    def reward(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's reward, of shape (n,)."""

    def terminated(self, m: Moment) -> Mapping[str, Mask]:
        """Say which agents' episodes have ended by themselves, of shape (n,)."""
        return {agent: np.zeros(m.n, bool) for agent in self.agents}

    def present(self, m: Moment) -> Mapping[str, Mask]:
        """Say which agents are there, of shape (n,); one that is not is neither seen nor heard."""
        return {agent: np.ones(m.n, bool) for agent in self.agents}

    @abstractmethod
    def state(self, m: Moment) -> Array:
        """Return the whole as a central critic sees it, of shape (n, width)."""

    @abstractmethod
    def state_limits(self) -> tuple[Array, Array]:
        """Return the least and the greatest value of each number of `state`."""


def _several(given: Iterable[T], name: str, of: str) -> tuple[T, ...]:
    """Return a list's elements; a text is none."""
    if isinstance(given, str | Channel) or not isinstance(given, Iterable):
        wanted = f"a list of {of}" + (f", [{given!r}]" if isinstance(given, str | Channel) else "")
        raise InputInvalid(f"{name} {given!r}; expected {wanted}")
    return tuple(given)


def _channels(given: Iterable[Channel], name: str) -> tuple[Channel, ...]:
    channels = _several(given, name, "channels")
    for channel in channels:
        if not isinstance(channel, Channel):
            near = f", such as Channel({channel!r})" if isinstance(channel, str) else ""
            raise InputInvalid(f"{name}: {channel!r}; expected a Channel{near}")
    return channels
