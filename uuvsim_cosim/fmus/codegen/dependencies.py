"""Dependencies of outputs on inputs and parameters, from the sparsity of the equations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal

import casadi as ca

from uuvsim_cosim.fmus.codegen.equations import Equations, Layout

__all__ = ["KINDS", "derivative_knowns", "direct_kinds", "initial_knowns", "sparsity_rows"]

# FMI's dependenciesKind, from the strongest to the weakest statement about a partial derivative.
KINDS = ("constant", "fixed", "tunable", "dependent")
_STEPS = (
    "floor ceil sign lt le eq ne not and or fmod remainder copysign if_else_zero fmin fmax fabs"
)


def direct_kinds(eq: Equations) -> list[dict[int, str]]:
    """Return for each element of the outputs the variables it depends on, and the kind of each.

    Variables are offsets in the block, of inputs, continuous states and time (0). A kind is
    FMI's dependenciesKind. One that is stronger than ``dependent`` is given only for inputs of
    outputs without steps and kinks: with them, the partial derivative is not sufficient.
    """
    layout = eq.layout
    first, count = layout.offset["input"], layout.count["input"]
    known = _known(layout)
    kinds: list[dict[int, str]] = [
        dict.fromkeys(sorted(filter(known, row)), "dependent")
        for row in sparsity_rows(eq.outputs, 0)
    ]
    smooth = _smooth_rows(eq) if count else set()
    fixed: set[int] = set()
    tunable: set[int] = set()
    for p in layout.placed:
        if p.variable.kind in ("parameter", "derived"):
            which = fixed if p.variable.variability == "fixed" else tunable
            which.update(range(p.offset, p.offset + p.variable.size))
    for (row, column), factors in (_factors(eq) if smooth else {}).items():
        if row in smooth and first + column in kinds[row]:
            kinds[row][first + column] = (
                "constant" if not factors
                else "fixed" if factors <= fixed
                else "tunable" if factors <= fixed | tunable
                else "dependent"
            )  # fmt: skip
    return kinds


def derivative_knowns(eq: Equations) -> list[list[int]]:
    """Return for each state's derivative the inputs, states and time (0) that it depends on."""
    known = _known(eq.layout)
    return [sorted(filter(known, row)) for row in sparsity_rows(eq.rhs, 0)]


def _known(layout: Layout) -> Callable[[int], bool]:
    """Return a test for the offsets of time, inputs and continuous states."""
    o, n = layout.offset, layout.count
    known = {0, *(o[kind] + i for kind in ("input", "state") for i in range(n[kind]))}
    return known.__contains__


def initial_knowns(
    eq: Equations, of: Literal["outputs", "initial", "rhs"] = "outputs"
) -> list[list[int]]:
    """Return for each element of a function the inputs and parameters it depends on initially.

    States are replaced by the dependencies of their start values, derived values by those of their
    equations.
    """
    layout = eq.layout
    through: dict[int, set[int]] = {}
    for function, kind in ((eq.derived, "derived"), (eq.initial, "state")):
        at = layout.offset["derived" if kind == "derived" else "state"]
        through.update({at + i: known for i, known in enumerate(sparsity_rows(function, 0))})
    found = []
    for known in sparsity_rows(getattr(eq, of), 0):
        seen: set[int] = set()
        waiting = list(known)
        while waiting:
            k = waiting.pop()
            if k not in seen:
                seen.add(k)
                waiting.extend(through.get(k, ()))
        found.append(sorted(seen - through.keys()))
    return found


def sparsity_rows(function: Any, argument: int) -> list[set[int]]:
    """Return the columns of each row in a function's Jacobian to one argument."""
    rows: list[set[int]] = [set() for _ in range(function.numel_out(0))]
    if rows:
        for row, column in zip(*function.jac_sparsity(0, argument).get_triplet(), strict=True):
            rows[row].add(column)
    return rows


def _smooth_rows(eq: Equations) -> set[int]:
    """Return the elements of those outputs whose equations have neither steps nor kinks."""
    steps = {getattr(ca, f"OP_{name.upper()}") for name in _STEPS.split()} | {ca.OP_CALL}
    b = eq.layout.block
    values = eq.outputs(b)
    smooth: set[int] = set()
    for p in eq.layout.placed:
        if p.variable.kind == "output":
            low = p.offset - eq.layout.offset["output"]
            rows = range(low, low + p.variable.size)
            f = ca.Function("output", [b], [values[list(rows)]])
            if steps.isdisjoint(f.instruction_id(k) for k in range(f.n_instructions())):
                smooth.update(rows)
    return smooth


def _factors(eq: Equations) -> dict[tuple[int, int], set[int]]:
    """Return the variables that each entry of d(outputs)/d(inputs) depends on, by (row, column)."""
    b = eq.layout.block
    jacobian = ca.jacobian(eq.outputs(b), eq.layout.symbols("input"))
    entries = ca.vertcat(*jacobian.nonzeros())
    if entries.numel() == 0:
        return {}
    depends = sparsity_rows(ca.Function("factors", [b], [ca.densify(entries)]), 0)
    places: Sequence[tuple[int, int]] = list(zip(*jacobian.sparsity().get_triplet(), strict=True))
    return dict(zip(places, depends, strict=True))
