"""Compilation of an FMU's C sources to one WebAssembly module with all functions of FMI."""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import FmuError, ToolchainError
from uuvsim_cosim.fmus.codegen.toolchain import compile_web_assembly
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.source_code import compilation_of

__all__ = ["module_of_sources"]

# All functions that the sources do not hide are exported. The stack is as large as on Windows.
_FLAGS = ("-rdynamic", "-Wl,-z,stack-size=1048576",
          *(f"-D{name}=uuv_guest_{name}" for name in ("malloc", "calloc", "realloc")))  # fmt: skip


def module_of_sources(archive: FmuArchive) -> Path:
    """Compile the C sources of an FMU into a module in the cache; raises FmuError."""
    if archive.sources is None:
        there = ", ".join(archive.binaries) or "no binary"
        raise FmuError(
            archive.path,
            f"it cannot run as WebAssembly: it has {there}, and no sources that are listed",
            "C sources or WebAssembly; `--isolate NAME` runs a binary in its own process",
        )
    given = compilation_of(archive.path, archive.folder, archive.sources)
    guest = content("fmus", "sandbox", "guest.c")
    flags = [flag for flag in given.flags if not flag.startswith("-l")]
    try:
        return compile_web_assembly(
            [*given.files, guest], name=archive.model_identifier, include=given.includes,
            flags=[*flags, *_FLAGS],
        )  # fmt: skip
    except ToolchainError as error:
        raise FmuError(
            f"{archive.path}: its sources do not compile to WebAssembly: {error}"
        ) from None
