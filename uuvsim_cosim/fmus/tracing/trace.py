"""Trace of all FMI calls of an FMU: function, arguments, status and time.

A line is begun before its call, so that after a crash the last line names the call that crashed.
"""

from __future__ import annotations

import csv
import ctypes
import io
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.toolchain import Signatures
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.description import Description
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary
from uuvsim_cosim.fmus.importer.message_log import STATUS
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.versions import version_of
from uuvsim_cosim.fmus.instantiation.instantiate import needs_own_process
from uuvsim_cosim.fmus.scheduled_execution.component import component_of

__all__ = ["Arguments", "Trace", "instantiate_traced"]

COLUMNS = ("wall_s", "t_s", "component", "function", "arguments", "status", "took_us")


@final
class Trace(Closing):
    """A CSV file of traced FMUs, with one line for each call; `t_s` is the time reached then.

    A call in which the FMU calls back, and is called from there, has a line before these calls,
    which ends with "calls back", and its own line after them.
    """

    def __init__(self, path: Path) -> None:
        try:
            self._sink = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputInvalid(
                path, f"cannot be written ({error.strerror})", "a file in a folder"
            ) from None
        self._begun = time.perf_counter()
        self._heads: list[str] = []  # of the calls that have not returned
        self._is_open = False  # the last line is not complete
        self._sink.write(",".join(COLUMNS) + "\n")

    def begin(self, t: float | None, component: str, function: str) -> None:
        """Write the component and the function, before the call."""
        wall = f"{time.perf_counter() - self._begun:.6f}"
        head = _line(wall, "" if t is None else repr(t), component, function)
        if self._is_open:
            self._sink.write(_line("calls back", "", "") + "\n")
        self._heads.append(head)
        self._is_open = True
        self._sink.write(head + ",")
        self._sink.flush()

    def end(self, arguments: str, status: str, seconds: float) -> None:
        """Write the rest of the line, after the call."""
        head = self._heads.pop()
        again = "" if self._is_open else head + ","
        self._is_open = False
        self._sink.write(again + _line(arguments, status, f"{1e6 * seconds:.1f}") + "\n")

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._sink.close()


def instantiate_traced(archive: FmuArchive, path: str, trace: Trace) -> Component:
    """Instantiate an FMU in this process; each of its calls is written to the trace.

    It is stepped by Python, which is slower but gives the same bits: each variable is read by a
    separate call, and inputs that have not changed are not set again.
    """
    if needs_own_process(archive):
        raise InputInvalid(
            path,
            f"{archive.path.name} needs a separate process here, whose calls cannot be traced",
            "one instance of it",
        )
    fmu = version_of(archive)(archive, path, library=partial(_TracedLibrary, trace, path))
    return component_of(fmu)


@final
class _TracedLibrary(FmuLibrary):
    """A library whose calls are written to the trace."""

    addressable = False

    def __init__(
        self, trace: Trace, path: str, archive: FmuArchive, prefix: str, signatures: Signatures
    ) -> None:
        super().__init__(archive, prefix, signatures)
        self._trace, self._path, self._name = trace, path, prefix
        self._types = signatures
        self._arguments = Arguments(archive.description)
        self._wrapped: dict[str, Callable[..., Any]] = {}
        self._time: float | None = None  # reached by the last step

    def function(self, name: str) -> Callable[..., Any]:
        """Bind a function whose calls are written to the trace."""
        if name in self._wrapped:
            return self._wrapped[name]
        bound = super().function(name)
        result, types = self._types[name]

        def call(*given: Any) -> object:
            if name == "SetTime":
                self._time = given[1]
            self._trace.begin(self._time, self._path, self._name + name)
            begun = time.perf_counter()
            returned = bound(*given)
            took = time.perf_counter() - begun
            arguments = self._arguments.text(name, types, given)
            if result is None:
                status = ""
            elif result is ctypes.c_void_p:
                status = "instance" if returned else "NULL"
            else:
                known = 0 <= returned < len(STATUS)
                status = STATUS[returned] if known else f"unknown status {returned}"
            self._trace.end(arguments, status, took)
            if name == "DoStep":
                self._time = given[1] + given[2]
            return returned

        self._wrapped[name] = call
        return call


def _line(*cells: str) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()


_TYPES_1 = {"Real": ctypes.c_double, "Integer": ctypes.c_int, "Boolean": ctypes.c_int8}
_TYPES_2 = {**_TYPES_1, "Boolean": ctypes.c_int}
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
        of_version = {"FMI 1.0": _TYPES_1, "FMI 2.0": _TYPES_2, "FMI 3.0": _TYPES_3}
        self._types: Mapping[str, type] = of_version[description.kind]
        self._names: dict[tuple[str, int], str] = {}
        for v in description.variables.values():
            family = "" if self._types is _TYPES_3 else _FAMILY.get(v.type, v.type)
            for i, reference in enumerate(v.value_references):
                name = v.element_name(i) if len(v.value_references) > 1 else v.name
                self._names.setdefault((family, reference), name)  # the first of several aliases

    def text(self, function: str, types: Sequence[type], given: Sequence[Any]) -> str:
        """Return the arguments after the instance, including the values that the call returned."""
        verb, suffix = function[:3], function[3:]
        if verb in ("Get", "Set") and (suffix in self._types or suffix in ("String", "Binary")):
            references = list(given[1])
            family = "" if self._types is _TYPES_3 else suffix
            names = [self._names.get((family, r), f"#{r}") for r in references]
            if suffix == "Binary":
                values = [f"{n} bytes" for n in given[3]]
            elif suffix == "String":
                values = [repr((text or b"").decode(errors="replace")) for text in given[3]]
            else:
                count = given[4] if len(given) > 4 else len(references)
                values = [repr(x) for x in _array(given[3], self._types[suffix], count)]
            return f"{' '.join(names)} = {' '.join(values)}"
        if verb in ("Get", "Set") and any(w in function for w in _VECTORS) and len(given) == 3:
            return " ".join(map(repr, _array(given[1], ctypes.c_double, given[2])))
        first = 0 if function.startswith("Instantiate") else 1
        shown = (_plain(x, t) for x, t in zip(given[first:], types[first:], strict=True))
        return " ".join(s for s in shown if s)


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
