"""A system of declarations as one map from a communication point to the next, with Jacobians.

State: each component's continuous and discrete states, and its outputs, as they are visible at a
communication point. A component whose step is longer than the tick has its outputs twice: those
that are visible, and those that become visible at the end of its step. Draws of noise are 0. A
hull's attitude is a quaternion of four numbers, so one pole of the map is not the vehicle's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from math import ceil, lcm
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource

__all__ = ["Link", "Part", "StepJacobian", "SystemMap"]

Array = NDArray[np.float64]
MOST_TICKS = 1000


class Part:
    """One component: its functions, its values, and where they are in the whole state."""

    def __init__(self, planned: PlannedComponent, place: int, task: str) -> None:
        source = resolve(planned.source)
        if not isinstance(source, ModelSource):
            raise InputInvalid(
                task,
                (
                    f"{planned.path} is {source.kind} ({planned.source}), whose "
                    "equations are not known"
                ),
                "declarations alone",
            )
        self.path, self.step_ticks = planned.path, planned.step_ticks
        self.model = source.declaration()
        self.f = Evaluation(self.model)
        known = {k: np.asarray(v, dtype=float) for k, v in planned.start.items()}
        own = {v.name for v in self.model.of_kind("parameter")}
        fed = {v.name for v in self.model.of_kind("input")}
        self.p = self.f.values_of("parameter", {k: v for k, v in known.items() if k in own})
        self.u_0 = self.f.values_of("input", {k: v for k, v in known.items() if k in fed})
        self.d = np.array(self.f.derived(self.p)).ravel()
        self.start = np.array(self.f.initial(self.p, self.d)).ravel()
        self.n_x = sum(v.size for v in self.model.of_kind("state"))
        self.n_z = len(self.start) - self.n_x
        self.at = place
        self.y_at = place + len(self.start)
        self.n_y = sum(v.size for v in self.model.of_kind("output"))
        self.next_at = self.y_at + self.n_y  # outputs that are not visible yet
        self.end = self.next_at + (self.n_y if self.step_ticks > 1 else 0)
        self.offset: dict[
            str, int
        ] = {}  # of a variable's first element among the inputs, or among the outputs
        for variables in (self.model.of_kind("input"), self.model.of_kind("output")):
            sizes = accumulate((v.size for v in variables), initial=0)
            self.offset |= dict(zip((v.name for v in variables), sizes, strict=False))

    def names(self, *causalities: Any) -> list[str]:
        """Return the names of all elements of variables of these kinds."""
        return [
            f"{self.path}.{n}"
            for v in self.model.of_kind(*causalities)
            for n in element_names(v.name, v.shape)
        ]

    def state_names(self) -> list[str]:
        """Return the names of all places of its state, in their order."""
        outputs = self.names("output")
        late = [f"{n} at the end of the step" for n in outputs] if self.step_ticks > 1 else []
        return [*self.names("state"), *self.names("discrete"), *outputs, *late]

    def due(self, k: int, tick: Fraction) -> tuple[tuple[Fraction, int], ...] | None:
        """Return the clocks that tick in the step from k, with the time since its begin.

        None means that no step of this component begins at k.
        """
        if k % self.step_ticks:
            return None
        now, end = k * tick, (k + self.step_ticks) * tick
        return tuple(
            sorted(
                (n * c.period - now, c.index)
                for c in self.model.clocks
                for n in range(ceil(now / c.period), ceil(end / c.period))
            )
        )

    def stepped(
        self, due: Sequence[tuple[Fraction, int]], tick: Fraction, t: Any, state: Any, u: Any
    ) -> Any:
        """Return states and outputs after the step from t, computed as `uuv_do_step` does."""
        p, d = (ca.SX(ca.DM(v)) if len(v) else ca.SX(0, 1) for v in (self.p, self.d))
        x = state[: self.n_x] if self.n_x else ca.SX(0, 1)
        z = state[self.n_x :] if self.n_z else ca.SX(0, 1)
        now, end = Fraction(0), self.step_ticks * tick
        for at, clock in [*due, (end, -1)]:
            if at > now and self.n_x:
                pieces = max(1, ceil(float(at - now) / self.model.h_max - 1e-6))
                h = (at - now) / pieces
                for i in range(pieces):
                    begin = t + float(now + i * h)
                    x = self.f.rk4.call([begin, float(h), u, u, u, p, d, x, z], True, False)[0]
            now = at
            if clock >= 0:
                w = ca.SX.zeros(sum(n.numel() for n in self.model.clocks[clock].draws))
                arguments = [t + float(at), u, p, d, x, z, w]
                z = self.f.updates[clock].call(arguments, True, False)[0]
        y = self.f.outputs.call([t + float(end), u, p, d, x, z], True, False)[0]
        return ca.vertcat(x, z, y)


@dataclass(frozen=True)
class Link:
    """One number that a connection carries: from `source` (place in the state) to an input."""

    owner: int  # index of the component of the source
    source: int
    target: int  # index of the component
    element: int  # of all inputs of the component
    factor: float
    offset: float


@dataclass(frozen=True)
class StepJacobian:
    """Derivatives of the state after a step, (n, n), (n, inputs) and (n, cut links) twice, sparse.

    `late` is the derivative by a cut link that carries a value of the communication point, `early`
    that by a cut link that carries a value of the same step (Gauss-Seidel).
    """

    A: Any
    B: Any
    late: Any
    early: Any


class SystemMap:
    """Map (t, x, u) of the whole state from one communication point to the next.

    `cut` are links that the Jacobian treats as open: the value at their end is an input.
    """

    def __init__(self, plan: Plan, task: str = "linearize") -> None:
        self.plan = plan
        self.task = task
        self.parts: list[Part] = []
        place = 0
        for planned in plan.components:
            self.parts.append(Part(planned, place, task))
            place = self.parts[-1].end
        self.size = place
        self.names = [n for p in self.parts for n in p.state_names()]
        self.outputs = [n for p in self.parts for n in p.names("output")]
        self.free: list[tuple[int, int]] = []  # component, element of its inputs
        self.inputs: list[str] = []
        for i, part in enumerate(self.parts):
            names = iter(part.names("input"))
            for v in part.model.of_kind("input"):
                for e in range(v.size):
                    name = next(names)
                    if e not in plan.connected.get((i, v.name), ()):
                        self.free.append((i, part.offset[v.name] + e))
                        self.inputs.append(name)
        for t in plan.transfers:
            if t.table:
                where = f"{self.parts[t.target].path}.{t.target_variable.name}"
                raise InputInvalid(task, f"{where} is fed through a table of values", "no table")
        self.links = [
            Link(
                t.source,
                self.parts[t.source].y_at + self.parts[t.source].offset[t.source_variable.name] + a,
                t.target,
                self.parts[t.target].offset[t.target_variable.name] + b,
                t.factor,
                t.offset,
            )
            for t in plan.transfers
            for a, b in zip(t.source_elements, t.target_elements, strict=True)
        ]
        self._into: dict[int, list[int]] = {}  # places in `links` by component
        for n, link in enumerate(self.links):
            self._into.setdefault(link.target, []).append(n)
        self.cut: tuple[int, ...] = ()  # places in `links`
        self.period = 1
        for part in self.parts:
            self.period = lcm(self.period, part.step_ticks)
            for clock in part.model.clocks:
                self.period = lcm(self.period, (clock.period / plan.tick).numerator)
        if self.period > MOST_TICKS:
            raise InputInvalid(
                task,
                f"clocks tick together only every {self.period} steps",
                f"at most {MOST_TICKS}: choose periods with a common multiple",
            )
        self._steps: dict[Any, Any] = {}
        self._jacobians: dict[Any, Any] = {}

    def start(self) -> tuple[Array, Array]:
        """Return the state at 0, with consistent outputs, and the unconnected inputs."""
        x = np.zeros(self.size)
        u = np.array([self.parts[i].u_0[e] for i, e in self.free])
        for part in self.parts:
            x[part.at : part.y_at] = part.start
        for _ in self.parts:  # each pass settles at least one more component of a chain
            for i, part in enumerate(self.parts):
                inputs = np.array(
                    ca.DM(ca.evalf(self._inputs(i, ca.SX(ca.DM(x)), ca.SX(ca.DM(u)))))
                ).ravel()
                state = (part.start[: part.n_x], part.start[part.n_x :])
                y = np.array(part.f.outputs(0.0, inputs, part.p, part.d, *state)).ravel()
                x[part.y_at : part.next_at] = y
        return x, u

    def advance(self, k: int, x: Array, u: Array) -> Array:
        """Return the state at tick k + 1 of that at tick k."""
        step = self.step(k)
        return np.array(step(float(k * self.plan.tick), x, u)).ravel()

    def trajectory(self, at: float) -> tuple[int, Array, Array]:
        """Return the first tick at or after `at` seconds, its state and the unconnected inputs."""
        if not 0 <= at < float("inf"):
            raise InputInvalid(self.task, f"at = {at} s", "0 or more")
        x, u = self.start()
        first = round(Fraction(repr(at)) / self.plan.tick)
        for k in range(first):
            x = self.advance(k, x, u)
        return first, x, u

    def jacobian(self, k: int, x: Array, u: Array) -> StepJacobian:
        """Return the Jacobian of the step from tick k, with the links of `cut` open."""
        phase = k % self.period
        key = (self._due(phase), self.cut)
        if key not in self._jacobians:
            t, before, free = ca.SX.sym("t"), ca.SX.sym("x", self.size), ca.SX.sym("u", len(u))
            late, early = (ca.SX.sym(n, len(self.cut)) for n in ("late", "early"))
            new = self._stepped(phase, t, before, free, (late, early))
            by = (before, free, late, early)
            both = [ca.jacobian(new, v) for v in by]
            self._jacobians[key] = ca.Function("jacobian", [t, before, free, late, early], both)
        places = [self.links[n].source for n in self.cut]
        after = self.advance(k, x, u) if places else x
        values = (float(k * self.plan.tick), x, u, x[places], after[places])
        found = [j.sparse() for j in self._jacobians[key](*values)]
        if not all(np.all(np.isfinite(j.data)) for j in found):
            at = f"{float(k * self.plan.tick):g} s"
            raise InputInvalid(f"{self.task}: the derivatives after {at} are not finite")
        return StepJacobian(*found)

    def hops(self, i: int) -> int:
        """Return the connections between a component and the nearest one with states; 0: itself.

        Connections whose value is of the same step (Gauss-Seidel) are counted too.
        """
        seen, near = {i}, {i}
        for count in range(len(self.parts)):
            if any(self.parts[j].n_x for j in near):
                return count
            near = {link.target for link in self.links if link.owner in near} - seen
            seen |= near
        return 0

    def _due(self, phase: int) -> tuple[Any, ...]:
        """Return what distinguishes the step of a phase: clocks that tick, steps that end."""
        return tuple(
            (part.due(phase, self.plan.tick), (phase + 1) % part.step_ticks == 0)
            for part in self.parts
        )

    def step(self, k: int) -> Any:
        """Return the function (t, x, u) -> x of the step from tick k."""
        phase = k % self.period
        key = self._due(phase)
        if key not in self._steps:
            t, x = ca.SX.sym("t"), ca.SX.sym("x", self.size)
            u = ca.SX.sym("u", len(self.free))
            new = self._stepped(phase, t, x, u)
            self._steps[key] = ca.Function("step", [t, x, u], [new])
        return self._steps[key]

    def _stepped(
        self, phase: int, t: Any, x: Any, u: Any, opened: Sequence[Any] | None = None
    ) -> Any:
        """Return the state after the step; `opened` are the late and early values of cut links."""
        new = [x[p.at : p.next_at] for p in self.parts]  # states and visible outputs
        after = [x[p.next_at : p.end] for p in self.parts]
        for group in self.plan.groups:
            if group.algorithm == "iterated":
                named = ", ".join(self.parts[i].path for i in group.members)
                raise InputInvalid(self.task, f"{named} are iterated", "Jacobi or in order")
            fresh: dict[int, Any] = {}  # outputs of this step that later members get
            for i in group.members:
                part, due = self.parts[i], self.parts[i].due(phase, self.plan.tick)
                if due is None:
                    continue
                values = {}
                for n in self._into.get(i, ()):
                    link = self.links[n]
                    source = self.parts[link.owner]
                    early = link.owner in fresh and source.step_ticks <= part.step_ticks
                    if opened is not None and n in self.cut:
                        values[n] = opened[early][self.cut.index(n)]
                    elif early:
                        values[n] = fresh[link.owner][link.source - source.y_at]
                inputs = self._inputs(i, x, u, values)
                n_s = part.y_at - part.at
                stepped = part.stepped(due, self.plan.tick, t, x[part.at : part.y_at], inputs)
                if group.algorithm == "gauss-seidel":
                    fresh[i] = stepped[n_s:]
                if part.step_ticks == 1:
                    new[i] = stepped
                else:  # its outputs are visible at the end of its step
                    new[i], after[i] = ca.vertcat(stepped[:n_s], new[i][n_s:]), stepped[n_s:]
        for i, part in enumerate(self.parts):
            if part.step_ticks > 1 and (phase + 1) % part.step_ticks == 0:
                new[i] = ca.vertcat(new[i][: part.y_at - part.at], after[i])
        return ca.vertcat(*(piece for both in zip(new, after, strict=True) for piece in both))

    def _inputs(self, i: int, x: Any, u: Any, replaced: Mapping[int, Any] | None = None) -> Any:
        """Return a component's inputs: start values, free inputs `u`, and transfers from `x`."""
        part = self.parts[i]
        inputs = ca.SX(ca.DM(part.u_0)) if len(part.u_0) else ca.SX(0, 1)
        for n, (j, element) in enumerate(self.free):
            if j == i:
                inputs[element] = u[n]
        for n in self._into.get(i, ()):
            link = self.links[n]
            value = (replaced or {}).get(n, x[link.source])
            inputs[link.element] = link.factor * value + link.offset
        return inputs
