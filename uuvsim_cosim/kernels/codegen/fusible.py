"""Conditions on a plan for a kernel: all components are declarations, all clocks on the tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import ceil

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.codegen.equations import Equations, equations
from uuvsim_cosim.kernels.codegen.outline import Outline, outline_of
from uuvsim_cosim.orchestrator.plan.plan import Plan, Transfer
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import ModelSource

__all__ = ["Cut", "Fused", "Member", "fused_of"]

HEADER = 3  # words: tick, failed, tick of the failure (fmus/kernels/uuv_lane_steps.h)


@dataclass(frozen=True)
class Cut:
    """Part of a longer communication step: these clocks tick at its begin; then it is integrated.

    `begin` and `end` are ticks from the step's start, `pieces` Runge-Kutta steps between them.
    """

    begin: int
    end: int
    clocks: tuple[int, ...]
    pieces: int


@dataclass(frozen=True)
class Member:
    """A component of the plan in a kernel; `cell` is the first of its block of values."""

    path: str
    source: str
    declaration: int  # index into Fused.sources
    layout: Outline
    cell: int
    start_cell: int  # first of its start values, which are all before the derived values
    periods: tuple[int, ...]  # of each clock: index into Fused.periods
    rate: int  # of its communication step: index into Fused.periods, or -1 if it is a tick
    cuts: tuple[Cut, ...]

    @property
    def n_start(self) -> int:
        """Return the number of its start values: time, inputs, parameters."""
        return self.layout.offset["derived"]

    @property
    def pending(self) -> int:
        """Return the cell of its first pending output, if its step is longer than a tick."""
        return self.cell + self.layout.size

    @property
    def size(self) -> int:
        """Return the number of its cells."""
        return self.layout.size + (self.layout.count["output"] if self.rate >= 0 else 0)

    def is_seed(self, name: str) -> bool:
        """Return whether a variable is the key of its draws: two integers of 32 bits."""
        v = self.layout.value(name)
        return (
            name == "seed"
            and v is not None
            and (v.kind, v.type, v.shape) == ("parameter", "Int32", (2,))
        )


@dataclass(frozen=True)
class Fused:
    """A plan with its declarations, and the place of every value in a block of lanes."""

    plan: Plan
    declarations: Mapping[str, tuple[ModelSource, Outline]]  # by source
    members: tuple[Member, ...]
    periods: tuple[int, ...]  # of clocks and longer communication steps, in ticks
    cells_a_word: int  # 64-bit integers take two cells of float32

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Return the distinct declarations, each of which is compiled once."""
        return tuple(self.declarations)

    @cached_property
    def equations(self) -> Mapping[str, Equations]:
        """Return the equations of each source; a kernel alone does not need them."""
        return {text: equations(s.declare()) for text, (s, _) in self.declarations.items()}

    @cached_property
    def index(self) -> Mapping[str, int]:
        """Return each component's place in `members` by its path."""
        return {m.path: i for i, m in enumerate(self.members)}

    @property
    def n_words(self) -> int:
        """Return the number of 64-bit integers at the beginning of a block."""
        return HEADER + 2 * len(self.periods)

    @cached_property
    def n_cells(self) -> int:
        """Return the number of cells of a block, rounded up to whole words."""
        last = self.members[-1]
        return -(-(last.cell + last.size) // self.cells_a_word) * self.cells_a_word

    @property
    def n_moved(self) -> int:
        """Return the number of cells besides parameters, which a step may change."""
        fixed = sum(m.layout.count["parameter"] + m.layout.count["derived"] for m in self.members)
        return self.n_cells - fixed

    @property
    def n_start(self) -> int:
        """Return the number of start values of a block."""
        last = self.members[-1]
        return last.start_cell + last.n_start

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Return the components in stepping order."""
        return tuple(i for group in self.plan.groups for i in group.members)

    def is_early(self, t: Transfer) -> bool:
        """Return whether the target gets the source's output of the same step."""
        components = self.plan.components
        if components[t.source].step_ticks > components[t.target].step_ticks:
            return False
        source, target = self._places[t.source], self._places[t.target]
        if source[0] != target[0] or self.plan.groups[source[0]].algorithm != "gauss-seidel":
            return False
        return source[1] < target[1]

    @cached_property
    def _places(self) -> Mapping[int, tuple[int, int]]:
        """Return each component's group and its place in the group."""
        return {
            i: (g, place)
            for g, group in enumerate(self.plan.groups)
            for place, i in enumerate(group.members)
        }

    def early_into(self, i: int) -> list[Transfer]:
        """Return the transfers into a component that are made just before it steps."""
        return [t for t in self.plan.to_component.get(i, ()) if self.is_early(t)]

    def name_of(self, cell: int) -> tuple[str, str]:
        """Return the variable of a cell, "eta[2]", and the path of its component."""
        m = next(m for m in reversed(self.members) if m.cell <= cell)
        offset = cell - m.cell
        if offset >= m.layout.size:  # an output that is not visible yet
            offset += m.layout.offset["output"] - m.layout.size
        v = next(v for v in reversed(m.layout.values) if v.offset <= offset)
        element = f"[{offset - v.offset + 1}]" if v.shape else ""
        return f"{v.name}{element}", m.path


def fused_of(plan: Plan, cells_a_word: int = 1) -> Fused:
    """Return the plan with its declarations; raises SystemInvalid if it cannot be fused."""
    problems: list[Problem] = []
    sources_of_plan: dict[str, ModelSource] = {}
    for c in plan.components:
        source = resolve(c.source)
        if isinstance(source, ModelSource):
            sources_of_plan[c.source] = source
            continue
        a = {"FMU": "an FMU", "Python": "a Python component"}.get(source.kind, source.kind)
        if plan.components.index(c) in plan.event_group_of:
            a = "an FMU that uses Event Mode"
        problems.append(
            Problem(
                c.path,
                f"{a}, {c.source}, in a kernel",
                "a declaration (model:…); the master runs all others",
            )
        )
    if problems:
        raise SystemInvalid(problems)
    declarations = {text: (s, outline_of(s)) for text, s in sources_of_plan.items()}
    found = {text: outline for text, (_, outline) in declarations.items()}
    if plan.variable is not None:
        read = f"of variable length ({plan.variable.step.text()})"
        problems.append(Problem("communication step", read, "a fixed step, which kernels have"))
    if plan.start:
        start = f"{float(plan.start):g} s"
        problems.append(Problem("start time", start, "0 s, where a kernel begins"))
    problems += [*_component_problems(plan, found), *_plan_problems(plan)]
    if problems:
        raise SystemInvalid(problems)
    clocks = {int(period / plan.tick) for e in found.values() for _, period in e.periods}
    rates = {c.step_ticks for c in plan.components} - {1}
    periods = tuple(sorted(clocks | rates))
    members: list[Member] = []
    place = {text: i for i, text in enumerate(found)}
    cell, start_cell = (HEADER + 2 * len(periods)) * cells_a_word, 0
    for c in plan.components:
        layout = found[c.source]
        of_clocks = [int(period / plan.tick) for _, period in layout.periods]
        member = Member(
            path=c.path,
            source=c.source,
            declaration=place[c.source],
            layout=layout,
            cell=cell,
            start_cell=start_cell,
            periods=tuple(map(periods.index, of_clocks)),
            rate=-1 if c.step_ticks == 1 else periods.index(c.step_ticks),
            cuts=tuple(_cuts(plan.tick, layout.h_max, c.step_ticks, of_clocks)),
        )
        members.append(member)
        cell += member.size
        start_cell += member.n_start
    return Fused(plan, declarations, tuple(members), periods, cells_a_word)


def _cuts(tick: Fraction, h_max: float, ticks: int, periods: list[int]) -> Iterator[Cut]:
    """Cut a communication step at the sample instants inside it."""
    at = {0, *(k for p in periods for k in range(0, ticks, p))}
    for begin, end in pairwise([*sorted(at), ticks]):
        clocks = tuple(i for i, p in enumerate(periods) if begin % p == 0)
        # As in uuv_runtime.c: rounding must not add a sub-step to a whole number of them.
        pieces = max(1, ceil(float((end - begin) * tick) / h_max - 1e-6))
        yield Cut(begin, end, clocks, pieces)


def _component_problems(plan: Plan, found: Mapping[str, Outline]) -> Iterator[Problem]:
    """Yield the components with an optimiser, and the clocks that do not fit their step."""
    for c in plan.components:
        if found[c.source].optimises:
            yield Problem(
                c.path,
                f"an optimiser, {c.source}, in a kernel",
                "a law in closed form such as lqr; the master and FMUs run optimisers",
            )
    for c in plan.components:
        step = c.step_ticks * plan.tick
        for name, period in found[c.source].periods:
            what = f"clock {name!r} with a period of {period} s in a kernel"
            if (period / plan.tick).denominator != 1:
                expected = f"a whole multiple of the communication step, {plan.tick} s"
                yield Problem(c.path, what, expected)
            elif 1 not in ((period / step).denominator, (step / period).denominator):
                expected = f"a whole multiple of its communication step, {step} s, or a whole part"
                yield Problem(c.path, what, expected)


def _plan_problems(plan: Plan) -> Iterator[Problem]:
    """Yield iterated groups, algebraic loops, and connections that only the master converts."""
    for group in plan.groups:
        if group.algorithm not in ("jacobi", "gauss-seidel"):
            yield Problem(
                ", ".join(plan.components[i].path for i in group.members),
                f"an {group.algorithm} group in a kernel",
                "Jacobi or Gauss-Seidel; the master iterates",
            )
    for entry in plan.initialization:
        if len(entry) > 1:
            paths = ", ".join(dict.fromkeys(plan.components[i].path for i in entry))
            yield Problem(
                paths,
                "an algebraic loop in initialization, in a kernel",
                "none; the master solves loops",
            )
    for t in plan.transfers:
        kinds = {t.source_variable.type, t.target_variable.type}
        if t.table:
            yield Problem(
                f"{plan.components[t.target].path}.{t.target_variable.name}",
                "a table of values at its connection, in a kernel",
                "none; the master looks values up",
            )
        changed = (t.factor, t.offset) != (1.0, 0.0)
        if changed and kinds != {"Float64"}:
            yield Problem(
                f"{plan.components[t.target].path}.{t.target_variable.name}",
                f"factor {t.factor} and offset {t.offset} between {' and '.join(sorted(kinds))}",
                "no conversion of whole numbers in a kernel",
            )
