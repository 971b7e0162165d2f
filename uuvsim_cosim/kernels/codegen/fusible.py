"""Conditions on a plan for a kernel: all components are declarations, all clocks on the tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from math import ceil

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.codegen.equations import Equations, Layout, equations
from uuvsim_cosim.fmus.codegen.optimiser_code import optimisers_of
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
    layout: Layout
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
        v = self.layout.model.variables.get(name)
        return (
            name == "seed"
            and v is not None
            and (v.kind, v.type, v.shape) == ("parameter", "Int32", (2,))
        )


@dataclass(frozen=True)
class Fused:
    """A plan with its declarations, and the place of every value in a block of lanes."""

    plan: Plan
    equations: Mapping[str, Equations]  # by source
    members: tuple[Member, ...]
    periods: tuple[int, ...]  # of clocks and longer communication steps, in ticks
    cells_a_word: int  # 64-bit integers take two cells of float32

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Return the distinct declarations, each of which is compiled once."""
        return tuple(self.equations)

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
        for group in self.plan.groups:
            if t.source in group.members and t.target in group.members:
                before = group.members.index(t.source) < group.members.index(t.target)
                return group.algorithm == "gauss-seidel" and before
        return False

    def name_of(self, cell: int) -> tuple[str, str]:
        """Return the variable of a cell, "eta[2]", and the path of its component."""
        m = next(m for m in reversed(self.members) if m.cell <= cell)
        offset = cell - m.cell
        if offset >= m.layout.size:  # an output that is not visible yet
            offset += m.layout.offset["output"] - m.layout.size
        p = next(p for p in reversed(m.layout.placed) if p.offset <= offset)
        element = f"[{offset - p.offset + 1}]" if p.variable.shape else ""
        return f"{p.variable.name}{element}", m.path


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
        problems.append(
            Problem(
                c.path,
                f"{a}, {c.source}, in a kernel",
                "a declaration (model:…); the master runs all others",
            )
        )
    if problems:
        raise SystemInvalid(problems)
    found = {text: equations(s.declare()) for text, s in sources_of_plan.items()}
    if plan.start:
        start = f"{float(plan.start):g} s"
        problems.append(Problem("start time", start, "0 s, where a kernel begins"))
    problems += [*_component_problems(plan, found), *_plan_problems(plan)]
    if problems:
        raise SystemInvalid(problems)
    clocks = {int(k.period / plan.tick) for e in found.values() for k in e.layout.model.clocks}
    rates = {c.step_ticks for c in plan.components} - {1}
    periods = tuple(sorted(clocks | rates))
    members: list[Member] = []
    sources = list(found)
    cell, start_cell = (HEADER + 2 * len(periods)) * cells_a_word, 0
    for c in plan.components:
        layout = found[c.source].layout
        of_clocks = [int(k.period / plan.tick) for k in layout.model.clocks]
        member = Member(
            path=c.path,
            source=c.source,
            declaration=sources.index(c.source),
            layout=layout,
            cell=cell,
            start_cell=start_cell,
            periods=tuple(map(periods.index, of_clocks)),
            rate=-1 if c.step_ticks == 1 else periods.index(c.step_ticks),
            cuts=tuple(_cuts(plan.tick, layout.model.h_max, c.step_ticks, of_clocks)),
        )
        members.append(member)
        cell += member.size
        start_cell += member.n_start
    return Fused(plan, found, tuple(members), periods, cells_a_word)


def _cuts(tick: Fraction, h_max: float, ticks: int, periods: list[int]) -> Iterator[Cut]:
    """Cut a communication step at the sample instants inside it."""
    at = {0, *(k for p in periods for k in range(0, ticks, p))}
    for begin, end in pairwise([*sorted(at), ticks]):
        clocks = tuple(i for i, p in enumerate(periods) if begin % p == 0)
        # As in uuv_runtime.c: rounding must not add a sub-step to a whole number of them.
        pieces = max(1, ceil(float((end - begin) * tick) / h_max - 1e-6))
        yield Cut(begin, end, clocks, pieces)


def _component_problems(plan: Plan, found: Mapping[str, Equations]) -> Iterator[Problem]:
    """Yield the components with an optimiser, and the clocks that do not fit their step."""
    for c in plan.components:
        if optimisers_of(list(found[c.source].updates)):
            yield Problem(
                c.path,
                f"an optimiser, {c.source}, in a kernel",
                "a law in closed form such as lqr; the master and FMUs run optimisers",
            )
    for c in plan.components:
        step = c.step_ticks * plan.tick
        for clock in found[c.source].layout.model.clocks:
            what = f"clock {clock.name!r} with a period of {clock.period} s in a kernel"
            if (clock.period / plan.tick).denominator != 1:
                expected = f"a whole multiple of the communication step, {plan.tick} s"
                yield Problem(c.path, what, expected)
            elif 1 not in ((clock.period / step).denominator, (step / clock.period).denominator):
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
