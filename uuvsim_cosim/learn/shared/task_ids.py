"""Tasks by the names that `uuvsim train` and the files of policies use."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import get_args

from uuvsim_cosim.envs.registration import SHIPPED
from uuvsim_cosim.envs.task.checks import refuse_options
from uuvsim_cosim.envs.task.task import Task, TeamTask, mismatches_warned
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.system.elements import Mismatches

__all__ = ["TASKS", "make_task", "short_name"]

OR = "or one of yours: FILE.py:Name, package.module:Name"

TASKS: dict[str, str] = {
    "target-tracking": "uuvsim_cosim.envs.tasks.target_tracking:TargetTracking",
    **{
        name: f"uuvsim_cosim.envs.tasks.tracking_scenarios:{name}"
        for name in ("source", "transition_1", "transition_2", "target")
    },
    "disturbed": "uuvsim_cosim.envs.tasks.disturbed:Disturbed",
    "pool_tracking": "uuvsim_cosim.envs.tasks.pool_tracking:PoolTracking",
    **SHIPPED,
}


def make_task(
    name: str, options: Mapping[str, object] | None = None, *, profile: str | None = None
) -> Task | TeamTask:
    """Make a task by its name, with its options.

    `name` is a scenario of target tracking ("source", "transition_1", "transition_2", "target"),
    the id of an environment ("uuvsim/StationKeeping-v0"), or a task of your own,
    "my_package.module:Name" or "my.py:Name". `options` are its keyword arguments. `profile` is the
    option of that name of target tracking; "default" is accepted for every task. The option
    `mismatches` of every task is the policy for parts of another vehicle, "refuse" or "warn" (see
    `System.with_mismatches`). Raises InputInvalid for an unknown name or option.

    Example:

    >>> from uuvsim_cosim.learn import make_task
    >>> task = make_task("uuvsim/StationKeeping-v0", {"away": 0.5, "horizon": 10})  # m, s
    >>> task.away, task.horizon
    (0.5, Fraction(10, 1))
    """
    from inspect import signature

    from uuvsim_cosim.orchestrator.python.class_file import imported

    module, colon, own = TASKS.get(name, name).rpartition(":")
    if not colon:
        raise InputInvalid(f"task {name!r}", "no such task", f"{expected_names(name, TASKS)}, {OR}")
    if not module or not own.isidentifier():
        raise InputInvalid(f"task {name!r}", "package.module:Name, or FILE.py:Name")
    make: Callable[..., object] | None = getattr(imported(module, f"task {name!r}"), own, None)
    if not callable(make):
        raise InputInvalid(f"task {name!r}", f"no class {own!r} in {module}", "a task's")
    given = dict(options or {})
    mismatches = given.pop("mismatches", "refuse")
    if mismatches not in get_args(Mismatches):
        raise InputInvalid(f"mismatches {mismatches!r}", "refuse or warn")
    if profile not in (None, "default"):
        from uuvsim_cosim.envs.tasks.target_tracking import TargetTracking
        from uuvsim_cosim.envs.tasks.tracking_scenarios import SCENARIOS

        if make is not TargetTracking and make not in SCENARIOS.values():
            raise InputInvalid(
                f"profile {profile!r}", f"{name} has none", "default, or a task of target tracking"
            )
        if given.setdefault("profile", profile) != profile:
            raise InputInvalid(
                f"profile {profile!r}, and {given['profile']!r} among the task's options",
                "one of them",
            )
    refuse_options(f"task {name}", make, given)
    try:
        with mismatches_warned(mismatches == "warn"):
            task: object = make(**given)
    except TypeError as error:
        raise InputInvalid(f"task {name}", error, f"options of {signature(make)}") from error
    if not isinstance(task, Task | TeamTask):
        raise InputInvalid(f"task {name}", f"gives {type(task).__name__}", "a Task or TeamTask")
    return task


def short_name(name: str) -> str:
    """Return a task's name for the name of a folder: without "uuvsim/" and without a module."""
    return name.rpartition("/")[2].rpartition(":")[2]
