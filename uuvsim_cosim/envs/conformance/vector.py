"""Claims about a vector: its rows, its autoreset, and the last observation of an episode."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import iterate

from uuvsim_cosim.envs.conformance.subject import (
    Actions,
    Environment,
    NotApplicable,
    Subject,
    Violation,
    refuse_unless,
    same,
    short,
)

__all__ = [
    "autoreset_declared",
    "autoreset_obeyed",
    "row_is_single_environment",
    "terminal_observation_kept",
]

MOST = 3000  # steps to wait for the end of an episode


def autoreset_declared(subject: Subject) -> str:
    """The metadata has the mode in which the vector resets rows whose episode has ended."""
    with subject.opened() as env:
        mode = env.metadata.get("autoreset_mode")
    refuse_unless(
        isinstance(mode, AutoresetMode),
        f'metadata["autoreset_mode"] is {mode!r}; expected a gymnasium.vector.AutoresetMode',
    )
    return f"{mode}"


class _Row(NamedTuple):
    """The results of one row in one step, and the expected ones."""

    step: int
    row: int
    phase: str  # "run", "end", "reset"
    seen: tuple[Any, ...]  # observation, reward, terminated, truncated
    expected: tuple[Any, ...] | None  # None if rows have no seeds of their own


def row_is_single_environment(subject: Subject) -> str:
    """Row i is the single environment with seed s + i, bit for bit."""
    if subject.single is None:
        raise NotApplicable("no single environment is given; give single=")
    if not subject.row_seeds:
        raise NotApplicable('it does not promise seeds s + i (metadata["row_seeds"] is absent)')
    count = 0
    for r in _rows(subject):
        count += 1
        first = 1 if r.phase == "end" else 0  # what is kept at the end is another claim
        if r.phase != "reset":
            _compare(r, range(first, 4))
    return f"{count} transitions are those of single environments with seeds s + i"


def terminal_observation_kept(subject: Subject) -> str:
    """The last observation of an episode is given, not that of the next one in its place."""
    ends = 0
    last: dict[int, object] = {}
    for r in _rows(subject):
        if r.phase == "end":
            ends += 1
            last[r.row] = r.seen[0]
            refuse_unless(
                r.seen[0] is not None,
                f'row {r.row} ended in step {r.step} without info["final_obs"], where '
                f"AutoresetMode.SAME_STEP keeps the last observation",
            )
            if r.expected is not None:
                _compare(r, (0,))
        elif r.phase == "reset" and r.expected is None:
            refuse_unless(
                not same(r.seen[0], last[r.row]),
                f"row {r.row}, step {r.step}: the last observation of an episode is that of the "
                f"next one's reset; expected the one before the reset",
            )
    if not ends:
        raise NotApplicable("no episode ended")
    return f"{ends} last observations are given"


def autoreset_obeyed(subject: Subject) -> str:
    """Rows are reset as the declared mode demands, with the observation of the next episode."""
    resets = 0
    for r in _rows(subject):
        if r.phase != "reset":
            continue
        resets += 1
        if r.expected is not None:
            _compare(r, range(4))
        elif r.seen[1] is not None:
            refuse_unless(
                bool(r.seen[1] == 0 and not r.seen[2] and not r.seen[3]),
                f"row {r.row} in step {r.step}, which resets it: reward {r.seen[1]}, terminated "
                f"{r.seen[2]}, truncated {r.seen[3]}; expected 0, False, False",
            )
    if not resets:
        raise NotApplicable("no episode ended")
    return f"{resets} resets as declared"


def _compare(r: _Row, parts: Iterable[int]) -> None:
    assert r.expected is not None
    names = ("observation", "reward", "terminated", "truncated")
    for i in parts:
        seen, expected = r.seen[i], r.expected[i]
        if expected is None or same(seen, expected) or (i and float(seen) == float(expected)):
            continue
        last = "last " if r.phase == "end" and i == 0 else ""
        first = "first " if r.phase == "reset" and i == 0 else ""
        raise Violation(
            f"row {r.row}, step {r.step}: the {last}{first}{names[i]} is {short(seen)}; "
            f"expected {short(expected)}, as of a single environment with seed s + {r.row}"
        )


def _rows(subject: Subject) -> Iterator[_Row]:
    """Step a vector, and single environments beside it."""
    steps = max(subject.steps, min((subject.limit or 0) + 3, MOST))
    with subject.opened() as env, ExitStack() as opened:
        mode = env.metadata["autoreset_mode"]
        n = env.num_envs
        make = subject.single if subject.row_seeds else None
        singles = [opened.enter_context(subject.opened(make)) for _ in range(n)] if make else []
        actions = Actions("vector", env, subject.seed)
        batch, _ = env.reset(seed=subject.seed)
        firsts = [s.reset(seed=subject.seed + i)[0] for i, s in enumerate(singles)]
        for i, o in enumerate(_split(env, batch)):
            yield _Row(
                0, i, "run", (o, None, None, None), (firsts[i], *[None] * 3) if singles else None
            )
        ended = np.zeros(n, bool)
        for k in range(1, steps + 1):
            action = actions.sample(env, batch)
            each = list(iterate(env.action_space, action))
            batch, reward, terminated, truncated, info = env.step(action)
            observations = _split(env, batch)
            over = np.asarray(terminated) | np.asarray(truncated)
            for i in range(n):
                flags = (reward[i], terminated[i], truncated[i])
                if ended[i] and mode == AutoresetMode.NEXT_STEP:
                    right = (singles[i].reset()[0], 0.0, False, False) if singles else None
                    yield _Row(k, i, "reset", (observations[i], *flags), right)
                    continue
                right = singles[i].step(each[i])[:4] if singles else None
                finished = bool(right[2] or right[3]) if right else bool(over[i])
                seen = observations[i]
                if finished and mode == AutoresetMode.SAME_STEP:
                    final = info.get("final_obs")
                    seen = None if final is None else final[i]
                yield _Row(k, i, "end" if finished else "run", (seen, *flags), right)
                if finished and mode == AutoresetMode.SAME_STEP:
                    first = (singles[i].reset()[0], *[None] * 3) if singles else None
                    yield _Row(k, i, "reset", (observations[i], None, None, None), first)
            if mode == AutoresetMode.DISABLED and over.any():
                batch, _ = env.reset(options={"reset_mask": over})
                for i, o in enumerate(_split(env, batch)):
                    if over[i]:
                        first = (singles[i].reset()[0], *[None] * 3) if singles else None
                        yield _Row(k, i, "reset", (o, None, None, None), first)
            ended = over


def _split(env: Environment, batch: object) -> list[object]:
    return list(iterate(env.observation_space, batch))
