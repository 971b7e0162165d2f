"""Tasks of one agent and of a team: actions, observations, rewards and ends, without a solver.

A task is written once, for one environment or ten thousand: n is the number of environments, and
every array that a method receives or returns has n rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.envs.task.checks import seconds
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["Channel", "Moment", "Randomised", "Symmetry", "Task", "TeamTask"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
T = TypeVar("T")


@dataclass(frozen=True)
class Channel:
    """A connector in an action or an observation: ``Channel("allocation.tau_d[1]", -40, 40, "N")``.

    `name` is the path of a connector, one element (from 1) or a slice ("hull.eta[1:3]"). `low` and
    `high`, one number for all elements or one for each, in `unit`, are scaled to -1 and 1; the
    default are the limits of the variable. An observation without limits is not scaled. `unit` is
    by default that of the variable, and must be convertible to it. With `sin_cos`, an angle is
    observed as sine and cosine, without a jump at pi.
    """

    name: str
    low: float | Sequence[float] | None = None
    high: float | Sequence[float] | None = None
    unit: str | None = None
    sin_cos: bool = False


@dataclass(frozen=True, init=False, eq=False)
class Symmetry:
    """Factors, each 1 or -1, of an observation (width,) and of an action (width,).

    Raises InputInvalid for other numbers.
    """

    name: str
    observation: Array = field(repr=False)
    action: Array = field(repr=False)

    def __init__(self, name: str, observation: ArrayLike, action: ArrayLike) -> None:
        for what, given in (("observation", observation), ("action", action)):
            try:
                signs = np.array(given, np.float64)
                wrong = signs.ndim != 1 or not np.isin(signs, (1.0, -1.0)).all()
            except (TypeError, ValueError):
                wrong = True
            if wrong:
                raise InputInvalid(
                    f"symmetry {name!r}, {what}", f"{given!r}", "a row of signs, each 1 or -1"
                )
            object.__setattr__(self, what, signs)
        object.__setattr__(self, "name", name)

    def check(self, observed: int, acted: int) -> None:
        """Raise InputInvalid unless it is of observations and actions of these widths."""
        of = {"observation": (self.observation, observed), "action": (self.action, acted)}
        for what, (signs, width) in of.items():
            if len(signs) != width:
                raise InputInvalid(f"symmetry {self.name!r}, {what}", f"{len(signs)} signs", width)


class Moment(Protocol):
    """The signals at the end of an action, or after a reset; its arrays must not be changed."""

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
    """A source of the start values of episodes."""

    @property
    def names(self) -> tuple[str, ...]:
        """The variables that are drawn, "hull.m"."""

    def draw(self, draws: Draws) -> Mapping[str, Array]:
        """Draw start values by variable, of shape (n, *shape)."""


class _Common:
    """The common part of a task of one agent and a task of several.

    `system` has unconnected inputs, which the actions set. An action lasts `action_step` seconds, a
    whole number of the system's communication steps. An episode is truncated after `horizon`
    seconds. `signals` are the names that the methods read of a moment, besides the observed
    channels. Each agent that acted gets `failure_reward` in the step in which a component fails.
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
        """Return other results, of shape (n, …): metrics, the terms of a reward."""
        return {}

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Return the symmetries of transitions and rewards, which learners may use."""
        return ()

    def view(self, m: Moment, row: int) -> View | None:
        """Return the picture of one environment; None draws every hull."""
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
        """Return observations besides the channels, which they follow, of shape (n, k)."""
        return None

    def unclipped(self, m: Moment) -> Array | None:
        """Return `extra` without clipping, for a task whose `extra` clips."""
        return self.extra(m)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The lower and upper limits of each number of `extra`."""
        return (), ()

    def terminated(self, m: Moment) -> Mask:
        """Return which episodes have terminated (goal reached, collision), of shape (n,)."""
        return np.zeros(m.n, bool)


class TeamTask(_Common, ABC):
    """A task of several agents, which act at the same time; an agent may appear and leave.

    `agents` are the names of all agents that can be present. A mapping by agent has n rows for
    each. With `team_reward`, each agent is given the reward of the whole team, not a part of it.
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
            raise InputInvalid(f"agents {self.agents}", "at least one, each named once")
        if set(actions) != set(self.agents):
            expected = f"actions for each of the agents {', '.join(self.agents)}, and no others"
            raise InputInvalid(f"actions for {', '.join(actions) or 'no agent'}", expected)
        self.actions = {a: _channels(actions[a], f"actions of {a!r}") for a in self.agents}

    @abstractmethod
    def limits(self, agent: str) -> tuple[Array, Array]:
        """Return the lower and upper limits of an agent's observation."""

    @abstractmethod
    def observe(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's observation, of shape (n, width)."""

    def unclipped(self, m: Moment) -> Mapping[str, Array]:
        """Return the observations without clipping, for a task whose `observe` clips."""
        return self.observe(m)

    @abstractmethod
    def reward(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's reward, of shape (n,)."""

    def terminated(self, m: Moment) -> Mapping[str, Mask]:
        """Return which agents have terminated, of shape (n,) each."""
        return {agent: np.zeros(m.n, bool) for agent in self.agents}

    def present(self, m: Moment) -> Mapping[str, Mask]:
        """Return which agents are present, of shape (n,) each; an absent one does not act."""
        return {agent: np.ones(m.n, bool) for agent in self.agents}

    @abstractmethod
    def state(self, m: Moment) -> Array:
        """Return the state for a central critic, of shape (n, width)."""

    @abstractmethod
    def state_limits(self) -> tuple[Array, Array]:
        """Return the lower and upper limits of each number of `state`."""


def _several(given: Iterable[T], name: str, of: str) -> tuple[T, ...]:
    """Return the elements of a list; raises InputInvalid for a text, which is not one."""
    if isinstance(given, str | Channel) or not isinstance(given, Iterable):
        wanted = f"a list of {of}" + (f", [{given!r}]" if isinstance(given, str | Channel) else "")
        raise InputInvalid(f"{name} {given!r}", wanted)
    return tuple(given)


def _channels(given: Iterable[Channel], name: str) -> tuple[Channel, ...]:
    channels = _several(given, name, "channels")
    for channel in channels:
        if not isinstance(channel, Channel):
            near = f", such as Channel({channel!r})" if isinstance(channel, str) else ""
            raise InputInvalid(name, f"{channel!r}", f"a Channel{near}")
    return channels
