"""Agents of a task: their names, and the widths of their observations and actions."""

from __future__ import annotations

from uuvsim_cosim.envs.episodes.spaces import ActionBox, ObservationBox
from uuvsim_cosim.envs.task.signals import Signals
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.orchestrator.plan.flatten import flatten

__all__ = ["agents_of", "widths"]


def agents_of(task: Task | TeamTask) -> tuple[str, ...]:
    """Return the names of a task's agents; a task of one agent names it "agent"."""
    return tuple(task.agents) if isinstance(task, TeamTask) else ("agent",)


def widths(task: Task | TeamTask) -> tuple[int, int]:
    """Return the widths of an agent's observation and action."""
    plan = flatten(task.system)
    if isinstance(task, TeamTask):
        first = task.agents[0]
        return len(task.limits(first)[0]), ActionBox(plan, task.actions[first]).width
    signals = Signals(plan, [*(c.name for c in task.observations), *task.signals])
    seen = ObservationBox(plan, signals, list(task.observations), task.extra_limits)
    return len(seen.low), ActionBox(plan, task.actions).width
