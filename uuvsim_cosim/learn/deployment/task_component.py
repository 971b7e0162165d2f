"""A task with its policies as one component: observation, network, action, reward and end.

At each tick of the clock `action`, every `action_step` s, the component computes the task's
expressions from the signals that are valid then, evaluates the network of each agent, and holds the
action until the next tick:

    command = middle + half clip(network(observation))

The reward and the end belong to the action that led to the tick, as in an environment.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from uuvsim_cosim.envs.episodes.spaces import ActionBox, ObservationBox
from uuvsim_cosim.envs.task.expressions import (
    Logical,
    Symbolic,
    declared_methods,
    symbolic_of,
)
from uuvsim_cosim.envs.task.signals import Signals, resolved
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.learn.policies.policy import Policy
from uuvsim_cosim.models.declaration.model import Clock, Model, Type
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.policies.policy_file import Channel, PolicyFile
from uuvsim_cosim.models.policies.policy_network import decided
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["TaskComponent", "task_component"]


@dataclass(frozen=True)
class TaskComponent:
    """The declaration, the signal that each input reads, and the elements that commands set."""

    model: Model
    reads: Mapping[str, str]  # by input: "hull_eta" reads "hull.eta"
    commands: Mapping[str, tuple[tuple[str, int], ...]]  # by output: variable and element, from 0


def task_component(
    task: Task | TeamTask, policies: Mapping[str, Policy], start: Mapping[str, Any]
) -> TaskComponent:
    """Declare a task with the policy of each agent, for an episode with the values of `start`.

    Raises InputInvalid for a task whose observation is not declared as expressions.
    """
    plan = flatten(task.system)
    symbolic = _declared(task)
    several = isinstance(task, TeamTask)
    actions = task.actions if isinstance(task, TeamTask) else {"agent": task.actions}
    boxes = {agent: ActionBox(plan, channels) for agent, channels in actions.items()}
    m = Model("task", f"The task {type(task).__name__} with its policy")
    clock = m.clock("action", task.action_step)
    wiring = _Wiring(m, clock, plan, symbolic, {a: b.width for a, b in boxes.items()}, start)
    results = wiring.results(_results(task, symbolic.results))
    commands: dict[str, tuple[tuple[str, int], ...]] = {}
    chosen = {}
    for agent, box in boxes.items():
        before = f"{agent}_" if several else ""
        seen = results[("observation", agent)]
        if not isinstance(task, TeamTask):
            seen = ca.vertcat(_channels(task, plan, wiring), seen)
        action = clip(decided(m, clock, _file(policies[agent]), seen, 1.0), -1.0, 1.0)
        chosen[agent] = action
        given = [_start_of(plan, *target) for target in box.targets]
        value = ca.DM(box.middle[:, 0]) + ca.DM(box.half[:, 0]) * action
        units = [_unit_of(plan, *target) for target in box.targets]
        _held(m, clock, f"{before}command", value, given, units, "value of the inputs acted on")
        ones = ["1"] * box.width
        _held(m, clock, f"{before}action", action, [0.0] * box.width, ones, "as the policy acts")
        width = seen.numel()
        _held(m, clock, f"{before}observation", seen, [0.0] * width, ["1"] * width,
              "as the policy observes")  # fmt: skip
        commands[f"{before}command"] = tuple(box.targets)
    _ends(m, clock, task, wiring, results)
    wiring.finish(chosen)
    return TaskComponent(m, wiring.reads, commands)


class _Wiring:
    """Inputs and discrete states for the symbols of a task's expressions."""

    def __init__(
        self, m: Model, clock: Clock, plan: Plan, symbolic: Symbolic, widths: Mapping[str, int],
        start: Mapping[str, Any],
    ) -> None:  # fmt: skip
        self.reads: dict[str, str] = {}
        self._m, self._clock, self._plan, self._symbolic = m, clock, plan, symbolic
        self._inputs: dict[str, ca.SX] = {}
        self._before: dict[str, ca.SX] = {}
        self._start = start
        self.step = m.discrete("step_held", unit="1", description="actions so far")
        self._actions = {
            agent: m.discrete(f"{agent}_before", [0.0] * width, (width,), unit="1")
            for agent, width in widths.items()
        }

    def results(self, wanted: Mapping[tuple[str, str], ca.SX]) -> dict[tuple[str, str], ca.SX]:
        """Return expressions with the component's own symbols."""
        columns = [ca.vec(ca.SX(x).T) for x in wanted.values()]
        used = {s.name() for s in ca.symvar(ca.vertcat(*columns))}
        old, new = [], []
        for key, flat in self._symbolic.symbols.items():
            if any(flat[i].name() in used for i in range(flat.numel())):
                old.append(flat)
                new.append(self._symbol(key))
        f = ca.Function("task", [ca.vertcat(*old)], [ca.vertcat(*columns)], {"allow_free": True})
        if f.has_free():
            raise InputInvalid(self._symbolic.place, f"free symbols {f.get_free()}", "those of m")
        found, at = {}, 0
        whole = f(ca.vertcat(*new))
        for key, column in zip(wanted, columns, strict=True):
            found[key] = whole[at : at + column.numel()]
            at += column.numel()
        return found

    def signal(self, name: str) -> ca.SX:
        """Return the elements of a signal, from an input of the whole variable."""
        named = resolved(self._plan, name)
        if named.key not in self._inputs:
            own, v = named.key.replace(".", "_"), named.variable
            units = [u or "1" for u in v.units]
            self._inputs[named.key] = self._m.input(
                own, v.size if v.shape else (), unit=units if v.shape else units[0], type=_type(v),
                description=v.description,
            )  # fmt: skip
            self.reads[own] = named.key
        return self._inputs[named.key][list(named.elements)]

    def finish(self, chosen: Mapping[str, ca.SX]) -> None:
        """Update what the next action knows of this one."""
        for key, held in self._before.items():
            self._m.update(self._clock, held, self._inputs[key])
        for agent, action in chosen.items():
            self._m.update(self._clock, self._actions[agent], action)
        self._m.update(self._clock, self.step, self.step + 1.0)

    def _symbol(self, key: tuple[str, str]) -> ca.SX:
        kind, name = key
        if kind == "now":
            return self.signal(name)
        if kind == "before":  # after a reset, the moment before is this moment
            now, named = self.signal(name), resolved(self._plan, name)
            if named.key not in self._before:
                size = named.variable.size
                self._before[named.key] = self._m.discrete(
                    f"{named.key.replace('.', '_')}_before", [0.0] * size, (size,), unit="1"
                )
            held = self._before[named.key][list(named.elements)]
            return ca.if_else(self.step < 0.5, now, held)
        if kind == "action":
            return self._actions[name]
        if kind == "start":
            own, v = f"start_{name.replace('.', '_')}", resolved(self._plan, name).variable
            if own not in self._m.variables:
                units = [u or "1" for u in v.units]
                values = np.ravel(np.asarray(self._start[name], float)).tolist()
                self._m.parameter(
                    own, values, (v.size,), unit=units, description=f"start value of {name}"
                )
            return self._m.variables[own].symbol
        return self.step


def _declared(task: Task | TeamTask) -> Symbolic:
    """Return the expressions of a task; raises InputInvalid for a method that only Python has."""
    place, base = f"task {type(task).__name__}", TeamTask if isinstance(task, TeamTask) else Task
    if isinstance(task, TeamTask) and type(task).present is not TeamTask.present:
        raise InputInvalid(place, "its agents come and go (present())", "agents that stay")
    declared = declared_methods(task)
    symbolic = (symbolic_of(task) if declared else None) or Symbolic(place, {}, {})
    for name in ("observe" if base is TeamTask else "extra", "reward", "terminated"):
        if getattr(type(task), name) is getattr(base, name):
            continue
        if name not in symbolic.results or name not in declared:
            raise InputInvalid(
                place,
                f"{name}() is computed by Python",
                "a task whose expressions() declares it, such as StationKeeping",
            )
    return symbolic


def _results(task: Task | TeamTask, results: Mapping[str, Any]) -> dict[tuple[str, str], ca.SX]:
    """Return the expressions by kind and agent, or by "info" and name."""
    several, found = isinstance(task, TeamTask), {}
    given = declared_methods(task)
    for kind, name in (("observation", "observe" if several else "extra"), ("reward", "reward"),
                       ("terminated", "terminated")):  # fmt: skip
        if name not in results or name not in given:
            if kind == "observation":
                found[kind, "agent"] = ca.SX(0, 1)
            continue
        by_agent = results[name] if several else {"agent": results[name]}
        found |= {(kind, agent): ca.SX(x) for agent, x in by_agent.items()}
    infos = results.get("info", {}) if "info" in given else {}
    for name, x in infos.items():
        value = ca.SX(x.value if isinstance(x, Logical) else x)
        if value.numel() == 1:
            found["info", name] = value
    return found


def _channels(task: Task, plan: Plan, wiring: _Wiring) -> ca.SX:
    """Return the observed channels of a task of one agent, scaled and clipped."""
    names = [*(c.name for c in task.observations), *task.signals]
    signals = Signals(plan, names)
    box = ObservationBox(plan, signals, list(task.observations), task.extra_limits)
    if box.sines:
        raise InputInvalid(
            f"task {type(task).__name__}",
            "an observation as sine and cosine, which NumPy computes",
            "expressions() with ca.sin and ca.cos",
        )
    if not len(box.rows):
        return ca.SX(0, 1)
    used = {n for n, at in _places(plan, signals) if at in set(box.rows.tolist())}
    flat = ca.vertcat(*(
        wiring.signal(n) if n in used else ca.SX(resolved(plan, n).variable.size, 1)
        for n in signals.names
    ))  # fmt: skip
    own = ca.DM(box.factor[:, 0]) * flat[box.rows.tolist()] + ca.DM(box.offset[:, 0])
    n, most = len(box.rows), np.finfo(np.float32).max
    low, high = (np.clip(side[:n], -most, most).astype(float) for side in (box.low, box.high))
    return clip(own, ca.DM(low), ca.DM(high))


def _places(plan: Plan, signals: Signals) -> Iterator[tuple[str, int]]:
    for name in signals.names:
        for row in signals.rows(resolved(plan, name)):
            yield name, int(row)


def _ends(
    m: Model, clock: Clock, task: Task | TeamTask, wiring: _Wiring,
    results: Mapping[tuple[str, str], ca.SX],
) -> None:  # fmt: skip
    """Declare reward, return, end and infos of the episode."""
    acted = wiring.step > 0.5
    last = float(task.horizon / task.action_step)
    ended = m.discrete("ended_held", unit="1")
    over = wiring.step >= last
    for (kind, _), x in results.items():
        if kind == "terminated":
            over = ca.logic_or(over, x != 0.0)
    rewards = [x for (kind, _), x in results.items() if kind == "reward"]
    if rewards:
        mean = sum(rewards[1:], rewards[0]) / len(rewards)
        reward = ca.if_else(acted, mean, 0.0)
        _held(m, clock, "reward", reward, [0.0], ["1"], "reward of the last action, mean of agents")
        total = m.discrete("return_held", unit="1")
        counted = ca.if_else(ended > 0.5, 0.0, reward)
        m.update(clock, total, total + counted)
        m.output("return", total, unit="1", discrete=True, description="sum of the rewards so far")
    m.update(clock, ended, ca.if_else(ca.logic_and(acted, over), 1.0, ended))
    m.output("ended", ended, unit="1", discrete=True, description="1 after the end of the episode")
    for (kind, name), x in results.items():
        if kind == "info":
            _held(m, clock, f"info_{name}", x, [0.0], ["1"], f"info {name!r} of the task")


def _held(
    m: Model, clock: Clock, name: str, value: ca.SX, start: list[float], units: list[str],
    description: str,
) -> None:  # fmt: skip
    single = len(start) == 1
    shape = () if single else (len(start),)
    first: Any = start[0] if single else start
    unit: Any = units[0] if single else units
    held = m.discrete(f"{name}_held", first, shape, unit=unit)
    m.update(clock, held, value)
    m.output(name, held, unit=unit, description=description, discrete=True)


def _type(v: Variable) -> Type:
    """Return the type of an input that reads a variable."""
    return "Boolean" if v.type == "Boolean" else "Int32" if v.type == "Int32" else "Float64"


def _start_of(plan: Plan, key: str, element: int) -> float:
    path, _, own = key.rpartition(".")
    c = next(c for c in plan.components if c.path == path)
    return float(np.ravel(c.start.get(own, c.description.variables[own].start))[element])


def _unit_of(plan: Plan, key: str, element: int) -> str:
    return resolved(plan, key).variable.unit_of_element(element) or "1"


def _file(policy: Policy) -> PolicyFile:
    def channels(named: Any) -> tuple[Channel, ...]:
        return tuple(Channel(n.name, n.low, n.high, n.unit) for n in named)

    return PolicyFile(
        Path(f"policy of {policy.task}"), policy.kind, policy.tensors,
        channels(policy.observation), channels(policy.action), policy.task, policy.options,
        policy.activation, policy.settings,
    )  # fmt: skip
