"""Compilation of an FMU's C sources at its first use, if it has no binary for this machine."""

from __future__ import annotations

import contextlib
import shutil
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

from uuvsim_cosim.cache import content_hash, whole_file
from uuvsim_cosim.errors import FmuError, ToolchainError
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared, fmi_headers, host
from uuvsim_cosim.fmus.importer.safe_xml import read_xml

__all__ = ["Compilation", "Sources", "compilation_of", "compiled", "read_sources"]

# GNU's C, all functions visible under their plain names, at most -O2, no instructions of this
# machine's processor only, and no library but libm.
_FLAGS = ("-std=gnu11", "-fvisibility=default", "-w", "-lm",
          "-DFMI2_OVERRIDE_FUNCTION_PREFIX", "-DFMI3_OVERRIDE_FUNCTION_PREFIX")  # fmt: skip


@dataclass(frozen=True)
class Sources:
    """Input of a compilation: files and include folders in ``sources/``, definitions, libraries."""

    files: tuple[str, ...]
    definitions: tuple[str, ...] = ()
    includes: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()  # that the sources need; they are not linked


def read_sources(folder: Path, interface: Element, identifier: str, place: str) -> Sources | None:
    """Read the list of an unpacked FMU's sources; None if there are none.

    FMI 2.0 lists files in the description, FMI 3.0 in ``sources/buildDescription.xml``.
    """
    listed = tuple(f.get("name", "") for f in interface.iterfind("SourceFiles/File"))
    if listed:
        return Sources(listed)
    build = folder / "sources" / "buildDescription.xml"
    if not build.is_file():
        return None
    root = read_xml(build, place=f"{place}/sources/buildDescription.xml")
    for configuration in root.iterfind("BuildConfiguration"):
        platform = configuration.get("platform")
        if configuration.get("modelIdentifier") != identifier:
            continue
        if platform not in (None, host().fmi3):
            continue
        names = {
            tag: tuple(e.get("name", "") for e in configuration.iterfind(tag))
            for tag in ("SourceFileSet/SourceFile", "SourceFileSet/IncludeDirectory", "Library")
        }
        files, includes, external = names.values()
        definitions = tuple(
            d.get("name", "") + ("" if d.get("value") is None else f"={d.get('value')}")
            for d in configuration.iterfind("SourceFileSet/PreprocessorDefinition")
            if d.get("optional") != "true"
        )
        libraries = tuple(name for name in external if name not in ("m", "libm"))
        return Sources(files, definitions, includes, libraries)
    return None


@dataclass(frozen=True)
class Compilation:
    """Arguments of a compiler: C files, folders of headers, and options."""

    files: list[Path]
    includes: list[Path]
    flags: list[str]


def compilation_of(archive: Path, folder: Path, sources: Sources) -> Compilation:
    """Return the arguments for an unpacked FMU's sources; raises FmuError if not plain C."""
    root = folder / "sources"
    if sources.libraries:
        raise FmuError(
            archive,
            f"its sources need the library {', '.join(sources.libraries)}",
            f"none but C's own, or a binary for {host().fmi2}",
        )
    files = [_inside(root, name, archive) for name in sources.files]
    foreign = [f.name for f in files if f.suffix.lower() != ".c"]
    if foreign:
        raise FmuError(
            archive,
            f"its source {foreign[0]} is not C",
            f".c files, or a binary for {host().fmi2}",
        )
    includes = [root, *(_inside(root, name, archive) for name in sources.includes)]
    includes.append(fmi_headers())  # for sources without their own
    # Sources include each other: the key of the cache depends on all files in the folder.
    every = sorted(f for f in root.rglob("*") if f.is_file())
    key = content_hash([str(f.relative_to(root)) for f in every] + [f.read_bytes() for f in every])
    flags = [*_FLAGS, *(f"-D{d}" for d in sources.definitions), f"-DUUVSIM_SOURCES={key}"]
    return Compilation(files, includes, flags)


def compiled(archive: Path, folder: Path, identifier: str, sources: Sources) -> Path:
    """Return the library of an FMU's sources, beside the unpacked files; compiled if missing.

    Raises FmuError with the compiler's message.
    """
    machine = host()
    library = folder / "compiled" / machine.fmi2 / f"{identifier}{machine.suffix}"
    if library.is_file():
        return library
    given = compilation_of(archive, folder, sources)
    try:
        made = compile_shared(
            given.files, name=identifier, include=given.includes, flags=given.flags
        )
    except ToolchainError as error:
        raise FmuError(
            f"{archive}: has no binary for {machine.fmi2}, and its sources do not compile: {error}"
        ) from None
    library.parent.mkdir(parents=True, exist_ok=True)
    # PermissionError: on Windows, another process uses the same library already.
    with contextlib.suppress(PermissionError), whole_file(library) as fresh:
        shutil.copyfile(made, fresh)
    return library


def _inside(root: Path, name: str, archive: Path) -> Path:
    path = (root / name).resolve()
    if not path.is_relative_to(root.resolve()) or not path.exists():
        raise FmuError(archive, f"its source {name!r} is not there", "it in sources/")
    return path
