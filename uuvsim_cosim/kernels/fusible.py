"""What a plan must be for a kernel: every component a declaration, every clock on the tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import ceil

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.equations import Equations, equations
from uuvsim_cosim.fmus.layout import Layout
from uuvsim_cosim.orchestrator.plan import Plan, Transfer
from uuvsim_cosim.orchestrator.sources import ModelSource, resolve

__all__ = ["Fused", "Member", "fused_of"]

HEADER = 3  # cells: tick, failed, tick of the failure (fmus/kernels/uuv_lane_steps.h)


@dataclass(frozen=True)
class Member:
    """A component of the plan in a kernel; `cell` is the first of its block of values."""

    path: str
    source: str
    declaration: int  # index into Fused.sources
    layout: Layout
    cell: int
    start_cell: int  # first of its start values: all that precedes the derived values
    periods: tuple[int, ...]  # of each clock: index into Fused.periods
    pieces: int  # Runge-Kutta steps in a communication step

    @property
    def n_start(self) -> int:
        """Give the number of its start values: time, inputs, parameters."""
        return self.layout.offset["derived"]


@dataclass(frozen=True)
class Fused:
    """A plan with its declarations, and the place of every value in a block of lanes."""

    plan: Plan
    equations: Mapping[str, Equations]  # by source
    members: tuple[Member, ...]
    periods: tuple[int, ...]  # of the clocks, in ticks

    @cached_property
    def sources(self) -> tuple[str, ...]:
        """Give the distinct declarations, each of which is compiled once."""
        return tuple(self.equations)

    @property
    def n_cells(self) -> int:
        """Give the number of cells of a block."""
        last = self.members[-1]
        return last.cell + last.layout.size

    @property
    def n_start(self) -> int:
        """Give the number of start values of a block."""
        last = self.members[-1]
        return last.start_cell + last.n_start

    @cached_property
    def order(self) -> tuple[int, ...]:
        """Give the components in stepping order."""
        return tuple(i for group in self.plan.groups for i in group.members)

    def is_early(self, t: Transfer) -> bool:
        """Say whether the target sees what the source produced in the same step."""
        for group in self.plan.groups:
            if t.source in group.members and t.target in group.members:
                before = group.members.index(t.source) < group.members.index(t.target)
                return group.algorithm == "gauss-seidel" and before
        return False


def fused_of(plan: Plan) -> Fused:
    """Give the plan with its declarations; raises SystemInvalid with all that cannot be fused."""
    problems = [*_foreign(plan)]
    if problems:
        raise SystemInvalid(problems)
    found = {c.source: equations(_source(c.source).declare()) for c in plan.components}
    problems = [*_rates(plan), *_clocks(plan, found), *_loops(plan), *_conversions(plan)]
    if problems:
        raise SystemInvalid(problems)
    periods = tuple(
        sorted({int(k.period / plan.tick) for e in found.values() for k in e.layout.model.clocks})
    )
    members: list[Member] = []
    sources = list(found)
    cell, start_cell = HEADER + 2 * len(periods), 0
    for c in plan.components:
        layout = found[c.source].layout
        member = Member(
            path=c.path,
            source=c.source,
            declaration=sources.index(c.source),
            layout=layout,
            cell=cell,
            start_cell=start_cell,
            periods=tuple(periods.index(int(k.period / plan.tick)) for k in layout.model.clocks),
            pieces=_pieces(plan.tick, layout.model.h_max),
        )
        members.append(member)
        cell += layout.size
        start_cell += member.n_start
    return Fused(plan, found, tuple(members), periods)


def _source(text: str) -> ModelSource:
    source = resolve(text)
    assert isinstance(source, ModelSource)
    return source


def _pieces(tick: Fraction, h_max: float) -> int:
    # As uuv_runtime.c does it: a hair over a whole number of sub-steps is that number.
    return max(1, ceil(float(tick) / h_max - 1e-6))


def _foreign(plan: Plan) -> Iterator[Problem]:
    for c in plan.components:
        source = resolve(c.source)
        if not isinstance(source, ModelSource):
            a = {"FMU": "an FMU", "Python": "a Python component"}.get(source.kind, source.kind)
            yield Problem(
                c.path,
                f"{a}, {c.source}, in a kernel",
                "a declaration (model:…); the master runs all others",
            )


def _rates(plan: Plan) -> Iterator[Problem]:
    for c in plan.components:
        if c.step_ticks != 1:
            yield Problem(
                c.path,
                f"a communication step of {c.step_ticks * plan.tick} s in a kernel",
                f"that of the system, {plan.tick} s",
            )


def _clocks(plan: Plan, found: Mapping[str, Equations]) -> Iterator[Problem]:
    for c in plan.components:
        for clock in found[c.source].layout.model.clocks:
            if (clock.period / plan.tick).denominator != 1:
                yield Problem(
                    c.path,
                    f"clock {clock.name!r} with a period of {clock.period} s in a kernel",
                    f"a whole multiple of the communication step, {plan.tick} s",
                )


def _loops(plan: Plan) -> Iterator[Problem]:
    for entry in plan.initialization:
        if len(entry) > 1:
            paths = ", ".join(dict.fromkeys(plan.components[i].path for i in entry))
            yield Problem(
                paths,
                "an algebraic loop in initialization, in a kernel",
                "none; the master solves loops",
            )


def _conversions(plan: Plan) -> Iterator[Problem]:
    for t in plan.transfers:
        kinds = {t.source_variable.type, t.target_variable.type}
        changed = (t.factor, t.offset) != (1.0, 0.0)
        if changed and kinds != {"Float64"}:
            yield Problem(
                f"{plan.components[t.target].path}.{t.target_variable.name}",
                f"factor {t.factor} and offset {t.offset} between {' and '.join(sorted(kinds))}",
                "no conversion of whole numbers in a kernel",
            )
