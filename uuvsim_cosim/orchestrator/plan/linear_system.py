"""Linear model of a system of declarations, from the Jacobian of one communication step.

State: each component's continuous and discrete states, and its outputs, as they are visible at a
communication point. If clocks are slower than the tick, one sample of the linear model is the
shortest time after which all of them tick again; inputs are held during it. Draws of noise are 0.
A hull's attitude is a quaternion of four numbers, so one of its poles is not the vehicle's.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import accumulate
from math import ceil, lcm
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.analysis.linearize import state_space
from uuvsim_cosim.models.declaration.element_names import element_names
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    import control

__all__ = ["linear_system"]

Array = NDArray[np.float64]
MOST_TICKS = 1000


def linear_system(
    system: System,
    at: float,
    *,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> control.StateSpace:
    """Linearise a system around its own trajectory, at `at` seconds; see `running/linearize.py`."""
    if not at >= 0:
        raise InputInvalid("linearize", f"at = {at} s", "0 or more")
    m = _Map(flatten(system))
    x, u = m.start()
    first = round(Fraction(repr(at)) / m.plan.tick)
    for k in range(first):
        x = np.array(m.step(k)(x, u)).ravel()
    A, B = np.eye(len(x)), np.zeros((len(x), len(u)))
    for k in range(first, first + m.period):
        A_k, B_k = (np.array(j) for j in m.jacobian(k)(x, u))
        A, B = A_k @ A, A_k @ B + B_k
        x = np.array(m.step(k)(x, u)).ravel()
    if not (np.all(np.isfinite(A)) and np.all(np.isfinite(B))):
        raise InputInvalid(f"linearize: {system.name}: the derivatives after {at} s are not finite")
    places = [m.names.index(n) for n in m.outputs]
    C = np.eye(len(x))[places]
    D = np.zeros((len(places), len(u)))
    dt = float(m.period * m.plan.tick)
    return state_space((A, B, C, D), m.names, m.inputs, m.outputs, system.name, inputs, outputs, dt)


class _Part:
    """One component: its functions, its values, and where they are in the whole state."""

    def __init__(self, planned: PlannedComponent, place: int) -> None:
        source = resolve(planned.source)
        if not isinstance(source, ModelSource):
            raise InputInvalid(
                "linearize",
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
        self.end = self.y_at + sum(v.size for v in self.model.of_kind("output"))
        self.offset: dict[
            str, int
        ] = {}  # of a variable's first element among the inputs, or among the outputs
        for variables in (self.model.of_kind("input"), self.model.of_kind("output")):
            sizes = accumulate((v.size for v in variables), initial=0)
            self.offset |= dict(zip((v.name for v in variables), sizes, strict=False))

    def names(self, *causalities: Any) -> list[str]:
        return [
            f"{self.path}.{n}"
            for v in self.model.of_kind(*causalities)
            for n in element_names(v.name, v.shape)
        ]

    def stepped(self, k: int, tick: Fraction, state: Any, u: Any) -> Any:
        """Return states and outputs after the step from k, computed as `uuv_do_step` does."""
        p, d = (ca.SX(ca.DM(v)) if len(v) else ca.SX(0, 1) for v in (self.p, self.d))
        x = state[: self.n_x] if self.n_x else ca.SX(0, 1)
        z = state[self.n_x :] if self.n_z else ca.SX(0, 1)
        now, end = k * tick, (k + self.step_ticks) * tick
        ticks = sorted(
            (n * c.period, c.index)
            for c in self.model.clocks
            for n in range(ceil(now / c.period), ceil(end / c.period))
        )
        for due, clock in [*ticks, (end, -1)]:
            if due > now and self.n_x:
                pieces = max(1, ceil(float(due - now) / self.model.h_max - 1e-6))
                h = (due - now) / pieces
                for i in range(pieces):
                    t = float(now + i * h)
                    x = self.f.rk4.call([t, float(h), u, u, u, p, d, x, z], True, False)[0]
            now = due
            if clock >= 0:
                w = ca.SX.zeros(sum(n.numel() for n in self.model.clocks[clock].draws))
                z = self.f.updates[clock].call([float(due), u, p, d, x, z, w], True, False)[0]
        y = self.f.outputs.call([float(end), u, p, d, x, z], True, False)[0]
        return ca.vertcat(x, z, y)


class _Map:
    """Map of the whole state from one communication point to the next, and its Jacobian."""

    def __init__(self, plan: Plan) -> None:
        self.plan = plan
        self.parts: list[_Part] = []
        place = 0
        for planned in plan.components:
            self.parts.append(_Part(planned, place))
            place = self.parts[-1].end
        self.size = place
        self.names = [n for p in self.parts for n in p.names("state", "discrete", "output")]
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
        self.period = 1
        for part in self.parts:
            self.period = lcm(self.period, part.step_ticks)
            for clock in part.model.clocks:
                self.period = lcm(self.period, (clock.period / plan.tick).numerator)
        if self.period > MOST_TICKS:
            raise InputInvalid(
                "linearize",
                f"clocks tick together only every {self.period} steps",
                f"at most {MOST_TICKS}: choose periods with a common multiple",
            )
        self._steps: dict[int, Any] = {}
        self._jacobians: dict[int, Any] = {}

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
                x[part.y_at : part.end] = y
        return x, u

    def step(self, k: int) -> Any:
        """Return the function  (x, u) -> x  of tick k."""
        phase = k % self.period
        if phase in self._steps:
            return self._steps[phase]
        x, u = ca.SX.sym("x", self.size), ca.SX.sym("u", len(self.free))
        new = [x[p.at : p.end] for p in self.parts]
        for group in self.plan.groups:
            if group.algorithm == "iterated":
                named = ", ".join(self.parts[i].path for i in group.members)
                raise InputInvalid("linearize", f"{named} are iterated", "Jacobi or in order")
            seen = x
            for i in group.members:
                part = self.parts[i]
                if phase % part.step_ticks:
                    continue
                inputs = self._inputs(i, seen, u)
                new[i] = part.stepped(phase, self.plan.tick, x[part.at : part.y_at], inputs)
                if group.algorithm == "gauss-seidel":  # later members get the new outputs
                    done = {j: new[j] for j in group.members[: group.members.index(i) + 1]}
                    seen = ca.vertcat(*(done.get(j, x[p.at : p.end])
                                        for j, p in enumerate(self.parts)))  # fmt: skip
        self._steps[phase] = ca.Function("step", [x, u], [ca.vertcat(*new)])
        return self._steps[phase]

    def jacobian(self, k: int) -> Any:
        """Return the function  (x, u) -> (A, B)  of tick k."""
        phase = k % self.period
        if phase not in self._jacobians:
            x, u = ca.SX.sym("x", self.size), ca.SX.sym("u", len(self.free))
            new = self.step(k).call([x, u], True, False)[0]
            both = [ca.densify(ca.jacobian(new, by)) for by in (x, u)]
            self._jacobians[phase] = ca.Function("jacobian", [x, u], both)
        return self._jacobians[phase]

    def _inputs(self, i: int, x: Any, u: Any) -> Any:
        """Return a component's inputs: start values, free inputs `u`, and transfers from `x`."""
        part = self.parts[i]
        inputs = ca.SX(ca.DM(part.u_0)) if len(part.u_0) else ca.SX(0, 1)
        for n, (j, element) in enumerate(self.free):
            if j == i:
                inputs[element] = u[n]
        for t in self.plan.transfers:
            if t.target != i:
                continue
            source = self.parts[t.source]
            for a, b in zip(t.source_elements, t.target_elements, strict=True):
                value = x[source.y_at + source.offset[t.source_variable.name] + a]
                place = part.offset[t.target_variable.name] + b
                inputs[place] = t.factor * value + t.offset
        return inputs
