"""Claims about time and about how an episode ends."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from uuvsim_cosim.envs.conformance.subject import (
    Actions,
    NotApplicable,
    Subject,
    Violation,
    finite,
    refuse_unless,
    seconds,
    short,
    still,
)

__all__ = ["exact_substeps", "failure_is_termination", "time_limit_is_truncation"]

EPISODES = 4
MOST = 20_000  # steps to wait for the end of an episode


class _End(NamedTuple):
    steps: int
    terminated: bool
    truncated: bool


def time_limit_is_truncation(subject: Subject) -> str:
    """An episode that its time limit ends is truncated, and none goes on after it."""
    limit = subject.limit
    if limit is not None and limit > MOST:
        raise NotApplicable(f"the limit of {limit} steps is too far away; give time_limit=")
    patience = limit + 1 if limit is not None else max(8 * subject.steps, 512)
    ends = [_end(subject, k, patience) for k in range(EPISODES)]
    known = [e for e in ends if e is not None]
    if limit is None:
        if any(e.truncated for e in known):
            return "episodes that do not end by themselves are truncated"
        lengths = {e.steps for e in known}
        if len(known) == len(ends) and len(lengths) == 1 and lengths != {1}:
            raise Violation(
                f"all of {EPISODES} episodes, whatever the actions, terminated after exactly "
                f"{lengths.pop()} steps; a time limit is truncated=True"
            )
        raise NotApplicable(f"no time limit is known, nor was one seen in {patience} steps")
    refuse_unless(None not in ends, f"an episode went on after its limit of {limit} steps")
    at_limit = [e for e in known if e.steps == limit]
    if not at_limit:
        raise NotApplicable(f"no episode of {EPISODES} lasted until the limit of {limit} steps")
    refuse_unless(
        any(e.truncated for e in at_limit),
        f"{len(at_limit)} episodes ended at the limit of {limit} steps with terminated=True, "
        f"truncated=False; expected truncated=True",
    )
    return f"{len(at_limit)} of {EPISODES} episodes lasted {limit} steps and were truncated"


def _end(subject: Subject, k: int, patience: int) -> _End | None:
    """Run one episode with random actions, or with one constant action if k is odd."""
    with subject.opened() as env:
        actions = Actions(subject.kind, env, subject.seed + k)
        observation, _ = env.reset(seed=subject.seed + k)
        for step in range(1, patience + 1):
            action = actions.sample(env, observation)
            if k % 2:
                action = (
                    {a: still(env.action_space(a)) for a in action}
                    if subject.kind == "parallel"
                    else still(env.action_space)
                )
            given = env.step(action)
            observation = given[0]
            if subject.over(env, given):
                return _End(step, _any(given[2]), _any(given[3]))
    return None


def failure_is_termination(subject: Subject) -> str:
    """A component that fails ends the episode: terminated, with a reason, and finite numbers."""
    if subject.failing is None:
        raise NotApplicable("no failure to provoke; give failing=, which makes one that fails")
    with subject.opened(subject.failing) as env:
        actions = Actions(subject.kind, env, subject.seed)
        observation, _ = env.reset(seed=subject.seed)
        for k in range(1, MOST):
            try:
                step = env.step(actions.sample(env, observation))
            except Exception as error:
                raise Violation(
                    f"step {k} raises {type(error).__name__}: {short(error)}; expected "
                    f'terminated=True and info["failure"]'
                ) from error
            observation, reward, terminated, truncated, info = step
            refuse_unless(
                finite(observation) and finite(reward),
                f"step {k} gives numbers that are not finite; expected those of the last good "
                f"moment",
            )
            if _any(terminated) or _any(truncated):
                break
        ended = _any(terminated) and not _any(truncated)
        reasons = info.values() if subject.kind == "parallel" else [info]
        refuse_unless(ended, "a failure gave truncated=True; expected terminated=True alone")
        refuse_unless(
            all(isinstance(i.get("failure"), str) for i in reasons),
            'a failure without a reason; expected a sentence in info["failure"]',
        )
        env.reset(seed=subject.seed)
    return f"a failure in step {k} is a termination with a reason"


def exact_substeps(subject: Subject) -> str:
    """Every action lasts the same time, exactly: time is counted, not summed."""
    if subject.kind == "vector":
        raise NotApplicable("checked for the single environment")
    with subject.opened() as env:
        actions = Actions(subject.kind, env, subject.seed)
        observation, info = env.reset(seed=subject.seed)
        start = seconds(subject, env, _one(subject, info))
        each = subject.action_step
        for k in range(1, subject.steps + 1):
            step = env.step(actions.sample(env, observation))
            observation = step[0]
            if subject.kind == "parallel" and not step[4]:
                break
            now = seconds(subject, env, _one(subject, step[4]))
            if k == 1:
                first = now - start if each is None else float(each)
            right = start + (k * first if each is None else float(k * each))
            refuse_unless(
                math.isclose(now, right, rel_tol=1e-9, abs_tol=1e-9),
                f"after {k} actions the time is {now} s; expected {right} s, each action lasting "
                f"{first} s",
            )
            if subject.over(env, step):
                break
    return f"{k} actions last the same time each"


def _one(subject: Subject, info: Any) -> object:
    """Return the info of one agent."""
    return next(iter(info.values()), {}) if subject.kind == "parallel" else info


def _any(flags: Any) -> bool:
    return any(flags.values()) if isinstance(flags, dict) else bool(np.any(flags))
