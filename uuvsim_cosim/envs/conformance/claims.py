"""Claims that hold of every environment: one, a vector of many, or several agents."""

from __future__ import annotations

import contextlib
import copy
import io
import itertools
import pickle
import warnings
from typing import Any

import numpy as np

from uuvsim_cosim.envs.conformance.subject import (
    Actions,
    Environment,
    NotApplicable,
    Subject,
    Transition,
    Violation,
    difference,
    refuse_unless,
    same,
    short,
)

__all__ = [
    "actions_unchanged",
    "another_episode_without_seed",
    "close_twice",
    "interface",
    "interleaved",
    "noise_follows_seed",
    "observations_in_space",
    "observations_kept",
    "pickling",
    "same_seed_same_trajectory",
    "seed_reaches_observations",
    "wrong_seed_refused",
]

# Advice on spaces, which many sound environments do not take; `strict` makes it count.
ADVICE = ("infinity. This is probably too", "recommend using a symmetric and normalized space",
          "space value is -infinity", "space value is infinity")  # fmt: skip


def interface(subject: Subject) -> str:
    """The checks of the interface's own authors pass without a warning."""
    advice = 0
    with warnings.catch_warnings():  # of the checkers' own imports
        warnings.simplefilter("ignore")
        from gymnasium.utils.env_checker import check_env
        from pettingzoo.test import parallel_api_test, parallel_seed_test
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with contextlib.redirect_stdout(io.StringIO()):
            try:
                if subject.kind == "single":
                    name = "gymnasium.utils.env_checker.check_env"
                    with subject.opened(subject.bare) as env:
                        check_env(env, skip_render_check=True)
                else:
                    name = "pettingzoo.test.parallel_api_test and parallel_seed_test"
                    with subject.opened() as env:
                        parallel_api_test(env, num_cycles=subject.steps)
                    parallel_seed_test(subject.make, num_cycles=subject.steps)
            except Exception as error:
                raise Violation(f"{type(error).__name__}: {short(error)}") from error
    for w in caught:
        if any(a in str(w.message) for a in ADVICE) and not subject.strict:
            advice += 1
        else:
            raise Violation(f"a warning: {short(w.message)}")
    return f"{name}: no warning" + (f" ({advice} times advice)" if advice else "")


def same_seed_same_trajectory(subject: Subject) -> str:
    """The same seed and actions give the same episodes, bit for bit."""
    with subject.opened() as env:
        first = subject.path(env, subject.seed)
        again = difference(first, subject.path(env, subject.seed))
    refuse_unless(again is None, f"reset twice with seed {subject.seed}: {again}")
    other = difference(first, subject.alone(subject.seed))
    refuse_unless(other is None, f"two environments with seed {subject.seed}: {other}")
    return f"{subject.steps} steps from seed {subject.seed} are the same bits three times"


def interleaved(subject: Subject) -> str:
    """Two environments stepped in turn do what each does alone."""
    a, b = subject.seed, subject.seed + 1000
    alone = [subject.alone(a), subject.alone(b)]
    with subject.opened() as first, subject.opened() as second:
        pairs = list(zip(subject.walk(first, a), subject.walk(second, b), strict=False))
    for i, path in enumerate(alone):
        found = difference([pair[i] for pair in pairs], path[: len(pairs)])
        refuse_unless(found is None, f"in turn with another, and alone: {found}")
    return "two in turn give the same bits as each alone"


def pickling(subject: Subject) -> str:
    """A pickled copy gives the same episodes."""
    with subject.opened() as env:
        try:
            copied = pickle.loads(pickle.dumps(env))
        except Exception as error:
            raise Violation(f"cannot be pickled: {type(error).__name__}: {error}") from error
        expected = subject.path(env, subject.seed)
    with subject.opened(lambda: copied):
        found = difference(expected, subject.path(copied, subject.seed))
    refuse_unless(found is None, f"the environment and its pickled copy: {found}")
    return f"a pickled copy gives the same {subject.steps} steps"


def another_episode_without_seed(subject: Subject) -> str:
    """A reset without a seed begins another episode than the one before."""
    with subject.opened() as env:
        first = _beginning(subject, env, subject.seed)
        second = _beginning(subject, env, None)
    if difference(first, second) is None:
        if difference(first, _first(subject, subject.seed + 1)) is None:
            raise NotApplicable("nothing is drawn: episodes of two seeds are the same")
        raise Violation(
            "reset() after reset(seed) gives the same episode again; "
            "expected another one, from the next state of the generator"
        )
    return "reset() after reset(seed) gives another episode"


def seed_reaches_observations(subject: Subject) -> str:
    """What differs from episode to episode differs by the seed: another seed, other numbers."""
    first = _first(subject, subject.seed)
    others = [_first(subject, subject.seed + k) for k in (1, 2, 1000)]
    equal = [difference(first, other) is None for other in others]
    if not any(equal):
        return "four seeds give four episodes"
    with subject.opened() as env:
        _beginning(subject, env, subject.seed)
        drawn = difference(first, _beginning(subject, env, None)) is not None
    if all(equal) and not drawn:
        raise NotApplicable("nothing is drawn: episodes of two seeds are the same")
    raise Violation("two seeds give the same observations; expected different ones")


def noise_follows_seed(subject: Subject) -> str:
    """From the same start, another seed gives other noise."""
    if subject.start is None:
        raise NotApplicable("no way to fix the start; give start=, options of such a reset")
    with subject.opened() as env:
        first = _beginning(subject, env, subject.seed, options=subject.start)
        later = _beginning(subject, env, None, options=subject.start)
        other = _beginning(subject, env, subject.seed + 1, options=subject.start)
    if difference(first, other) is not None:
        return "from the same start, two seeds give different observations"
    if difference(first, later) is None:
        raise NotApplicable("no noise: episodes from the same start are the same")
    raise Violation(
        "from the same start, observations differ from episode to episode, but not by the seed; "
        "expected other noise from another seed"
    )


def observations_in_space(subject: Subject) -> str:
    """Every observation lies in its space, with its shape and type; rewards are finite."""
    count = 0
    with subject.opened() as env:
        for t in subject.walk(env, subject.seed):
            observed: Any = t.observation
            spaces = {"observation": env.observation_space}
            if subject.kind == "parallel":
                spaces = {
                    f"{a}'s observation": env.observation_space(a)
                    for a in observed
                    if a in env.possible_agents
                }
                observed = {f"{a}'s observation": value for a, value in observed.items()}
            else:
                observed = {"observation": observed}
            for name, space in spaces.items():
                count += 1
                value = observed[name]
                if not space.contains(value):
                    seen = short(value)
                    if isinstance(value, np.ndarray):
                        seen = f"{value.dtype} of shape {value.shape}, {seen}"
                    raise Violation(f"{name} after {count} is not in {short(space)}: {seen}")
            rewards = t.reward.values() if isinstance(t.reward, dict) else (t.reward,)
            for reward in rewards:
                if reward is not None and not np.all(np.isfinite(np.asarray(reward, float))):
                    raise Violation(f"a reward is {short(reward)}; expected finite numbers")
    return f"{count} observations lie in their space"


def actions_unchanged(subject: Subject) -> str:
    """A step does not change the action that it is given."""
    with subject.opened() as env:
        actions = Actions(subject.kind, env, subject.seed)
        observation, _ = env.reset(seed=subject.seed)
        for k in range(subject.steps):
            action = actions.sample(env, observation)
            before = copy.deepcopy(action)
            step = env.step(action)
            observation = step[0]
            refuse_unless(
                same(action, before),
                f"step {k + 1} changed its action from {short(before)} to {short(action)}",
            )
            if subject.over(env, step):
                break
    return "no step changes its action"


def observations_kept(subject: Subject) -> str:
    """An observation once given is not changed by later steps, nor by a reset."""
    given: list[tuple[object, object]] = []
    with subject.opened() as env:
        actions = Actions(subject.kind, env, subject.seed)
        observation, _ = env.reset(seed=subject.seed)
        given.append((observation, copy.deepcopy(observation)))
        for _ in range(subject.steps):
            step = env.step(actions.sample(env, observation))
            observation = step[0]
            given.append((observation, copy.deepcopy(observation)))
            if subject.over(env, step):
                break
        env.reset()
    for k, (observation, as_given) in enumerate(given):
        refuse_unless(
            same(observation, as_given),
            f"the observation of step {k} was changed afterwards: environments give new arrays",
        )
    return f"{len(given)} observations are as they were given"


def close_twice(subject: Subject) -> str:
    """A second close does nothing."""
    env = subject.make()
    env.reset(seed=subject.seed)
    env.close()
    try:
        env.close()
    except Exception as error:
        raise Violation(f"the second close raises {type(error).__name__}: {error}") from error
    return "a second close does nothing"


def wrong_seed_refused(subject: Subject) -> str:
    """A seed that is no whole number from 0 is refused."""
    wrong: tuple[object, ...] = ("7", 1.5, -1, [[1]])
    with subject.opened() as env:
        for seed in wrong:
            try:
                env.reset(seed=seed)
            except Exception:
                continue
            raise Violation(f"reset(seed={seed!r}) is accepted; expected an error")
        env.reset(seed=subject.seed)
    return f"{', '.join(repr(s) for s in wrong)} are refused"


def _first(subject: Subject, seed: int) -> list[Transition]:
    with subject.opened() as env:
        return _beginning(subject, env, seed)


def _beginning(
    subject: Subject, env: Environment, seed: int | None, options: dict[str, object] | None = None
) -> list[Transition]:
    """Return the first observations of an episode; the same number, whenever it ends."""
    walk = subject.walk(env, seed, options=options)
    return list(itertools.islice(walk, 1 + min(subject.steps, 8)))
