"""Policies and the task they act in, as `uuvsim evaluate` and `uuvsim play` are given them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.task import Task, TeamTask

__all__ = ["Acting", "acting_of"]

WORDS = ("scripted", "random")


@dataclass(frozen=True)
class Acting:
    """A task, and what acts in it by name."""

    name: str  # of the task
    options: Mapping[str, Any]
    task: Task | TeamTask
    policies: Mapping[str, Any]  # as `evaluate` takes them


def acting_of(
    given: Sequence[str], task: str | None, options: Mapping[str, Any], *, last: bool = False
) -> Acting:
    """Load what is given; the task is that of the policies, unless one is named.

    `options` come after those that the policy was trained with, where the task is the policy's.
    """
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy
    from uuvsim_cosim.learn.config import merged
    from uuvsim_cosim.learn.loading import acting_in, load_policies, random_policy
    from uuvsim_cosim.learn.task_ids import make_task

    which = "policy" if last else "best"
    loaded = {g: load_policies(g, which) for g in given if g not in WORDS}
    firsts = {g: p[0] for g, p in loaded.items()}
    trained: Mapping[str, Any] = {}
    if task is None:
        tasks = {p.task for p in firsts.values()}
        if len(tasks) != 1:
            read = f"policies of {' and '.join(sorted(tasks))}" if tasks else "no task"
            raise InputInvalid(f"{read}; expected one task, or a policy that was trained in one")
        (task,) = tasks
    first = next((p for p in firsts.values() if p.task == task), None)
    trained = {} if first is None else first.options
    every = merged(trained, options)
    made = make_task(task, every)
    policies: dict[str, Any] = {}
    for g in given:
        if g == "scripted":
            policies[g] = scripted_policy(made)
        elif g == "random":
            policies[g] = random_policy(made)
        else:
            policies[g] = acting_in(made, loaded[g], task)
    return Acting(task, every, made, policies)
