"""Every FMI call of an FMU, written as it happens: function, arguments, status and time.

A line begins before its call, so that after a crash the last one names the call that did it.
"""

from __future__ import annotations

import csv
import ctypes
import io
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, final

from uuvsim_cosim.closing import Closing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.component import Component
from uuvsim_cosim.fmus.importer.fmu2 import Fmu2
from uuvsim_cosim.fmus.importer.fmu3 import Fmu3
from uuvsim_cosim.fmus.importer.fmu_library import FmuLibrary, Signatures
from uuvsim_cosim.fmus.importer.message_log import STATUS
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.instantiation.instantiate import needs_own_process
from uuvsim_cosim.fmus.model_exchange.component import ModelExchange
from uuvsim_cosim.fmus.tracing.trace_arguments import Arguments

__all__ = ["Trace", "instantiate_traced"]

COLUMNS = ("wall_s", "t_s", "component", "function", "arguments", "status", "took_us")


@final
class Trace(Closing):
    """A CSV file that traced FMUs write to, one line a call; `t_s` is the time reached then."""

    def __init__(self, path: Path) -> None:
        try:
            self._sink = path.open("w", newline="", encoding="utf-8", buffering=1)
        except OSError as error:
            raise InputInvalid(
                f"{path}: cannot be written ({error.strerror}); expected a file in a folder"
            ) from None
        self._begun = time.perf_counter()
        self._sink.write(",".join(COLUMNS) + "\n")

    def begin(self, t: float | None, component: str, function: str) -> None:
        """Write who is called, before it is called."""
        wall = f"{time.perf_counter() - self._begun:.6f}"
        head = _line(wall, "" if t is None else repr(t), component, function)
        self._sink.write(head + ",")
        self._sink.flush()

    def end(self, arguments: str, status: str, seconds: float) -> None:
        """Write the rest of the line."""
        self._sink.write(_line(arguments, status, f"{1e6 * seconds:.1f}") + "\n")

    def close(self) -> None:
        """Close the file; a second call does nothing."""
        self._sink.close()


def instantiate_traced(archive: FmuArchive, path: str, trace: Trace) -> Component:
    """Instantiate an FMU in this process; every call of it goes into the trace.

    It is stepped through Python, so slower than otherwise, to the same bits: each variable is
    read by a call of its own, and inputs that have not changed are not set again.
    """
    if needs_own_process(archive):
        raise InputInvalid(
            f"{path}: {archive.path.name} needs a process of its own here, whose calls cannot be "
            "traced; expected it to be there once"
        )
    kind = Fmu2 if archive.description.kind == "FMI 2.0" else Fmu3

    def library(*arguments: Any) -> FmuLibrary:
        return _TracedLibrary(trace, path, *arguments)

    fmu = kind(archive, path, library=library)
    return ModelExchange(fmu) if archive.interface == "ModelExchange" else fmu


@final
class _TracedLibrary(FmuLibrary):
    """A library whose functions write themselves into the trace."""

    addressable = False

    def __init__(
        self, trace: Trace, path: str, archive: FmuArchive, prefix: str, signatures: Signatures
    ) -> None:
        super().__init__(archive, prefix, signatures)
        self._trace, self._path, self._name = trace, path, prefix
        self._types: Mapping[str, tuple[Any, Sequence[Any]]] = signatures
        self._arguments = Arguments(archive.description)
        self._wrapped: dict[str, Callable[..., Any]] = {}
        self._time: float | None = None

    def function(self, name: str) -> Any:
        """Bind a function; its calls are written."""
        if name not in self._wrapped:
            self._wrapped[name] = self._wrap(name, super().function(name))
        return self._wrapped[name]

    def _wrap(self, name: str, bound: Any) -> Callable[..., Any]:
        result, types = self._types[name]

        def call(*given: Any) -> Any:
            if name == "SetTime":
                self._time = given[1]
            self._trace.begin(self._time, self._path, self._name + name)
            begun = time.perf_counter()
            returned = bound(*given)
            took = time.perf_counter() - begun
            arguments = self._arguments.text(name, types, given)
            self._trace.end(arguments, _status(result, returned), took)
            if name == "DoStep":
                self._time = given[1] + given[2]
            return returned

        return call


def _status(result: Any, returned: Any) -> str:
    if result is None:
        return ""
    if result is ctypes.c_void_p:
        return "instance" if returned else "NULL"
    return STATUS[returned] if 0 <= returned < len(STATUS) else f"unknown status {returned}"


def _line(*cells: str) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()
