"""An episode of a task as one system: the task's components, and the task with its policies.

The component `task` steps before the components that it acts on, in a Gauss-Seidel group, so that
an action acts from the tick at which it was chosen, as in an environment.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.deployment.task_component import TaskComponent, task_component
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.seeds import component_seed
from uuvsim_cosim.orchestrator.system.resolve import register
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["task_system"]

TASK = "task"  # the component's path
_made: dict[str, TaskComponent] = {}  # of this process, by source


@dataclass(frozen=True)
class TaskSource(ModelSource):
    """The source of a task with its policies, which this process has made."""

    def declaration(self) -> Model:
        """Return the declaration."""
        return _made[self.text].model


def task_system(
    task: Task | TeamTask, policies: Mapping[str, Policy], seed: int, name: str
) -> System:
    """Return the system of episode 0 of a seed, in which `policies` act by agent.

    Start values and random keys are those of an environment's reset with that seed. Raises
    InputInvalid for a task that cannot be declared as a component.
    """
    draws = Draws(np.array([seed], np.uint64), np.zeros(1, np.int64))
    start = {key: np.asarray(value)[0] for key, value in task.start(draws).items()}
    plan = flatten(task.system)
    system = _flat(plan, name, f"Episode of seed {seed} with its policy")
    for key, value in start.items():
        system = system.set(key, value)
    (system_seed,) = draws.seeds()
    for c in plan.components:
        v = c.description.variables.get("seed")
        if v is not None and v.type == "Int32" and v.shape == (2,) and "seed" not in c.start:
            system = system.set(f"{c.path}.seed", component_seed(int(system_seed), c.path))
    made = task_component(task, policies, start)
    token = content_hash([name, str(seed), repr(sorted(start.items(), key=str)), *_texts(policies)])
    text = f"task:{name.replace(':', '_')}-{token[:12]}"
    _made[text] = made
    system = system.add(TASK, text)
    for own, key in made.reads.items():
        system = system.connect(key, f"{TASK}.{own}")
    acted: list[str] = []
    for output, targets in made.commands.items():
        for i, (key, element) in enumerate(targets):
            index = f"[{i + 1}]" if len(targets) > 1 else ""
            system = system.connect(f"{TASK}.{output}{index}", _element(plan, key, element))
            acted.append(key.rpartition(".")[0])
    return _grouped(system, plan, set(acted), name)


def _flat(plan: Plan, name: str, description: str) -> System:
    """Return a plan's components and connections as one system without nested systems."""
    system = System(name, str(plan.tick), description, mismatches="warn")
    for c in plan.components:
        rate = None if c.step_ticks == 1 else c.step_ticks * plan.tick
        system = system.add(c.path, c.source, start=dict(c.start), rate=rate)
    for t in plan.transfers:
        source, target = plan.components[t.source].path, plan.components[t.target].path
        for i, j in zip(t.source_elements, t.target_elements, strict=True):
            a = f"{source}.{t.source_variable.element_name(i)}"
            b = f"{target}.{t.target_variable.element_name(j)}"
            system = system.connect(a, b)
    if _transfers(flatten(system)) != _transfers(plan):
        raise InputInvalid(f"task {name}", "connections that convert values", "plain connections")
    return system


def _transfers(plan: Plan) -> set[tuple[object, ...]]:
    """Return all connections of a plan, element by element."""
    return {
        (t.source, t.source_variable.name, i, t.target, t.target_variable.name, j, t.factor,
         t.offset, t.table)
        for t in plan.transfers
        for i, j in zip(t.source_elements, t.target_elements, strict=True)
    }  # fmt: skip


def _element(plan: Plan, key: str, element: int) -> str:
    path, _, own = key.rpartition(".")
    c = next(c for c in plan.components if c.path == path)
    return f"{path}.{c.description.variables[own].element_name(element)}"


def _grouped(system: System, plan: Plan, acted: set[str], name: str) -> System:
    """Put the task before the components that it acts on, and keep all other orders."""
    paths = [c.path for c in plan.components]
    place = {i: (g, k) for g, group in enumerate(plan.groups) for k, i in enumerate(group.members)}
    joined: list[int] = []
    for group in plan.groups:
        own = [i for i in group.members if paths[i] in acted]
        if group.algorithm == "jacobi":
            joined += own
        elif group.algorithm == "iterated" and own:
            raise InputInvalid(
                f"task {name}", f"{paths[own[0]]} is in an iterated group", "a Gauss-Seidel group"
            )
        elif own:
            joined += group.members
        else:
            system = system.group([paths[i] for i in group.members], group.algorithm,
                                  solver=group.solver, tolerance=group.tolerance,
                                  limit=group.limit)  # fmt: skip
    # As in the task's system, an output is early only inside one Gauss-Seidel group.
    after: dict[int, set[int]] = {i: set() for i in joined}
    for a, b in {(t.source, t.target) for t in plan.transfers if t.source != t.target}:
        if a in after and b in after:
            (g, first), (h, second) = place[a], place[b]
            early = g == h and plan.groups[g].algorithm == "gauss-seidel" and first < second
            after[b if early else a].add(a if early else b)
    try:
        ordered = list(TopologicalSorter(after).static_order())
    except CycleError as error:
        around = " -> ".join(paths[i] for i in error.args[1])
        raise InputInvalid(
            f"task {name}", f"components in a loop of orders, {around}", "no such loop"
        ) from None
    return system.group([TASK, *(paths[i] for i in ordered)])


def _texts(policies: Mapping[str, Policy]) -> list[str | bytes]:
    texts: list[str | bytes] = []
    for agent, policy in policies.items():
        texts += [agent, policy.kind, repr(policy.settings)]
        for key, tensor in sorted(policy.tensors.items()):
            texts += [key, tensor.tobytes()]
    return texts


def _source(text: str, _base: Path) -> Any:
    if text not in _made:
        raise InputInvalid(f"source {text!r}", "a task of another process", "its own page")
    return TaskSource(text)


register("task", _source)
