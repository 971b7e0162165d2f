"""Compilation of an FMU's C sources to one WebAssembly module with all functions of FMI."""

from __future__ import annotations

import re
from pathlib import Path

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import FmuError, ToolchainError
from uuvsim_cosim.fmus.codegen.toolchain import compile_web_assembly
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.source_code import compilation_of

__all__ = ["NoWebAssembly", "first_error", "module_of_sources"]

# All functions that the sources do not hide are exported. The stack is as large as on Windows.
_FLAGS = ("-rdynamic", "-Wl,-z,stack-size=1048576",
          *(f"-D{name}=uuv_guest_{name}" for name in ("malloc", "calloc", "realloc")))  # fmt: skip


# The first error of the compiler or the linker, without the folder of its file.
_ERROR = re.compile(
    r"((?:[^/\\\s|]+:\d+:\d+: (?:fatal )?)?error: .*?)(?:; ISO C99 .*?)?(?: \[-W.*?)?(?: \| |$)"
)
_INSTEAD = "`--isolate NAME` runs it in its own process"


class NoWebAssembly(FmuError):
    """An FMU that cannot run as WebAssembly; `why` is the reason in a few words."""

    def __init__(self, place: object, read: str, expected: str, why: str = "") -> None:
        super().__init__(place, read, f"{expected}; {_INSTEAD}")
        self.why = why or read


def first_error(error: ToolchainError) -> str:
    """Return the first error that a compiler printed."""
    found = _ERROR.search(str(error))
    return str(error) if found is None else found[1]


def module_of_sources(archive: FmuArchive) -> Path:
    """Compile the C sources of an FMU into a module in the cache; raises NoWebAssembly."""
    if archive.sources is None:
        there = ", ".join(archive.binaries) or "no binary"
        raise NoWebAssembly(
            archive.path,
            f"it cannot run as WebAssembly: it has {there}, and no sources that are listed",
            "C sources or WebAssembly",
            "an FMU without C sources",
        )
    try:
        given = compilation_of(archive.path, archive.folder, archive.sources)
    except FmuError as error:
        raise NoWebAssembly(archive.path, error.problems[0].read, "plain C sources") from None
    guest = content("fmus", "sandbox", "guest.c")
    flags = [flag for flag in given.flags if not flag.startswith("-l")]
    try:
        return compile_web_assembly(
            [*given.files, guest], name=archive.model_identifier, include=given.includes,
            flags=[*flags, *_FLAGS],
        )  # fmt: skip
    except ToolchainError as error:
        first = first_error(error)
        raise NoWebAssembly(
            archive.path, f"its sources do not compile to WebAssembly: {first}",
            "sources that do", f"its sources do not compile: {first}",
        ) from None  # fmt: skip
