"""Grey-box model of a part of a system: one ODE from the components' declared expressions.

It holds the hull, the components with fitted parameters, and those on the shortest path from them
to the hull. All its other inputs are signals: recorded, or computed beforehand by declarations
from recorded signals. Values pass between its components without delay; the delays of the
communication steps are applied to the inputs instead, as a shift in time.

An unknown delay of commands and forces is a small one, by which w + delay dw moves each of them;
dw is an input too, the derivative by the delay. A current is added to that of the system, and a
bias to its output.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.studies.identification.assumptions import MEASURED, WATER
from uuvsim_cosim.studies.identification.parameters import HULL_STATES, Fitted, Part

__all__ = ["Feed", "GreyBox", "feed_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Feed:
    """An input of the ODE: an element of a component's output (or input, if nothing feeds it)."""

    component: int
    variable: str
    element: int
    factor: float = 1.0
    offset: float = 0.0
    delay: float = 0.0  # s by which the communication steps behind it delay it
    free: bool = False


def feed_of(plan: Plan, component: int, variable: str, element: int) -> Feed:
    """Return the output that an element of an input is connected to; else the input, `free`."""
    for t in plan.transfers:
        if (t.target, t.target_variable.name) == (component, variable) and (
            element in t.target_elements
        ):
            e = t.source_elements[t.target_elements.index(element)]
            return Feed(t.source, t.source_variable.name, e, t.factor, t.offset)
    return Feed(component, variable, element, free=True)


class GreyBox:
    """dx/dt = f(x, w, theta), y = h(x, w, theta): x of all parts, w the feeds, y eta and nu."""

    def __init__(self, plan: Plan, hull: int, fitted: Sequence[Fitted], exact: bool) -> None:
        self.plan, self.hull, self.fitted = plan, hull, list(fitted)
        self.tick = float(plan.tick) if exact else 0.0
        inside = self._inside({i for f in fitted for i, _ in f.places} | {hull})
        self.parts = {i: Part(plan, i) for i in inside}
        for part in self.parts.values():
            if part.model.of_kind("discrete") or part.model.clocks:
                raise InputInvalid(
                    f"{part.path} is sampled (it has clocks)",
                    "parameters of components in continuous time, as a hull or a thruster",
                )
            if part.calls:
                raise InputInvalid(
                    f"{part.path} ({part.source}) calls {', '.join(part.calls)}, which "
                    "is not fitted",
                    "equations and tables alone",
                )
        self.theta = ca.SX.sym("theta", len(self.fitted))
        self._names = {f.name: j for j, f in enumerate(self.fitted) if not f.places}
        self.delay = self._names.get("delay")  # its place in theta
        self.feeds: list[Feed] = []
        self._w: list[Any] = []
        self._dw: dict[int, Any] = {}  # of the feeds that an unknown delay moves
        self._outputs: dict[tuple[int, str], Any] = {}
        self._open: list[str] = []
        self._time = ca.SX.sym("t")
        states, rates = [], []
        self.x_places: dict[tuple[int, str], slice] = {}
        at = 0
        for i, part in self.parts.items():
            for v in part.model.of_kind("state"):
                self.x_places[i, v.name] = slice(at, at + v.size)
                at += v.size
                states.append(v.symbol)
                rates.append(self._closed(i, part.model.derivatives[v.name]))
        self.x = ca.vertcat(*states)
        y = ca.vertcat(*(self._output(hull, n) for n in ("eta", "nu")))
        for k, name in enumerate(MEASURED):
            if (j := self._names.get(f"bias_{name}")) is not None:
                y[k] += self.theta[j]
        nu_dot = self._output(hull, "nu_dot")
        symbols = [*self._w, *self._dw.values()]
        self.w = ca.vertcat(*symbols) if symbols else ca.SX(0, 1)
        arguments = [self.x, self.w, self.theta]
        zero = [self._time], [ca.SX(0)]
        self.f = ca.Function("f", arguments, ca.substitute([ca.vertcat(*rates)], *zero))
        self.h = ca.Function("h", arguments, ca.substitute([y], *zero))
        self.nu_dot = ca.Function("nu_dot", arguments, ca.substitute([nu_dot], *zero))
        self.h_max = min(p.model.h_max for p in self.parts.values())

    # ---- which components ---------------------------------------------------------------------

    def _inside(self, wanted: set[int]) -> list[int]:
        """Return the wanted components and those on a shortest path from each to the hull."""
        after: dict[int, set[int]] = {}
        for t in self.plan.transfers:
            after.setdefault(t.source, set()).add(t.target)
        self.hops: dict[int, int | None] = {self.hull: None}  # the next one towards the hull
        ring = {self.hull}
        while ring:
            reached = {i: after[i] & ring for i in after if i not in self.hops and after[i] & ring}
            self.hops |= {i: min(found) for i, found in reached.items()}
            ring = set(reached)
        inside = {self.hull}
        for i in wanted:
            if i not in self.hops:
                raise InputInvalid(
                    f"{self.plan.components[i].path} does not act on "
                    f"{self.plan.components[self.hull].path}",
                    "parameters of a component that does",
                )
            here: int | None = i
            while here is not None:
                inside.add(here)
                here = self.hops[here]
        return sorted(inside, key=lambda i: (i != self.hull, i))

    # ---- expressions --------------------------------------------------------------------------

    def _closed(self, i: int, expression: Any) -> Any:
        """Substitute parameters, derived values and inputs in an expression of a part."""
        part = self.parts[i]
        model, p = part.model, ca.SX(ca.DM(part.p))
        for j, fit in enumerate(self.fitted):
            for component, name in fit.places:
                if component == i and name not in part.inputs:
                    p[part.place(name)] = self.theta[j]
        d = part.f.derived.call([p], True, False)[0]
        symbols = [ca.vertcat(*(v.symbol for v in model.of_kind("parameter"))), model.t]
        values = [p, self._time]
        at = 0
        for v in model.of_kind("derived"):
            symbols.append(ca.vertcat(*v.symbol.nonzeros()))
            values.append(d[at : at + v.size])
            at += v.size
        closed = ca.substitute([ca.densify(ca.SX(expression))], symbols, values)[0]
        used = {s.element_hash() for s in ca.symvar(closed)}
        for v in model.of_kind("input"):
            elements = v.symbol.nonzeros()
            wanted = [e for e, s in enumerate(elements) if s.element_hash() in used]
            if wanted:
                closed = ca.substitute(
                    [closed],
                    [ca.vertcat(*(elements[e] for e in wanted))],
                    [ca.vertcat(*(self._fed(i, v.name, e) for e in wanted))],
                )[0]
        return closed

    def _output(self, i: int, name: str) -> Any:
        key = (i, name)
        if key not in self._outputs:
            label = f"{self.parts[i].path}.{name}"
            if label in self._open:
                raise InputInvalid(
                    f"{' -> '.join([*self._open, label])} is an algebraic loop",
                    "parameters of components that are not in an algebraic loop",
                )
            self._open.append(label)
            self._outputs[key] = self._closed(i, self.parts[i].model.variables[name].symbol)
            self._open.pop()
        return self._outputs[key]

    def _fed(self, i: int, name: str, element: int) -> Any:
        """Return the expression of an input's element: another part's output, or a feed."""
        for j, fit in enumerate(self.fitted):
            if (i, name) in fit.places:
                return self.theta[j]
        feed = feed_of(self.plan, i, name, element)
        if not feed.free and feed.component in self.parts:
            output = self._output(feed.component, feed.variable)
            return feed.factor * output[feed.element] + feed.offset
        # The output of a part with states is held for a step, which delays it by half a step on
        # average. A part without states passes on the inputs of the step before.
        delay, here = 0.0, i
        while (following := self.hops[here]) is not None and here in self.parts:
            delay += 0.5 if self.parts[here].model.of_kind("state") else 1.0
            here = following
        feed = replace(feed, delay=delay * self.tick)
        if feed not in self.feeds:
            if self.delay is not None and feed.variable not in WATER:
                self._dw[len(self.feeds)] = ca.SX.sym(f"dw_{len(self._w)}")
            self.feeds.append(feed)
            self._w.append(ca.SX.sym(f"w_{len(self._w)}"))
        k = self.feeds.index(feed)
        value = self._w[k]
        if self.delay is not None and k in self._dw:
            value = value + self.theta[self.delay] * self._dw[k]
        if (i, name) == (self.hull, "v_c"):
            of = self._names.get(f"current_{'NED'[element]}")
            value = value if of is None else value + self.theta[of]
        return value

    # ---- numbers ------------------------------------------------------------------------------

    def pieces(self, h: float) -> int:
        """Return into how many steps of Runge-Kutta a step of h seconds is divided."""
        longest = (5.0 if len(self.x_places) == len(HULL_STATES) else 2.5) * self.h_max
        return max(1, ceil(h / longest - 1e-9))

    def step(self, h: float, sloped: bool = False) -> Any:
        """Return x after h seconds by RK4 in pieces that the parts can bear, inputs held.

        `sloped` inputs are (2 n_w,): each one's mean over the step, then its change along it, so
        that neither impulse nor first moment of what changes within the step is lost.
        """
        pieces = self.pieces(h)
        n_w = self.w.numel()
        x = x_0 = ca.SX.sym("x", self.x.numel())
        w, theta = ca.SX.sym("w", (1 + sloped) * n_w), ca.SX.sym("theta", len(self.fitted))
        mean, change = w[:n_w], w[n_w:] if sloped else ca.SX(n_w, 1)
        d = h / pieces
        for i in range(pieces):
            begin, middle, end = (mean + ((i + s) / pieces - 0.5) * change for s in (0.0, 0.5, 1.0))
            k1 = self.f(x, begin, theta)
            k2 = self.f(x + d / 2 * k1, middle, theta)
            k3 = self.f(x + d / 2 * k2, middle, theta)
            k4 = self.f(x + d * k3, end, theta)
            x = x + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return ca.Function("step", [x_0, w, theta], [x])

    def start(self) -> Array:
        """Return the declared initial states."""
        parts = []
        for part in self.parts.values():
            d = part.f.derived(part.p)
            parts.append(np.array(part.f.initial(part.p, d)).ravel())
        return np.concatenate(parts)

    @property
    def delayed(self) -> tuple[int, ...]:
        """Return the feeds that an unknown delay moves."""
        return tuple(self._dw)

    def label(self, feed: Feed) -> str:
        """Return the name of a feed as a signal of a recording."""
        return f"{self.plan.components[feed.component].path}.{feed.variable}"
