"""The part of a system that is fitted: one ODE, made of the components' own declared expressions.

It holds the hull, the components whose parameters are wanted, and those on the shortest way from
them to the hull. Every other value that it reads is a signal: recorded, or computed beforehand by
declarations from recorded signals. Between its components values pass at once; what the
communication steps delay is put on the inputs instead, as a shift in time.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from fnmatch import fnmatchcase
from math import ceil
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.evaluation import Evaluation
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.orchestrator.plan import Plan
from uuvsim_cosim.orchestrator.sources import ModelSource, resolve

__all__ = ["Feed", "Fitted", "GreyBox", "Part", "wanted_parameters"]

Array = NDArray[np.float64]
HULL_STATES = ("p", "q_nb", "nu_b")


@dataclass(frozen=True)
class Fitted:
    """One number to fit: the name to show, its places, where it starts, its unit and bounds."""

    name: str
    places: tuple[tuple[int, str], ...]  # component, parameter: all of them get this number
    start: float
    unit: str
    low: float
    high: float


class Part:
    """A component of the plan that is a declaration, with the system's own values."""

    def __init__(self, plan: Plan, index: int) -> None:
        planned = plan.components[index]
        source = resolve(planned.source)
        if not isinstance(source, ModelSource):
            raise InputInvalid(
                f"{planned.path} is {planned.description.kind} ({planned.source}), "
                "whose equations are "
                "not known; expected a declaration (model:…) in what is identified"
            )
        self.index, self.path = index, planned.path
        self.source = source.text
        self.model: Model = source.declare()
        self.f = Evaluation(self.model)
        start = {k: np.asarray(v, dtype=float).ravel() for k, v in planned.start.items()}
        known = {v.name for v in self.model.of_kind("parameter")}
        self.p = self.f.values_of("parameter", {k: v for k, v in start.items() if k in known})
        self.inputs = {
            v.name: np.asarray(start.get(v.name, v.start), dtype=float).ravel()
            for v in self.model.of_kind("input")
        }

    @property
    def is_hull(self) -> bool:
        """Say whether it has the states that every hull has."""
        return {v.name for v in self.model.of_kind("state")} >= set(HULL_STATES)

    @property
    def has_tables(self) -> bool:
        """Say whether its equations call tables: they are slow, and of the first order only."""
        return any(
            f.instruction_id(k) == ca.OP_CALL
            for f in (self.f.rhs, self.f.outputs)
            for k in range(f.n_instructions())
        )

    def place(self, parameter: str) -> int:
        """Give where a parameter begins in `p`."""
        at = 0
        for v in self.model.of_kind("parameter"):
            if v.name == parameter:
                return at
            at += v.size
        raise KeyError(parameter)


def wanted_parameters(plan: Plan, hull: int, texts: Sequence[str]) -> list[Fitted]:
    """Find the parameters that texts name: ``D_q_11`` (the hull's), ``hull.m``, ``thruster_*.K_n``.

    A pattern with a * is one number that all of its places share. Raises InputInvalid with all
    that are unknown, and near names.
    """
    names: dict[str, tuple[int, str]] = {}
    parts: dict[int, Part] = {}
    sizes: dict[str, int] = {}
    for i, c in enumerate(plan.components):
        for v in c.description.of("parameter"):
            names[f"{c.path}.{v.name}"] = (i, v.name)
            sizes[f"{c.path}.{v.name}"] = int(np.prod(v.shape, dtype=int))
    wrong, found = [], []
    taken: set[str] = set()
    for text in dict.fromkeys(t.strip() for t in texts if t.strip()):
        full = text if "." in text else f"{plan.components[hull].path}.{text}"
        hits = [n for n in names if n == full or ("*" in full and fnmatchcase(n, full))]
        if not hits:
            near = get_close_matches(full, names, n=4, cutoff=0.5)
            wrong.append(
                f"there is no parameter {text!r}; expected {', '.join(near) or 'component.name'}"
            )
            continue
        wide = [n for n in hits if sizes[n] != 1]
        if wide or taken & set(hits):
            wrong.append(
                f"{wide[0]} has {sizes[wide[0]]} elements; expected a parameter that is one number"
                if wide
                else f"{text}: {', '.join(sorted(taken & set(hits)))} is named twice; expected once"
            )
            continue
        taken |= set(hits)
        for n in hits:
            parts.setdefault(names[n][0], Part(plan, names[n][0]))
        places = tuple(names[n] for n in hits)
        part = parts[places[0][0]]
        declared = part.model.variables[places[0][1]]
        starts = [float(parts[i].p[parts[i].place(n)]) for i, n in places]
        low, high = _bounds(declared, float(np.mean(starts)))
        found.append(Fitted(full, places, float(np.mean(starts)), declared.unit, low, high))
    if not found and not wrong:
        wrong = ["no parameters; expected names such as D_q_11,M_A_11,thruster_*.K_n"]
    if wrong:
        raise InputInvalid("--parameters: " + "; ".join(wrong))
    return found


def _bounds(declared: Any, start: float) -> tuple[float, float]:
    """Give what is declared, and for what cannot be negative a fiftieth to thirty times the start.

    Without an end, what the data say nothing of could grow until no step is short enough.
    """
    low = -np.inf if declared.min is None else float(declared.min)
    high = np.inf if declared.max is None else float(declared.max)
    kind, _, indices = declared.name.rpartition("_")
    brakes = kind in ("M_A", "D_l", "D_q", "D_u", "I_g", "I_b") and len(set(indices)) == 1
    if brakes:
        low = max(low, 0.0)
    if start > 0 and (brakes or low >= 0.0):
        return max(low, 0.02 * start), min(high, 30.0 * start)
    return low, high


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
                    f"{part.path} is sampled (it has clocks); expected parameters of components in "
                    "continuous time, as a hull or a thruster"
                )
            if part.has_tables:
                raise InputInvalid(
                    f"{part.path} ({part.source}) holds tables, which are not fitted; expected "
                    f"equations alone, as with --replace {part.path}=model:thruster"
                )
        self.theta = ca.SX.sym("theta", len(self.fitted))
        self.feeds: list[Feed] = []
        self._w: list[Any] = []
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
        rates_ = ca.vertcat(*rates)
        nu_dot = self._output(hull, "nu_dot")
        self.w = ca.vertcat(*self._w) if self._w else ca.SX(0, 1)
        arguments = [self.x, self.w, self.theta]
        zero = [self._time], [ca.SX(0)]
        self.f = ca.Function("f", arguments, ca.substitute([rates_], *zero))
        self.h = ca.Function("h", arguments, ca.substitute([y], *zero))
        self.nu_dot = ca.Function("nu_dot", arguments, ca.substitute([nu_dot], *zero))
        self.h_max = min(p.model.h_max for p in self.parts.values())

    # ---- which components ---------------------------------------------------------------------

    def _inside(self, wanted: set[int]) -> list[int]:
        """Give the wanted components and those on a shortest way from each to the hull."""
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
                    f"{self.plan.components[self.hull].path}; expected parameters of what does"
                )
            here: int | None = i
            while here is not None:
                inside.add(here)
                here = self.hops[here]
        return sorted(inside, key=lambda i: (i != self.hull, i))

    def _delay(self, component: int) -> float:
        """Give what passing on by communication steps delays, from a part's inputs to the hull's.

        A value that a state makes is held for a step, half of one on average; a part without
        states passes on what it read a step ago.
        """
        delay, here = 0.0, component
        while (following := self.hops[here]) is not None and here in self.parts:
            if self.parts[here].model.of_kind("state"):
                delay += 0.5
            else:
                delay += 1.0
            here = following
        return delay * self.tick

    # ---- expressions --------------------------------------------------------------------------

    def _closed(self, i: int, expression: Any) -> Any:
        """Put parameters, derived values and what feeds the inputs into a part's expression."""
        part = self.parts[i]
        p = ca.SX(ca.DM(part.p))
        for j, fit in enumerate(self.fitted):
            for component, name in fit.places:
                if component == i:
                    p[part.place(name)] = self.theta[j]
        d = part.f.derived.call([p], True, False)[0]
        model = part.model
        symbols = [ca.vertcat(*(v.symbol for v in model.of_kind("parameter")))]
        values = [p]
        at = 0
        for v in model.of_kind("derived"):
            symbols.append(ca.vertcat(*v.symbol.nonzeros()))
            values.append(d[at : at + v.size])
            at += v.size
        symbols.append(model.t)
        values.append(self._time)
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
                    f"{' -> '.join([*self._open, label])} is an algebraic loop; expected "
                    "parameters "
                    "of components that do not read each other at once"
                )
            self._open.append(label)
            self._outputs[key] = self._closed(i, self.parts[i].model.variables[name].symbol)
            self._open.pop()
        return self._outputs[key]

    def _fed(self, i: int, name: str, element: int) -> Any:
        """Give the expression of an input's element: another part's output, or a feed."""
        part = self.parts[i]
        for t in self.plan.transfers:
            if t.target == i and t.target_variable.name == name and element in t.target_elements:
                e = t.source_elements[t.target_elements.index(element)]
                if t.source in self.parts:
                    return t.factor * self._output(t.source, t.source_variable.name)[e] + t.offset
                feed = Feed(t.source, t.source_variable.name, e, t.factor, t.offset, self._delay(i))
                return self._symbol(feed)
        return self._symbol(Feed(part.index, name, element, free=True, delay=self._delay(i)))

    def _symbol(self, feed: Feed) -> Any:
        if feed not in self.feeds:
            self.feeds.append(feed)
            self._w.append(ca.SX.sym(f"w_{len(self._w)}"))
        return self._w[self.feeds.index(feed)]

    # ---- numbers ------------------------------------------------------------------------------

    def step(self, h: float) -> Any:
        """Give x after h seconds, inputs held, by RK4 in pieces that the parts can bear."""
        longest = (5.0 if len(self.x_places) == len(HULL_STATES) else 2.5) * self.h_max
        pieces = max(1, ceil(h / longest - 1e-9))
        x = x_0 = ca.SX.sym("x", self.x.numel())
        w, theta = ca.SX.sym("w", self.w.numel()), ca.SX.sym("theta", len(self.fitted))
        d = h / pieces
        for _ in range(pieces):
            k1 = self.f(x, w, theta)
            k2 = self.f(x + d / 2 * k1, w, theta)
            k3 = self.f(x + d / 2 * k2, w, theta)
            k4 = self.f(x + d * k3, w, theta)
            x = x + d / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return ca.Function("step", [x_0, w, theta], [x])

    def start(self) -> Array:
        """Give every state's own start."""
        parts = []
        for part in self.parts.values():
            d = part.f.derived(part.p)
            parts.append(np.array(part.f.initial(part.p, d)).ravel())
        return np.concatenate(parts)

    def label(self, feed: Feed) -> str:
        """Give the name of a feed as a signal of a recording."""
        return f"{self.plan.components[feed.component].path}.{feed.variable}"
