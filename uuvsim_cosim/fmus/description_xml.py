"""Reader of the values and units that model descriptions of FMI 1.0, 2.0 and 3.0 have in common."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, get_args
from xml.etree.ElementTree import Element

import numpy as np

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.description import Causality, Variability, Variable, VariableType
from uuvsim_cosim.models.declaration.units import BASE, Unit, parse_unit

__all__ = ["DTYPES", "SimpleType", "Source", "flag", "read_units"]

DTYPES: Mapping[str, type[np.generic]] = {
    "Float32": np.float32, "Float64": np.float64,
    "Int8": np.int8, "UInt8": np.uint8, "Int16": np.int16, "UInt16": np.uint16,
    "Int32": np.int32, "UInt32": np.uint32, "Int64": np.int64, "UInt64": np.uint64,
    "Enumeration": np.int64, "Boolean": np.bool_, "Clock": np.bool_,
    "String": np.object_, "Binary": np.object_,
}  # fmt: skip
_WHOLE = re.compile(r"[-+]?\d+")
_TRUE, _FALSE = ("true", "1"), ("false", "0")


@dataclass(frozen=True)
class SimpleType:
    """A declared type, from which variables inherit the attributes that they do not have."""

    attributes: Mapping[str, str]
    items: Mapping[int, str]


@dataclass(frozen=True)
class Source:
    """The file that is read; every error names it and the variable.

    `remarks` are the properties that differ from FMI and do not prevent a run.
    """

    place: str
    remarks: list[str] = field(default_factory=list)

    def fault(self, where: str, read: str, expected: str) -> FmuError:
        """Return the error for a fault in the file."""
        return FmuError(self.place, f"{where}: {read}", expected)

    def required(self, element: Element, attribute: str, where: str) -> str:
        """Read a required attribute."""
        text = element.get(attribute)
        if text is None:
            raise self.fault(where, f"no attribute {attribute!r}", f"one on <{element.tag}>")
        return text

    def number(self, element: Element | Mapping[str, str], attribute: str, where: str) -> float:
        """Read a number; raises FmuError if the attribute is no number."""
        text = element.get(attribute, "")
        try:
            return float(text)
        except ValueError:
            raise self.fault(where, f"{attribute} = {text!r}", "a number") from None

    def optional_number(
        self, element: Element | Mapping[str, str], attribute: str, where: str
    ) -> float | None:
        """Read a number; None if the attribute is missing."""
        return None if element.get(attribute) is None else self.number(element, attribute, where)

    def bound(
        self, element: Element | Mapping[str, str], attribute: str, kind: VariableType, where: str
    ) -> float | None:
        """Read a minimum or a maximum, of integers with all digits; None if it is missing."""
        text = element.get(attribute, "")
        if kind not in ("Float32", "Float64") and _WHOLE.fullmatch(text.strip()):
            return int(text)
        return self.optional_number(element, attribute, where)

    def natural(self, text: str | None, what: str, where: str) -> int:
        """Read a value reference, an index or an extent."""
        try:
            value = int(text or "")
        except ValueError:
            value = -1
        if value < 0:
            raise self.fault(where, f"{what} {text!r}", "a whole number, 0 or more")
        return value

    def items(self, element: Element, where: str) -> dict[int, str]:
        """Read the items of an enumeration, by value."""
        try:
            return {int(i.get("value", "")): i.get("name", "") for i in element.iterfind("Item")}
        except ValueError:
            raise self.fault(where, "an item without a whole value", "integers") from None

    def value(self, kind: VariableType, text: str, where: str) -> Any:
        """Read one start value of a type."""
        convert = _CONVERT.get(kind, int)
        try:
            return convert(text)
        except (ValueError, KeyError):
            raise self.fault(where, f"start {text!r}", f"a value of type {kind}") from None

    def declared(
        self, element: Element, types: Mapping[str, SimpleType], where: str
    ) -> tuple[SimpleType | None, dict[str, str]]:
        """Return the type that an element declares, and its attributes with those of the type."""
        name = element.get("declaredType")
        declared = None if name is None else types.get(name)
        if name is not None and declared is None:
            raise self.fault(where, f"unknown type {name!r}", "one of TypeDefinitions")
        return declared, {**(declared.attributes if declared else {}), **element.attrib}

    def variable(
        self,
        element: Element,
        attributes: Mapping[str, str],
        type_: VariableType,
        where: str,
        **more: Any,
    ) -> Variable:
        """Read what all versions of FMI have in common; `more` are the other fields of `Variable`.

        `attributes` include those of the declared type.
        """
        causality = element.get("causality", "local")
        if causality not in get_args(Causality):
            raise self.fault(where, f"causality {causality!r}", f"one of {get_args(Causality)}")
        default = "continuous" if type_ in ("Float32", "Float64") else "discrete"
        if causality in ("parameter", "calculatedParameter", "structuralParameter"):
            default = "fixed"
        variability = element.get("variability", default)
        if variability not in get_args(Variability):
            expected = f"one of {get_args(Variability)}"
            raise self.fault(where, f"variability {variability!r}", expected)
        reference = self.natural(element.get("valueReference"), "valueReference", where)
        return Variable(
            name=element.get("name", ""),
            type=type_,
            causality=causality,  # type: ignore[arg-type]
            variability=variability,  # type: ignore[arg-type]
            unit=attributes.get("unit"),
            min=self.bound(attributes, "min", type_, where),
            max=self.bound(attributes, "max", type_, where),
            initial=element.get("initial"),
            value_references=(reference,),
            **more,
        )

    def dependencies(
        self,
        root: Element,
        path: str,
        attribute: str,
        known: Mapping[int, Variable],
        noun: str,
        expected: str,
    ) -> dict[int, tuple[str, ...]]:
        """Return the inputs on which outputs are declared to depend directly.

        Outputs are the elements at `path`. Their `attribute` and their dependencies are keys of
        `known`; messages call a key `noun`, and describe what is `expected`.
        """
        declared = {}
        where = path.removesuffix("/Unknown")
        for output in root.iterfind(path):
            listed = output.get("dependencies")
            own = self.natural(output.get(attribute), attribute, where)
            numbers = [self.natural(word, "dependency", where) for word in (listed or "").split()]
            for i in (own, *numbers):
                if i not in known:
                    raise self.fault(where, f"{noun} {i}", expected)
            if listed is not None:
                inputs = (known[i] for i in numbers)
                declared[own] = tuple(v.name for v in inputs if v.causality == "input")
        return declared


def _boolean(text: str) -> bool:
    lowered = text.strip().lower()
    if lowered not in _TRUE + _FALSE:
        raise ValueError(text)
    return lowered in _TRUE


_CONVERT: Mapping[str, Callable[[str], object]] = {
    "Float32": float, "Float64": float, "Boolean": _boolean, "Clock": _boolean,
    "String": str, "Binary": bytes.fromhex,
}  # fmt: skip


def flag(element: Element, *names: str) -> bool:
    """Return whether a capability flag is set, under any of its names."""
    return any(element.get(name, "false").lower() in _TRUE for name in names)


def read_units(source: Source, root: Element) -> dict[str, Unit]:
    """Read the unit definitions; a unit without a base unit is looked up by its name."""
    units: dict[str, Unit] = {}
    for element in root.iterfind("UnitDefinitions/Unit"):
        name = source.required(element, "name", "a unit")
        where = f"unit {name!r}"
        base = element.find("BaseUnit")
        if base is None:
            _add_known(units, name)
            continue
        try:
            exponents = tuple(int(base.get(b, "0")) for b in BASE)
        except ValueError:
            raise source.fault(where, "an exponent that is not whole", "integers") from None
        factor = source.optional_number(base, "factor", where)
        offset = source.optional_number(base, "offset", where)
        units[name] = Unit(name, exponents, 1.0 if factor is None else factor, offset or 0.0)
    for variable in root.iter():
        unit = variable.get("unit")
        if unit is not None and unit not in units:
            _add_known(units, unit)
    return units


def _add_known(units: dict[str, Unit], name: str) -> None:
    try:
        units[name] = parse_unit(name)
    except ValueError:
        return
