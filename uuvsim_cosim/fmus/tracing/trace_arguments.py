"""The arguments of an FMI call as text: the names of variables, and values."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping, Sequence
from typing import Any, final

from uuvsim_cosim.fmus.description import Description

__all__ = ["Arguments"]

_TYPES_2 = {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int}
_TYPES_3 = {
    "Float64": ctypes.c_double, "Float32": ctypes.c_float, "Boolean": ctypes.c_bool,
    "Int8": ctypes.c_int8, "Int16": ctypes.c_int16, "Int32": ctypes.c_int32,
    "Int64": ctypes.c_int64, "UInt8": ctypes.c_uint8, "UInt16": ctypes.c_uint16,
    "UInt32": ctypes.c_uint32, "UInt64": ctypes.c_uint64,
}  # fmt: skip
_VECTORS = ("ContinuousStates", "Derivatives", "EventIndicators")  # of doubles
_FAMILY = {"Float64": "Real", "Int32": "Integer", "Enumeration": "Integer"}


@final
class Arguments:
    """The arguments of calls of one FMU as text."""

    def __init__(self, description: Description) -> None:
        self._types: Mapping[str, type] = _TYPES_2 if description.kind == "FMI 2.0" else _TYPES_3
        self._names: dict[tuple[str, int], str] = {}
        for v in description.variables.values():
            family = _FAMILY.get(v.type, v.type) if description.kind == "FMI 2.0" else ""
            for i, reference in enumerate(v.value_references):
                name = v.element_name(i) if len(v.value_references) > 1 else v.name
                self._names.setdefault((family, reference), name)  # the first of several aliases

    def text(self, function: str, types: Sequence[type], given: Sequence[Any]) -> str:
        """Return the arguments after the instance, including the values that the call returned."""
        verb, suffix = function[:3], function[3:]
        if verb in ("Get", "Set") and (suffix in self._types or suffix in ("String", "Binary")):
            return self._values(suffix, given)
        if verb in ("Get", "Set") and any(w in function for w in _VECTORS) and len(given) == 3:
            return " ".join(map(repr, _array(given[1], ctypes.c_double, given[2])))
        first = 0 if function.startswith("Instantiate") else 1
        shown = (_plain(x, t) for x, t in zip(given[first:], types[first:], strict=True))
        return " ".join(s for s in shown if s)

    def _values(self, suffix: str, given: Sequence[Any]) -> str:
        """Return the names and values of a Get or Set function."""
        references = list(given[1])
        family = suffix if self._types is _TYPES_2 else ""
        names = [self._names.get((family, r), f"#{r}") for r in references]
        if suffix == "Binary":
            return f"{' '.join(names)} = {' '.join(f'{n} bytes' for n in given[3])}"
        if suffix == "String":
            values = [repr((text or b"").decode(errors="replace")) for text in given[3]]
        else:
            count = given[4] if len(given) > 4 else len(references)
            values = [repr(x) for x in _array(given[3], self._types[suffix], count)]
        return f"{' '.join(names)} = {' '.join(values)}"


def _array(place: Any, type_: Any, count: int) -> list[object]:
    """Read an array at an address or pointer."""
    address = place if isinstance(place, int) else ctypes.cast(place, ctypes.c_void_p).value
    return list((type_ * count).from_address(address or 0)) if address else []


def _plain(value: object, type_: type) -> str:
    """Return a number or text, also one that `ctypes.byref` points to; empty for other pointers."""
    if isinstance(value, bytes):
        return repr(value.decode(errors="replace"))
    pointed = getattr(value, "_obj", None)
    if pointed is None:
        return "" if type_ is ctypes.c_void_p else repr(value)
    if isinstance(pointed, ctypes.c_void_p):
        return ""
    if hasattr(pointed, "value"):
        return f"-> {pointed.value!r}"
    fields = getattr(pointed, "_fields_", ())
    return "-> " + " ".join(f"{name}={getattr(pointed, name)!r}" for name, *_ in fields)
