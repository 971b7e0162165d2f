"""Coupling residuals of a run: how much its delayed connections differ from ones without delay.

During a communication step, the input of a delayed connection has the output's value from the
step's start. The residual is the difference between that input and the input that follows from
the output at the step's end; its size is relative to 1 + |input|, as is the tolerance of an
iterated group. An input that still has the output's initial value does not count, because that may
be a start value only, as of a sensor before its first sample. Angles that differ by a full turn
are equal. Connections of floating-point numbers have a residual. See docs/systems/time.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from uuvsim_cosim.orchestrator.master.core_library import Coupling
from uuvsim_cosim.orchestrator.master.core_tables import Tables
from uuvsim_cosim.orchestrator.plan.algebraic_loops import hops_of

__all__ = ["Residual", "loop_remarks", "residuals_of"]

_HUGE = 1e9  # in any unit: no signal of a vehicle changes by so much in a step
_TOO_MUCH = 0.1  # relative residual beyond which inputs and outputs of a loop do not agree


@dataclass(frozen=True)
class Residual:
    """The largest residual of one connection, from `source` to `target` (``b.u[2]``)."""

    source: str
    target: str
    residual: float  # in the unit of the target
    unit: str
    relative: float  # to 1 + |input|
    time: float  # s, the step's end


def residuals_of(tables: Tables, most: int | None = None) -> list[Residual]:
    """Return the largest residual of each delayed connection, the largest `most` first."""
    found = sorted(tables.core.couplings(), key=lambda c: -c.relative)
    return [_residual(tables, c) for c in found[:most]]


def loop_remarks(tables: Tables) -> list[str]:
    """Return a warning for each delayed loop whose inputs and outputs differ much."""
    plan, remarks = tables.plan, []
    named: set[tuple[int, str, int, str]] = set()
    large = [c for c in tables.core.couplings() if c.relative > _TOO_MUCH]
    for loop in plan.algebraic_loops if large else ():
        inside = [plan.transfers[k] for k in loop.transfers]
        ends = {
            (t.source, t.source_variable.name, t.target, t.target_variable.name) for t in inside
        }
        of_loop = [c for c in large if _ends(tables, c) in ends]
        if loop.iterated or not of_loop:
            continue
        named |= ends
        worst = max(of_loop, key=lambda c: c.relative)
        r = _residual(tables, worst)
        unit = f" {r.unit}" if r.unit not in ("", "1") else ""
        is_last = tables.core.tick - worst.tick < len(loop.cycle)
        then = ", where the run ends: the loop may diverge" if is_last else ""
        remarks.append(
            f"delayed loop {hops_of(plan, loop)}: its coupling residual is {r.residual:.3g}{unit} "
            f"at {r.target}, t = {r.time:.6g} s{then}; expected --loops iterate, a smaller step, "
            "or a component with a state in the loop"
        )
    return remarks + _explosion(tables, [c for c in large if _ends(tables, c) not in named])


def _explosion(tables: Tables, large: Sequence[Coupling]) -> list[str]:
    """Return a warning if values grow without bound in a loop that is not algebraic.

    Outputs of its components follow the inputs a step later (a Python component, or an FMU without
    dependencies), but such a loop can diverge as well.
    """
    worst = max(large, key=lambda c: c.residual, default=None)
    if worst is None or not worst.residual > _HUGE:
        return []
    source, _, target, _ = _ends(tables, worst)
    reached, todo = {target}, [target]
    while todo:
        at = todo.pop()
        after = {t.target for t in tables.plan.transfers if t.source == at} - reached
        reached |= after
        todo += after
    r = _residual(tables, worst)
    if source not in reached:
        return []
    return [
        f"loop through {r.source} -> {r.target}: its values change by {r.residual:.3g} in a step "
        f"at t = {r.time:.6g} s; the loop may diverge; expected a smaller gain or step, or a "
        "component with a state in the loop"
    ]


def _residual(tables: Tables, c: Coupling) -> Residual:
    place, element = tables.placed_at(c.target_slot)
    return Residual(
        source=_name(tables, c.source_slot),
        target=_name(tables, c.target_slot),
        residual=c.residual,
        unit=place.variable.unit_of_element(element) or "",
        relative=c.relative,
        time=float(c.tick * tables.plan.tick),
    )


def _ends(tables: Tables, c: Coupling) -> tuple[int, str, int, str]:
    (source, _), (target, _) = (tables.placed_at(s) for s in (c.source_slot, c.target_slot))
    order = tables.order
    return order[source.member], source.variable.name, order[target.member], target.variable.name


def _name(tables: Tables, slot: int) -> str:
    placed, element = tables.placed_at(slot)
    path = tables.plan.components[tables.order[placed.member]].path
    return f"{path}.{placed.variable.element_name(element)}"
