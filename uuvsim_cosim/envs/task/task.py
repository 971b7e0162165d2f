"""Tasks of one agent and of a team: actions, observations, rewards and ends, without a solver.

A task is written once, for one environment or ten thousand: n is the number of environments, and
every array that a method receives or returns has n rows.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.envs.task.checks import seconds
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols, results_of
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View
    from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "Channel", "Moment", "Randomised", "Symmetry", "Task", "TeamTask", "mismatches_warned",
]  # fmt: skip

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
T = TypeVar("T")
_WARNED: ContextVar[bool] = ContextVar("_WARNED", default=False)


@contextmanager
def mismatches_warned(warned: bool = True) -> Iterator[None]:
    """Make tasks whose systems may have parts of another vehicle (`System.with_mismatches`)."""
    token = _WARNED.set(warned)
    try:
        yield
    finally:
        _WARNED.reset(token)


@dataclass(frozen=True)
class Channel:
    """Connector in an action or an observation, with its limits and its unit.

    `name` is the path of a variable ("hull.eta"), of one element, counted from 1 ("hull.eta[6]"),
    or of a slice ("hull.eta[1:3]"). The limits `low` and `high` are scaled to -1 and 1. Each is one
    number for all elements or one number for each element, in `unit`. By default, limits and unit
    are those of the variable. An action needs limits; an observation without limits is not scaled.
    With `sin_cos`, an angle is observed as two numbers, sine and cosine, which do not jump at pi.
    An environment raises InputInvalid for a channel that does not fit its system, for example if
    its unit cannot be converted.

    Example:

    >>> from uuvsim_cosim.envs import Channel
    >>> surge = Channel("allocation.tau_d[1]", -40, 40, "N")  # an action: -1 is -40 N
    >>> heading = Channel("hull.eta[6]", sin_cos=True)  # an observation of two numbers
    >>> heading.unit is None  # the variable's own unit, rad
    True
    """

    name: str
    low: float | Sequence[float] | None = None
    high: float | Sequence[float] | None = None
    unit: str | None = None
    sin_cos: bool = False


@dataclass(frozen=True, init=False, eq=False)
class Symmetry:
    """Transformation that leaves the transitions and the rewards of a task unchanged.

    `observation` and `action` hold the sign, 1 or -1, by which each number of an agent's
    observation and action is multiplied. Their shapes are (width of the observation,) and (width of
    the action,). `name` is for messages. Raises InputInvalid for other numbers. In the example, a
    boat observes a target ahead and to starboard, and acts by thrust and rudder.

    Example:

    >>> from uuvsim_cosim.envs import Symmetry
    >>> mirror = Symmetry("mirror", observation=[1, -1], action=[1, -1])
    >>> mirror.action * [0.8, 0.2]  # thrust stays, the rudder changes its side
    array([ 0.8, -0.2])
    >>> mirror.check(observed=2, acted=2)
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
        """Raise InputInvalid unless `observed` and `acted` are the widths of the two rows."""
        of = {"observation": (self.observation, observed), "action": (self.action, acted)}
        for what, (signs, width) in of.items():
            if len(signs) != width:
                raise InputInvalid(f"symmetry {self.name!r}, {what}", f"{len(signs)} signs", width)


class Moment(Protocol):
    """Signals of n environments at the end of an action, or after a reset.

    The methods of a task receive a moment. `m["hull.eta"]` reads a signal. InputInvalid is raised
    for a name that is neither an observed channel nor one of the task's `signals`. The arrays must
    not be changed.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import Channel, CosimEnv
    >>> def reward(m):  # how far north the vehicle has moved in this action [m]
    ...     print("environments:", m.n, "time [s]:", m.time, "actions:", m.step)
    ...     print("action:", m.action["agent"], "drawn:", list(m.start))
    ...     return m["hull.eta"][:, 0] - m.before["hull.eta"][:, 0]
    >>> surge, north = Channel("allocation.tau_d[1]", -40, 40, "N"), Channel("hull.eta[1]")
    >>> env = CosimEnv.of("bluerov2_task", actions=[surge], observations=[north], reward=reward,
    ...                   action_step="0.1", horizon=20)
    >>> _ = env.reset(seed=0)
    >>> _, moved, *_ = env.step(np.array([0.5]))
    environments: 1 time [s]: [0.1] actions: [1]
    action: [[0.5]] drawn: []
    """

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
    """Source of the start values of episodes; `Randomisation` is one, and so is your own class.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import Draws
    >>> class Depth:  # an episode starts 2 m or 8 m below the surface
    ...     names = ("hull.eta_0",)
    ...     def draw(self, draws):
    ...         pose = np.zeros((draws.n, 6))  # N E D [m], phi theta psi [rad]
    ...         pose[:, 2] = np.where(draws.uniform("depth") < 0.5, 2.0, 8.0)
    ...         return {"hull.eta_0": pose}
    >>> depth = Depth()
    >>> depth.draw(Draws(seeds=[1, 1, 1], episodes=[0, 1, 2]))[depth.names[0]][:, 2]
    array([8., 2., 2.])
    """

    @property
    def names(self) -> tuple[str, ...]:
        """The variables that are drawn, "hull.m"."""

    def draw(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values by variable, of shape (n, *shape), of the episodes of `draws`."""


class _Common:
    """The common part of a task of one agent and a task of several."""

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
        system = system.with_mismatches("warn") if _WARNED.get() else system
        self.system = system
        self.action_step = seconds(action_step, "action_step")
        self.horizon = seconds(horizon, "horizon")
        self.signals = _several(signals, "signals", "names")
        # A Randomisation may be declared without a system; here it gets one, and is checked.
        bound = getattr(randomisation, "bound", None)
        self.randomisation: Randomised | None = randomisation if bound is None else bound(system)

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return the start values of the episodes of `draws`, by variable, of shape (n, *shape).

        By default, they are those of the randomisation.

        Example:

        >>> from uuvsim_cosim.envs import Draws
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> start = StationKeeping(current=(0.0, 0.3)).start(Draws(seeds=[7, 8], episodes=[0, 0]))
        >>> start["current.speed"].shape, start["hull.eta_0"].shape  # m/s; m and rad
        ((2,), (2, 6))
        """
        return {} if self.randomisation is None else self.randomisation.draw(draws)

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return results as CasADi expressions of the symbols `m`, or None: the task has none.

        The keys are names of methods: "reward", "terminated", "extra" (a column), "info"
        (expressions by name), and for a team "observe", "reward" and "terminated" by agent. An
        environment compiles them and evaluates all of them in one call, for all environments, in
        place of the methods. They are in the units of the variables. A subclass that overrides one
        of the methods in NumPy is not affected: its method is called.

        Example:

        >>> import casadi as ca
        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Shallow(StationKeeping):  # another reward: minus the depth [m]
        ...     def expressions(self, m):
        ...         return {**super().expressions(m), "reward": -m["hull.eta"][2]}
        >>> env = CosimEnv(Shallow())
        >>> _ = env.reset(seed=0)
        >>> _, reward, *_ = env.step([0.0] * 6)
        >>> -11.5 < reward < -8.5
        True
        """
        return None

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return other results by name, of shape (n, …): metrics, the terms of a reward.

        An environment puts them into the `info` of `reset` and `step`.

        Example:

        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Logged(StationKeeping):
        ...     def info(self, m):
        ...         return {**super().info(m), "depth": m["hull.eta"][:, 2]}  # m
        >>> _, info = CosimEnv(Logged()).reset(seed=0)
        >>> sorted(info)
        ['depth', 'heading_error', 'position_error']
        """
        return results_of(self, m, "info") or {}

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Return the symmetries of transitions and rewards, which learners may use.

        Example:

        >>> from uuvsim_cosim.learn import make_task
        >>> [symmetry.name for symmetry in make_task("source").symmetries()]
        ['mirror', 'half turn', 'mirror and half turn']
        """
        return ()

    def view(self, m: Moment, row: int) -> View | None:
        """Return the picture of the environment in `row`, from 0; None draws every hull.

        Example:

        >>> from dataclasses import replace
        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Titled(StationKeeping):
        ...     def view(self, m, row):
        ...         return replace(super().view(m, row), title="station keeping")
        >>> env = CosimEnv(Titled(), render_mode="rgb_array")
        >>> _ = env.reset(seed=0)
        >>> env.render().shape  # pixels: height, width, colours
        (480, 640, 3)
        """
        return None


class Task(_Common, ABC):
    """Task of one agent: derive from it, and override at least `reward` or `expressions`.

    `system` has unconnected inputs, which `actions` set; `observations` are what the agent
    observes. An action lasts `action_step` seconds, a whole number of the system's communication
    steps. An episode is truncated after `horizon` seconds. `signals` are the names that the methods
    read in a moment, besides the observed channels. `randomisation` draws the start values of each
    episode. The attribute `failure_reward`, by default 0, is the reward of a step in which a
    component fails. Methods receive a moment `m`, and every array that a method receives or returns
    has n rows, one for each environment. Raises InputInvalid for arguments of wrong types; an
    environment raises it for a task that does not fit its system.

    Example:

    >>> import numpy as np
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.envs import Channel, CosimEnv, Task
    >>> class Dive(Task):  # reach a depth of 12 m
    ...     def reward(self, m):
    ...         return -np.abs(m["hull.eta"][:, 2] - 12.0)
    >>> heave, depth = Channel("allocation.tau_d[3]", -100, 100, "N"), Channel("hull.eta[3]", 0, 20)
    >>> task = Dive(uuv.load("bluerov2_task"), actions=[heave], observations=[depth],
    ...             action_step="0.1", horizon=20)
    >>> env = CosimEnv(task)
    >>> env.reset(seed=0)  # the start depth, 10 m of 0 to 20 m, is observed as 0
    (array([0.], dtype=float32), {})
    """

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
        if type(self).reward is Task.reward and type(self).expressions is Task.expressions:
            name = type(self).__name__
            raise TypeError(f"can't instantiate {name} without a method reward or expressions")
        self.actions = _channels(actions, "actions")
        self.observations = _channels(observations, "observations")

    def reward(self, m: Moment) -> Array:
        """Return the reward of the action that led to this moment, of shape (n,).

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Frugal(StationKeeping):  # subtract a cost of the six forces and moments
        ...     def reward(self, m):
        ...         return super().reward(m) - 0.1 * np.abs(m.action["agent"]).sum(axis=1)
        >>> env = CosimEnv(Frugal())
        >>> _ = env.reset(seed=0)
        >>> _, reward, *_ = env.step(np.ones(6))
        >>> reward < -0.5
        True
        """
        reward: Array = results_of(self, m, "reward")
        return reward

    def extra(self, m: Moment) -> Array | None:
        """Return observations that no channel provides, of shape (n, k), or None.

        They follow the channels in the observation. `extra_limits` states their limits.

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Timed(StationKeeping):  # the agent also observes the time [s]
        ...     def extra(self, m):
        ...         return np.column_stack([super().extra(m), m.time])
        ...     @property
        ...     def extra_limits(self):
        ...         low, high = super().extra_limits
        ...         return [*low, 0.0], [*high, 20.0]
        >>> CosimEnv(StationKeeping()).observation_space.shape
        (20,)
        >>> CosimEnv(Timed()).observation_space.shape
        (21,)
        """
        extra: Array | None = results_of(self, m, "extra")
        return extra

    def unclipped(self, m: Moment) -> Array | None:
        """Return `extra` without clipping, of shape (n, k), for a task whose `extra` clips.

        The conversion of recorded runs counts with it the observations beyond their limits.

        Example:

        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Printed(StationKeeping):
        ...     def unclipped(self, m):
        ...         print("position error [m]:", super().unclipped(m)[0, :3].round(2))
        ...         return super().unclipped(m)
        >>> observation, _ = CosimEnv(Printed(region=0.1)).reset(seed=0)
        position error [m]: [ 0.19 -0.4  -0.36]
        >>> observation[:3].round(2)  # `extra` clips at twice the region
        array([ 0.19, -0.2 , -0.2 ], dtype=float32)
        """
        return self.extra(m)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The lower and upper limits of each number of `extra`, two sequences of k numbers.

        Example:

        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> low, high = StationKeeping(region=5).extra_limits
        >>> len(low), high[0]  # the error of position [m], at most twice the region
        (20, 10.0)
        """
        return (), ()

    def terminated(self, m: Moment) -> Mask:
        """Return which episodes have terminated (goal reached, collision), of shape (n,).

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import CosimEnv
        >>> from uuvsim_cosim.envs.tasks import StationKeeping
        >>> class Upright(StationKeeping):  # the episode also ends if the vehicle rolls over
        ...     def terminated(self, m):
        ...         return super().terminated(m) | (np.abs(m["hull.eta"][:, 3]) > np.pi / 2)
        >>> env = CosimEnv(Upright())
        >>> _ = env.reset(seed=0)
        >>> _, _, terminated, truncated, _ = env.step(np.zeros(6))
        >>> terminated, truncated
        (False, False)
        """
        ended: Mask | None = results_of(self, m, "terminated")
        return np.zeros(m.n, bool) if ended is None else ended


class TeamTask(_Common, ABC):
    """Task of several agents, which act at the same time; an agent may appear and leave.

    `agents` are the names of all agents that can be present, and `actions` the channels of each.
    Methods receive a moment `m` of n environments, and return mappings by agent, with n rows for
    each agent, also for an absent one. If the attribute `team_reward` is true, each agent is given
    the reward of the whole team, not a part of it. The other arguments are those of `Task`:
    `system`, `action_step`, `horizon`, `signals`, `randomisation`. In a step in which a component
    fails, each agent that acted gets the `failure_reward`. Raises InputInvalid for agents that are
    named twice or have no actions.

    Example:

    >>> import numpy as np
    >>> import uuvsim_cosim as uuv
    >>> from uuvsim_cosim.envs import Channel, CosimParallelEnv, TeamTask
    >>> two = uuv.System("two", tick="0.1")
    >>> for name in ("red", "blue"):
    ...     two = two.add(name, "model:bluerov2_heavy")
    >>> class Race(TeamTask):  # each vehicle is rewarded for its own surge speed [m/s]
    ...     def limits(self, agent):
    ...         return np.array([-5.0]), np.array([5.0])
    ...     def observe(self, m):
    ...         return {a: m[f"{a}.nu"][:, :1] for a in self.agents}
    ...     def reward(self, m):
    ...         return {a: m[f"{a}.nu"][:, 0] for a in self.agents}
    ...     def state(self, m):
    ...         return np.column_stack([m[f"{a}.nu"][:, 0] for a in self.agents])
    ...     def state_limits(self):
    ...         return np.full(2, -5.0), np.full(2, 5.0)
    >>> race = Race(two, agents=["red", "blue"], action_step="0.1", horizon=5,
    ...             actions={a: [Channel(f"{a}.tau[1]", -50, 50, "N")] for a in ("red", "blue")},
    ...             signals=["red.nu", "blue.nu"])
    >>> env = CosimParallelEnv(race)
    >>> _ = env.reset(seed=0)
    >>> _, rewards, *_ = env.step({"red": np.array([1.0]), "blue": np.array([0.5])})
    >>> rewards["red"] > rewards["blue"] > 0
    True
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
        """Return the lower and upper limits of an agent's observation, each of shape (width,).

        Example:

        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> low, high = TargetTracking(n_trackers=2).limits("tracker_1")
        >>> high[:2]  # own position N and E, in halves of the arena's size
        array([1.5, 1.5])
        """

    @abstractmethod
    def observe(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's observation, of shape (n, width).

        Example:

        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Blind(TargetTracking):  # the second tracker observes zeros
        ...     def observe(self, m):
        ...         seen = super().observe(m)
        ...         return {**seen, "tracker_2": 0.0 * seen["tracker_2"]}
        >>> observations, _ = CosimParallelEnv(Blind()).reset(seed=0)
        >>> observations["tracker_1"].any(), observations["tracker_2"].any()
        (np.True_, np.False_)
        """

    def unclipped(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's observation without clipping, for a task whose `observe` clips.

        The conversion of recorded runs counts with it the observations beyond their limits.

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Counted(TargetTracking):
        ...     def observe(self, m):
        ...         low, high = self.limits("tracker_1")
        ...         beyond = np.abs(self.unclipped(m)["tracker_1"]) > high
        ...         print("numbers beyond their limits:", beyond.sum())
        ...         return super().observe(m)
        >>> _ = CosimParallelEnv(Counted()).reset(seed=0)
        numbers beyond their limits: 0
        """
        return self.observe(m)

    @abstractmethod
    def reward(self, m: Moment) -> Mapping[str, Array]:
        """Return each agent's reward of the action that led to this moment, of shape (n,).

        Example:

        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Halved(TargetTracking):
        ...     def reward(self, m):
        ...         return {agent: 0.5 * r for agent, r in super().reward(m).items()}
        >>> env = CosimParallelEnv(Halved())
        >>> _ = env.reset(seed=0)
        >>> _, rewards, *_ = env.step({agent: [0.0, 0.0] for agent in env.agents})
        >>> round(rewards["tracker_1"], 3)
        0.044
        """

    def terminated(self, m: Moment) -> Mapping[str, Mask]:
        """Return which agents have terminated, of shape (n,) each.

        Example:

        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Deep(TargetTracking):  # a tracker also ends below 2 m
        ...     def terminated(self, m):
        ...         ended = super().terminated(m)
        ...         return {a: ended[a] | (m[f"{a}.hull.eta"][:, 2] > 2.0) for a in self.agents}
        >>> env = CosimParallelEnv(Deep())
        >>> _ = env.reset(seed=0)
        >>> _, _, terminated, *_ = env.step({agent: [0.0, 0.0] for agent in env.agents})
        >>> terminated
        {'tracker_1': False, 'tracker_2': False}
        """
        return {agent: np.zeros(m.n, bool) for agent in self.agents}

    def present(self, m: Moment) -> Mapping[str, Mask]:
        """Return which agents are present, of shape (n,) each; an absent one does not act.

        Example:

        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Late(TargetTracking):  # the second tracker comes after 0.4 s
        ...     def present(self, m):
        ...         return {**super().present(m), "tracker_2": m.time >= 0.4}
        >>> env = CosimParallelEnv(Late())
        >>> _ = env.reset(seed=0)
        >>> env.agents
        ['tracker_1']
        >>> _ = env.step({"tracker_1": [0.0, 0.0]})
        >>> env.agents
        ['tracker_1', 'tracker_2']
        """
        return {agent: np.ones(m.n, bool) for agent in self.agents}

    @abstractmethod
    def state(self, m: Moment) -> Array:
        """Return the state for a central critic, of shape (n, width).

        Example:

        >>> import numpy as np
        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> class Flat(TargetTracking):  # the critic observes no headings
        ...     def state(self, m):
        ...         state = super().state(m)
        ...         state[:, [2, 5]] = 0.0
        ...         return state
        >>> env = CosimParallelEnv(Flat(n_trackers=2))
        >>> _ = env.reset(seed=0)
        >>> env.state()[:6].round(1)  # N, E [m] and heading [rad] of each tracker
        array([ 0.9,  1.9,  0. , -0.3, -1. ,  0. ], dtype=float32)
        """

    @abstractmethod
    def state_limits(self) -> tuple[Array, Array]:
        """Return the lower and upper limits of each number of `state`, each of shape (width,).

        Example:

        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> low, high = TargetTracking(n_trackers=2).state_limits()
        >>> high[:3]  # of the first tracker: N and E [m], heading [rad]
        array([2.6       , 4.8       , 3.14159265])
        """


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
