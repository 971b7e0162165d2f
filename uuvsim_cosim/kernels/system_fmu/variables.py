"""Variables of a whole system as one component: unconnected inputs, parameters, outputs."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from typing import Any, Literal, get_args

import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid, Problem, SystemInvalid
from uuvsim_cosim.fmus.description import Description, Variable, VariableType
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.units import Unit, parse_unit
from uuvsim_cosim.orchestrator.plan.plan import Plan

__all__ = ["Exposed", "Naming", "description_of", "exposed", "placed"]

Naming = Literal["flat", "structured"]

# Three types are enough for a block of float64; wider integers keep 53 bits.
_SHOWN: Mapping[str, VariableType] = {
    "Float64": "Float64", "Float32": "Float64", "Boolean": "Boolean", "Int8": "Int32",
    "UInt8": "Int32", "Int16": "Int32", "UInt16": "Int32", "Int32": "Int32",
    "Enumeration": "Int32", "UInt32": "Float64", "Int64": "Float64", "UInt64": "Float64",
}  # fmt: skip


@dataclass(frozen=True)
class Exposed:
    """A variable of a component, and its form in the export; `free` are the unconnected elements.

    `full_name` is the master's name for it, "hull.eta"; `shown` has the name of the export and the
    start value of the plan.
    """

    component: int
    full_name: str
    own: Variable
    shown: Variable
    free: tuple[int, ...]

    @property
    def offset(self) -> int:
        """Return the place of its first element in the block of values: its value reference."""
        return self.shown.value_references[0]


def exposed(
    plan: Plan,
    *,
    naming: Naming = "flat",
    signals: Sequence[str] = (),
    inputs: Sequence[str] = (),
    fixed: bool = True,
) -> list[Exposed]:
    """Return free inputs, then parameters (without `fixed`, the tunable ones), then outputs.

    `signals` are patterns of outputs' names, "hull.*", `inputs` of inputs' names; without any, all
    are returned, and "" stands for none. Raises InputInvalid for a pattern without a match,
    SystemInvalid for names that clash.
    """
    if naming not in get_args(Naming):
        raise InputInvalid(f"names {naming!r}", f"one of {', '.join(get_args(Naming))}")
    connected: dict[tuple[int, str], set[int]] = {}
    for t in plan.transfers:
        connected.setdefault((t.target, t.target_variable.name), set()).update(t.target_elements)
    free_inputs: list[Exposed] = []
    parameters: list[Exposed] = []
    outputs: list[Exposed] = []
    for i, c in enumerate(plan.components):
        for v in c.description.of("input", "parameter", "output"):
            if v.type not in _SHOWN:
                continue
            every = tuple(range(v.size))
            if v.causality == "input":
                free = tuple(k for k in every if k not in connected.get((i, v.name), ()))
                free_inputs += [_shown(plan, i, v, free)] if free else []
            elif v.causality == "output":
                outputs.append(_shown(plan, i, v, every))
            elif (fixed or v.variability == "tunable") and not (
                # A seed is derived from the system's, unless the system sets its value.
                v.name == "seed" and v.shape == (2,) and v.name not in c.start
            ):
                parameters.append(_shown(plan, i, v, every))
    found = [
        *_chosen(free_inputs, inputs, "inputs", "free input"),
        *parameters,
        *_chosen(outputs, signals, "signals", "output"),
    ]
    names = _names([e.full_name for e in found], naming)
    return [
        replace(e, shown=replace(e.shown, name=name)) for e, name in zip(found, names, strict=True)
    ]


def placed(variables: Iterable[Exposed], first: int) -> list[Exposed]:
    """Return the variables with consecutive places in the block, from `first` on."""
    done = []
    for e in variables:
        done.append(replace(e, shown=replace(e.shown, value_references=(first,))))
        first += e.shown.size
    return done


def description_of(
    name: str, text: str, plan: Plan, variables: Sequence[Exposed], own: Sequence[Variable]
) -> Description:
    """Describe the system as one component; `own` are additional variables, of no component."""
    units: dict[str, Unit] = {}
    shown = []
    for e in variables:
        known = plan.components[e.component].description.units
        elements = tuple(_unit(u, known, units) for u in e.shown.units)
        same = len(set(elements)) <= 1
        shown.append(
            replace(
                e.shown,
                unit=elements[0] if same and elements else None,
                element_units=() if same else elements,
            )
        )
    for v in own:
        if v.unit is not None:
            units.setdefault(v.unit, parse_unit(v.unit))
    every = sorted([*own, *shown], key=lambda v: v.value_references[0])
    return Description(
        name=name,
        kind="native",
        description=text,
        variables={v.name: v for v in every},
        units=units,
    )


def _unit(name: str | None, known: Mapping[str, Unit], units: dict[str, Unit]) -> str | None:
    """Return a unit's name if it has the same definition in all components."""
    if name is None:
        return None
    try:
        unit = known[name] if name in known else parse_unit(name)
    except ParameterInvalid:
        return None
    return name if units.setdefault(name, unit) == unit else None


def _chosen(
    every: Sequence[Exposed], patterns: Sequence[str], option: str, what: str
) -> Sequence[Exposed]:
    """Return the variables that match a pattern; all without patterns, none for ""."""
    names = [e.full_name for e in every]
    for pattern in patterns:
        if pattern and not any(fnmatchcase(name, pattern) for name in names):
            raise InputInvalid(
                f"{option} {pattern!r}", f"no {what}", expected_names(pattern, names)
            )
    if not patterns:
        return every
    return [e for e in every if any(fnmatchcase(e.full_name, p) for p in patterns)]


def _shown(plan: Plan, i: int, v: Variable, free: tuple[int, ...]) -> Exposed:
    """Return a variable of component i in its form for the export, with its full name."""
    c = plan.components[i]
    name = f"{c.path}.{v.name}"
    kind = _SHOWN[v.type]
    start: Any = None
    if v.causality != "output":
        given = c.start.get(v.name, v.start)
        dtype = {"Float64": float, "Boolean": bool, "Int32": np.int64}[kind]
        start = np.zeros(v.shape) if given is None else np.asarray(given)
        start = start.astype(dtype).reshape(v.shape)
        start = start if v.shape else start.item()
    smooth = v.causality == "parameter" or kind == "Float64"
    shown = replace(
        v,
        type=kind,
        start=start,
        variability=v.variability if smooth else "discrete",
        initial="calculated" if v.causality == "output" else "exact",
        description=f"{name}: {v.description}" if v.description else name,
        value_references=(),
        dependencies=() if v.causality == "output" else None,
    )
    return Exposed(i, name, v, shown, free)


def _names(full: Sequence[str], naming: Naming) -> list[str]:
    """Return the names of the export: without dots unless `structured`; two that clash get "__"."""
    keep = r"[^\w.]" if naming == "structured" else r"\W"
    names = [re.sub(keep, "_", n, flags=re.ASCII) for n in full]
    count = Counter(names)
    dots = [re.sub(keep, "_", n.replace(".", "__"), flags=re.ASCII) for n in full]
    names = [d if count[n] > 1 else n for n, d in zip(names, dots, strict=True)]
    used: dict[str, str] = {}
    problems = []
    for name, known in zip(names, full, strict=True):
        if name in used:
            expected = "names that differ by more than a dot (or structured names, with dots)"
            problems.append(Problem(known, f"exported as {name}, as is {used[name]}", expected))
        used.setdefault(name, known)
    if problems:
        raise SystemInvalid(problems)
    return names
