"""Policies and their task, from the arguments of `uuvsim evaluate` and `uuvsim play`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.envs.task.task import Task, TeamTask

__all__ = ["Acting", "acting_of"]

WORDS = ("scripted", "random")


@dataclass(frozen=True)
class Acting:
    """A task, and the policies that act in it by name."""

    name: str  # of the task
    options: Mapping[str, object]
    task: Task | TeamTask
    policies: Mapping[str, Any]  # as `evaluate` takes them
    notes: tuple[str, ...] = ()  # on policies that were trained under other options


def acting_of(
    given: Sequence[str],
    task: str | None,
    options: Mapping[str, object],
    *,
    last: bool = False,
    own_task: bool = False,
) -> Acting:
    """Load the given policies; the task is theirs, unless one is named.

    `own_task`: raise InputInvalid for a policy that was trained in another task. `options` override
    those that the first policy of this task was trained with. `notes` name each policy that was
    trained with other options.
    """
    from uuvsim_cosim.envs.tasks.scripted import scripted_policy
    from uuvsim_cosim.learn.shared.task_ids import make_task
    from uuvsim_cosim.learn.training.config import merged
    from uuvsim_cosim.learn.training.loading import acting_in, load_policies, random_policy

    which = "policy" if last else "best"
    loaded = {g: load_policies(g, which) for g in given if g not in WORDS}
    firsts = {g: p[0] for g, p in loaded.items()}
    trained: Mapping[str, object] = {}
    if task is None:
        tasks = {p.task for p in firsts.values()}
        if len(tasks) != 1:
            read = f"policies of {' and '.join(sorted(tasks))}" if tasks else "no task"
            raise InputInvalid(read, "one task, or a policy that was trained in one")
        (task,) = tasks
    for g, p in firsts.items():
        if own_task and p.task != task:
            raise InputInvalid(
                f"--policy {g}: was trained in {p.task}, not in {task}",
                f"a policy of {task}, or --other-task, which allows another task",
            )
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
            try:
                policies[g] = acting_in(made, loaded[g], task)
            except InputInvalid as error:
                raise InputInvalid(f"{g}: {error}") from None
    notes = tuple(
        f"{g} was trained with {_shown(p.options, name)} and acts here with {_shown(every, name)}"
        for g, p in firsts.items()
        for name in sorted({*p.options, *every})
        if p.task == task and name not in options and p.options.get(name) != every.get(name)
    )
    return Acting(task, every, made, policies, notes)


def _shown(options: Mapping[str, object], name: str) -> str:
    return f"{name} {options[name]!r}" if name in options else f"the default of {name}"
