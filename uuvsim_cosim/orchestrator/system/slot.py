"""Slot: connectors that a component must have to replace another, and the replacement."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Literal, TypeVar

from uuvsim_cosim.errors import Problem, SystemInvalid, UuvsimError
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.models.declaration.element_names import index_text
from uuvsim_cosim.orchestrator.parameters.ssm import read_names
from uuvsim_cosim.orchestrator.system.elements import (
    Connection,
    Element,
    Exposed,
    Structure,
    step_text,
)
from uuvsim_cosim.orchestrator.system.resolve import is_recorded, nested_structure
from uuvsim_cosim.orchestrator.system.validation import as_step, describe_element, problem_of
from uuvsim_cosim.orchestrator.system.wiring import Wire
from uuvsim_cosim.orchestrator.values.endpoints import find_variable
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion, fit, is_float

__all__ = ["Slot", "SlotConnector", "fitted", "format_slot", "slot_at"]

S = TypeVar("S", bound=Structure)


@dataclass(frozen=True)
class SlotConnector:
    """One connector that a replacement must have; `peers` are the connectors it is connected to."""

    name: str
    direction: Literal["input", "output"]
    type: str
    shape: tuple[int, ...]
    units: tuple[str | None, ...]  # one for each element
    peers: tuple[str, ...]
    description: str = ""

    @property
    def unit_text(self) -> str:
        """Return the unit as a text: ``m, rad`` if the elements' units differ."""
        return ", ".join(dict.fromkeys(u or "-" for u in self.units))


@dataclass(frozen=True)
class Slot:
    """Requirements of a system on the component at a path; `step` is its step in s."""

    path: str
    source: str
    step: Fraction
    connectors: tuple[SlotConnector, ...]
    parameters: tuple[Variable, ...]
    start: Mapping[str, object]


def slot_at(system: Structure, path: str, description: Description, wires: Sequence[Wire]) -> Slot:
    """Return the connected connectors of the component at a path, and its parameters.

    `wires` are those of the system, and `description` is the component's.
    """
    element = system.components[path]
    peers: dict[str, list[str]] = {}
    for wire in wires:
        if wire.source.element == path:
            peers.setdefault(wire.source.variable.name, []).append(wire.connection.target)
        if wire.target.element == path:
            peers.setdefault(wire.target.variable.name, []).append(wire.connection.source)
    for item in system.exposed:
        owner, _, rest = item.path.partition(".")
        if owner == path:
            peers.setdefault(find_variable(rest, description)[0].name, []).append(item.name)
    connectors = tuple(
        SlotConnector(
            v.name, "input" if v.causality == "input" else "output", v.type, v.shape, v.units,
            tuple(peers[v.name]), v.description,
        )
        for v in description.variables.values()
        if v.name in peers and v.causality in ("input", "output")
    )  # fmt: skip
    source = element.source if isinstance(element.source, str) else element.source.name
    parameters = tuple(description.of("parameter"))
    step = Fraction(element.rate or system.base_step)
    return Slot(path, source, step, connectors, parameters, element.start)


def format_slot(found: Slot) -> str:
    """Write a slot as a text table."""
    rows = [("", "connector", "size", "unit", "from / to")]
    for c in found.connectors:
        size = " x ".join(map(str, c.shape)) or "1"
        arrow = "from" if c.direction == "input" else "to"
        shown = ", ".join(c.peers[:4]) + (", …" if len(c.peers) > 4 else "")
        unit = c.unit_text if c.type.startswith("Float") else c.type
        rows.append((c.direction, c.name, size, unit, f"{arrow} {shown}"))
    widths = [max(len(row[i]) for row in rows) for i in range(5)]
    lines = ["  ".join(t.ljust(w) for t, w in zip(row, widths, strict=True)).rstrip()
             for row in rows]  # fmt: skip
    head = f"slot {found.path}, now {found.source}, steps every {step_text(found.step)} s"
    return "\n".join([head, *lines])


def fitted(
    system: S,
    path: str,
    source: str | Structure,
    mapping: Mapping[str, str] | str | Path | None,
    rate: Fraction | str | float | None,
    start: Mapping[str, object] | None,
    *,
    descriptions: Mapping[str, Description],
    wires: Sequence[Wire],
) -> S:
    """Return the system with another component at `path`.

    `descriptions` and `wires` are those of the system. A recording reads nothing, so the
    connections to the component end. Raises SystemInvalid with every problem.
    """
    old = system.components[path]
    try:
        if isinstance(mapping, str | Path):
            mapping = read_names(Path(mapping))
        names = dict(mapping or {})
        step = old.rate if rate is None else as_step(rate, path)
        fresh = describe_element(Element(path, source), system.base)
        recorded = isinstance(source, str) and is_recorded(source, system.base)
    except UuvsimError as error:
        raise SystemInvalid([problem_of(path, error)]) from None
    if recorded:
        wires = [w for w in wires if w.target.element != path]
    fit_ = _Fit(system, path, descriptions[path], fresh, names, wires)
    connections = fit_.connections()
    exposed = fit_.exposed()
    if fit_.problems:
        raise SystemInvalid(fit_.problems)
    nested = nested_structure(source, system.base) is not None
    kept = {} if nested else fit_.kept_start(old.start)
    element = Element(path, source, {**kept, **(start or {})}, None if nested else step,
                      old.description, fit_.units)  # fmt: skip
    elements = tuple(element if e.name == path else e for e in system.elements)
    return replace(
        system,
        elements=elements,
        connections=connections,
        exposed=exposed,
        remarks=(*system.remarks, *fit_.remarks),
    )


class _Fit:
    """Fit of one replacement: its elements for those of the slot, and all problems."""

    def __init__(
        self,
        system: Structure,
        path: str,
        slot_: Description,
        fresh: Description,
        names: dict[str, str],
        wires: Sequence[Wire],
    ) -> None:
        self.system, self.path, self.wires = system, path, wires
        self.slot, self.fresh, self.names = slot_, fresh, names
        self.problems: list[Problem] = []
        self.remarks: list[str] = []
        self.assumed: dict[str, dict[int, str]] = {}
        self._missing: set[str] = set()
        for old, new in names.items():
            for name, description, what in (
                (old, slot_, "the slot"), (new, fresh, "the replacement"),
            ):  # fmt: skip
                try:
                    find_variable(name, description)
                except Misfit as misfit:
                    self.problems.append(Problem(
                        f"map {path}.{old}={new}", f"{misfit.read}, {what}", misfit.expected
                    ))  # fmt: skip

    def connections(self) -> tuple[Connection, ...]:
        """Return the system's connections, with the replacement's names at this component."""
        result: list[Connection] = []
        for wire in self.wires:
            ends = [
                self._new(p.variable, p.elements) if p.element == self.path else p.texts()
                for p in (wire.source, wire.target)
            ]
            result += [replace(wire.connection, source=a, target=b)
                       for a, b in zip(*ends, strict=False)]  # fmt: skip
        return tuple(result)

    def exposed(self) -> tuple[Exposed, ...]:
        """Return the system's exposed connectors, with the replacement's names."""
        result: list[Exposed] = []
        for item in self.system.exposed:
            owner, _, rest = item.path.partition(".")
            if owner != self.path:
                result.append(item)
                continue
            variable, elements, whole = find_variable(rest, self.slot)
            for place, new in zip(elements, self._new(variable, elements), strict=False):
                name = f"{item.name}{index_text(variable.shape, place)}" if whole else item.name
                result.append(Exposed(name, new))
        return tuple(result)

    def kept_start(self, start: Mapping[str, object]) -> dict[str, object]:
        """Return the old start values that fit the replacement, in its units."""
        kept: dict[str, object] = {}
        for name, value in start.items():
            new = self.names.get(name, name)
            variable = self.fresh.variables.get(new)
            old = self.slot.variables[name]
            if variable is None:
                continue
            try:
                if variable.causality not in ("parameter", "structuralParameter", "input"):
                    raise Misfit("not settable", "a parameter")
                units = {**self.slot.units, **self.fresh.units}
                same = variable.units == old.units or not is_float(old)
                kept[new] = fit(variable, value, None if same else old.unit, units)
            except Misfit as misfit:
                self.remarks.append(
                    f"{self.path}.{new}: start value of the slot dropped ({misfit})"
                )
        return kept

    @property
    def units(self) -> dict[str, str]:
        """Return the assumed units by variable, separated by blanks if the elements' differ.

        Valid after `connections` and `exposed`, which find them.
        """
        result: dict[str, str] = {}
        for name, assumed in self.assumed.items():
            known = self.fresh.variables[name].units
            each = [assumed.get(i) or u or "1" for i, u in enumerate(known)]
            result[name] = each[0] if len(set(each)) == 1 else " ".join(each)
        return result

    def _new(self, variable: Variable, elements: tuple[int, ...]) -> list[str]:
        """Return the replacement's endpoints for elements of a variable of the slot."""
        result: list[str] = []
        for i in elements:
            try:
                found, place = self._element(variable, i)
            except Misfit as misfit:
                if variable.name not in self._missing:
                    self._missing.add(variable.name)
                    self.problems.append(misfit.at(f"{self.path}.{variable.name}"))
                continue
            wanted = variable.unit_of_element(i)
            if found.unit_of_element(place) is None and wanted is not None and is_float(found):
                self.assumed.setdefault(found.name, {})[place] = wanted
            result.append(f"{self.path}.{found.element_name(place)}")
        return result

    def _element(self, variable: Variable, i: int) -> tuple[Variable, int]:
        """Return the replacement's variable and element for element i of a slot's variable.

        Raises Misfit if there is none, or if causality, size or unit differ.
        """
        indexed = variable.element_name(i)
        text = self.names.get(indexed) or self.names.get(variable.name, variable.name)
        try:
            found, elements, _ = find_variable(text, self.fresh)
        except Misfit:
            parts = []
            for causality in ("input", "output"):
                names = [f"{v.name}{list(v.shape) if v.shape else ''}"
                         for v in self.fresh.of(causality)]  # fmt: skip
                shown = ", ".join(names[:24]) + (", …" if len(names) > 24 else "")
                parts.append(f"{causality}s {shown}" if names else f"no {causality}s")
            missing = f"missing in {self.fresh.name}, which has {' and '.join(parts)}"
            raise Misfit(missing, self._wanted(variable)) from None
        if found.causality != variable.causality:
            raise Misfit(f"{found.name} is of causality {found.causality}", self._wanted(variable))
        if indexed in self.names and variable.shape and len(elements) == 1:
            place = elements[0]
        elif len(elements) != variable.size:
            raise Misfit(f"{found.name} has {len(elements)} elements", self._wanted(variable))
        else:
            place = elements[i]
        read, wanted = found.unit_of_element(place), variable.unit_of_element(i)
        if is_float(found) and is_float(variable) and read and wanted:
            units = {**self.slot.units, **self.fresh.units}
            if conversion(read, wanted, units) is None:
                mixed = found.element_units or variable.element_units
                name = found.element_name(place) if mixed else found.name
                raise Misfit(f"{name} has unit {read!r}", self._wanted(variable, wanted))
        return found, place

    def _wanted(self, variable: Variable, unit: str | None = None) -> str:
        """Return the expected variable, for an error."""
        text = unit or variable.unit_text
        unit = f" in {text}" if text not in ("", "1") else ""
        size = f" of {variable.size} elements" if variable.shape else ""
        article = "an input" if variable.causality == "input" else "an output"
        return f"{article}{size}{unit} of this name, or a map {self.path}.{variable.name}=NAME"
