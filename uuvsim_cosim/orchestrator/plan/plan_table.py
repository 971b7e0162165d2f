"""Text of a plan: steps of components, transfers, order of initialization."""

from __future__ import annotations

from collections.abc import Sequence

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.orchestrator.plan.algebraic_loops import hops_of
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.elements import step_text

__all__ = ["format_plan"]


def format_plan(plan: Plan) -> str:
    """Write a plan as text tables."""
    groups = {i: f"{g.algorithm} {n}" for n, g in enumerate(plan.groups) for i in g.members}
    components = [("#", "component", "kind", "step s", "group", "in", "out", "seed")]
    for i, c in enumerate(plan.components):
        components.append(
            (
                str(i), c.path, c.description.kind, step_text(c.step_ticks * plan.tick),
                groups.get(i, "-"), str(sum(v.size for v in c.description.of("input"))),
                str(sum(v.size for v in c.description.of("output"))), f"{c.seed[0]} {c.seed[1]}",
            )
        )  # fmt: skip
    transfers: list[tuple[str, ...]] = [("from", "to", "size", "unit", "conversion")]
    for t in plan.transfers:
        unit, target_unit = t.source_variable.unit_text or "-", t.target_variable.unit_text or "-"
        change = "" if (t.factor, t.offset) == (1.0, 0.0) else f"{t.factor:g} x + {t.offset:g}"
        if t.table:
            change = ", ".join(f"{a} to {b}" for a, b in t.table)
        source, target = plan.components[t.source].path, plan.components[t.target].path
        transfers.append(
            (
                f"{source}.{_part(t.source_variable, t.source_elements)}",
                f"{target}.{_part(t.target_variable, t.target_elements)}",
                str(len(t.source_elements)),
                unit if unit == target_unit else f"{unit} -> {target_unit}",
                change,
            )
        )
    order = [
        " + ".join(plan.components[i].path for i in dict.fromkeys(entry))
        + (" (loop)" if len(entry) > 1 else "")
        for entry in plan.initialization
    ]
    parts = [
        f"tick {step_text(plan.tick)} s, {len(plan.components)} components",
        _table(components),
        _table(transfers) if plan.transfers else "no connections",
        "initialization: " + ", ".join(order),
        *(f"iterated loop: {hops_of(plan, x)}" for x in plan.algebraic_loops if x.iterated),
        *(f"note: {w}" for w in plan.warnings),
    ]
    return "\n\n".join(parts)


def _part(variable: Variable, elements: tuple[int, ...]) -> str:
    """Return the text of a variable's elements, such as ``x[2:4]``."""
    if elements == tuple(range(variable.size)):
        return variable.name
    first, last = elements[0], elements[-1]
    if len(elements) == 1:
        return variable.element_name(first)
    if len(variable.shape) == 1 and elements == tuple(range(first, last + 1)):
        return f"{variable.name}[{first + 1}:{last + 1}]"
    listed = ",".join(str(i + 1) for i in elements)
    return f"{variable.name}[{{{listed}}}]"


def _table(rows: Sequence[tuple[str, ...]]) -> str:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
