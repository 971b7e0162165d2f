"""The environment under examination: how a new one is made, acted on and compared with another."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, Literal, NamedTuple, Protocol

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

__all__ = [
    "Actions", "Environment", "Kind", "NotApplicable", "Subject", "Transition", "Violation",
    "difference", "same", "seconds",
]  # fmt: skip

Kind = Literal["single", "vector", "parallel"]
Step = tuple[Any, Any, Any, Any, Any]  # observation, reward, terminated, truncated, info


class Violation(Exception):
    """A claim that does not hold; the message has what was seen and what was expected."""


class NotApplicable(Exception):
    """A claim that cannot be checked for this environment; the message has the reason."""


class Environment(Protocol):
    """An environment as the claims use it: the members of the three interfaces together.

    An environment of one kind has only its own: claims ask for the kind before they use others.
    """

    metadata: dict[str, Any]
    agents: list[str]  # of a parallel one, as `possible_agents`
    possible_agents: list[str]
    num_envs: int  # of a vector
    observation_space: Any  # a space, of a parallel one a function of the agent
    action_space: Any
    unwrapped: Any

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Any]:
        """Begin an episode; returns an observation and infos."""

    def step(self, action: Any, /) -> Step:
        """Act for one step."""

    def close(self) -> None:
        """Free everything."""


Make = Callable[[], Any]  # of an Environment: gymnasium's and pettingzoo's types differ from it


class Transition(NamedTuple):
    """The results of a step, or of a reset (then the reward is None)."""

    observation: object
    reward: object
    terminated: object
    truncated: object
    info: object


@dataclass(frozen=True)
class Subject:
    """An environment under examination, and the data that the claims need."""

    kind: Kind
    make: Make
    steps: int
    seed: int
    bare: Make | None = None  # without wrappers, for gymnasium's own checker
    single: Make | None = None  # of which a vector is n
    failing: Make | None = None  # one in which a component fails
    row_seeds: bool = True  # row i of a vector has seed s + i
    start: dict[str, object] | None = None  # options of a reset that fix how an episode starts
    limit: int | None = None  # steps of an episode
    action_step: Fraction | None = None  # s
    time: Callable[[Any], float] | None = None
    strict: bool = False  # recommendations are failures

    @contextmanager
    def opened(self, make: Make | None = None) -> Iterator[Any]:
        """Make an `Environment`, and close it."""
        env = (make or self.make)()
        try:
            yield env
        finally:
            env.close()

    def walk(
        self,
        env: Environment,
        seed: int | None,
        steps: int | None = None,
        options: dict[str, object] | None = None,
    ) -> Iterator[Transition]:
        """Reset and act at random; the next episode begins without a seed. Yields copies."""
        actions = Actions(self.kind, env, self.seed)
        # Without options the argument is absent: an environment need not know it.
        observation, info = env.reset(
            seed=seed, **({} if options is None else {"options": options})
        )
        yield _kept(observation, None, None, None, info)
        for _ in range(steps or self.steps):
            step = env.step(actions.sample(env, observation))
            observation = step[0]
            yield _kept(*step)
            if self.over(env, step):
                over = {"reset_mask": step[2] | step[3]} if self.kind == "vector" else None
                observation, info = env.reset() if over is None else env.reset(options=over)
                yield _kept(observation, None, None, None, info)

    def path(
        self, env: Environment, seed: int | None, steps: int | None = None
    ) -> list[Transition]:
        """Return a whole walk."""
        return list(self.walk(env, seed, steps))

    def alone(self, seed: int | None, steps: int | None = None) -> list[Transition]:
        """Return the walk of a new environment."""
        with self.opened() as env:
            return self.path(env, seed, steps)

    def over(self, env: Environment, step: Step) -> bool:
        """Return whether a reset must follow."""
        if self.kind == "parallel":
            return not env.agents
        if self.kind == "single":
            return bool(step[2] or step[3])
        disabled = env.metadata.get("autoreset_mode") == AutoresetMode.DISABLED
        return disabled and bool(np.any(step[2] | step[3]))


class Actions:
    """Random actions of a seed, from copies of the spaces, whose own generators stay unchanged."""

    def __init__(self, kind: Kind, env: Environment, seed: int) -> None:
        self.kind = kind
        if kind == "parallel":
            self.spaces = {a: copy.deepcopy(env.action_space(a)) for a in env.possible_agents}
        else:
            self.spaces = {"": copy.deepcopy(env.action_space)}
        for i, space in enumerate(self.spaces.values()):
            space.seed(seed + i)

    def sample(self, env: Environment, observation: Any) -> Any:
        """Return the next action; by agent, with the mask of legal actions that it observes."""
        if self.kind != "parallel":
            return self.spaces[""].sample()
        chosen = {}
        for agent in env.agents:
            seen = observation.get(agent)
            masked = isinstance(seen, dict) and "action_mask" in seen
            space = self.spaces[agent]
            chosen[agent] = space.sample(mask=seen["action_mask"]) if masked else space.sample()
        return chosen


def still(space: gymnasium.Space[Any]) -> object:
    """Return an action in the middle of a space, the same each time."""
    if isinstance(space, gymnasium.spaces.Box):
        low = np.where(np.isfinite(space.low), space.low, 0)
        high = np.where(np.isfinite(space.high), space.high, 0)
        return ((low + high) / 2).astype(space.dtype)
    space = copy.deepcopy(space)
    space.seed(0)
    return space.sample()


def seconds(subject: Subject, env: Environment, info: object) -> float:
    """Read the time of an environment: from `time`, its info, or its own attribute."""
    if subject.time is not None:
        return float(subject.time(env))
    if isinstance(info, dict) and np.ndim(info.get("time", ())) == 0:
        return float(info["time"])
    time = getattr(env.unwrapped, "time", None)
    if isinstance(time, int | float | np.floating):
        return float(time)
    raise NotApplicable('no time to read: neither info["time"] nor env.time; give time=')


def same(a: object, b: object) -> bool:
    """Return whether two values are equal in type, shape and every bit."""
    if isinstance(a, dict) and isinstance(b, dict):
        return a.keys() == b.keys() and all(same(a[k], b[k]) for k in a)
    if isinstance(a, tuple | list) and isinstance(b, tuple | list):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray) and a.dtype != object:
        whole = (a.dtype, a.shape) == (b.dtype, b.shape)
        return whole and np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()
    if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
        return a.shape == b.shape and all(same(x, y) for x, y in zip(a.flat, b.flat, strict=True))
    return bool(a == b) or repr(a) == repr(b) == "nan"


def difference(a: Iterable[Transition], b: Iterable[Transition]) -> str | None:
    """Return where two walks first differ, in words; None if they do not."""
    steps = 0
    for x, y in zip(a, b, strict=True):
        steps += x.reward is not None
        for name in ("observation", "reward", "terminated", "truncated"):
            u, v = getattr(x, name), getattr(y, name)
            if not same(u, v):
                return f"the {name} differs after {steps} steps: {short(u)} and {short(v)}"
    return None


def short(value: object) -> str:
    """Return a value on one line."""
    text = " ".join(str(value).split())
    return text if len(text) <= 90 else f"{text[:87]}…"


def finite(value: object) -> bool:
    """Return whether all numbers of a value are finite."""
    if isinstance(value, dict):
        return all(finite(v) for v in value.values())
    if isinstance(value, tuple | list):
        return all(finite(v) for v in value)
    return bool(np.all(np.isfinite(np.asarray(value, dtype=float))))


def refuse_unless(right: bool, sentence: str) -> None:
    """Raise a Violation unless the condition holds."""
    if not right:
        raise Violation(sentence)


def _kept(*parts: object) -> Transition:
    return Transition(*copy.deepcopy(parts))
