"""A binary for WebAssembly in an FMU that comes with C sources."""

from __future__ import annotations

import zipfile
from pathlib import Path

from uuvsim_cosim.errors import FmuError, InputInvalid, ToolchainError
from uuvsim_cosim.fmus.codegen.toolchain import WASM32
from uuvsim_cosim.fmus.export.fmu_file import write_archive
from uuvsim_cosim.fmus.export.web_assembly import MANIFEST, component_file, manifest
from uuvsim_cosim.fmus.importer.read_description import read_fmu
from uuvsim_cosim.fmus.importer.safe_xml import read_xml
from uuvsim_cosim.fmus.importer.source_code import compilation_of
from uuvsim_cosim.fmus.sandbox.sources import first_error

__all__ = ["add_web_assembly"]


def add_web_assembly(fmu: Path, target: Path) -> Path:
    """Write a copy of an FMI 3.0 FMU with a component of its C sources; return its path.

    `target` is a folder, or a file that ends in .fmu. Raises FmuError for an FMU without plain C
    sources or of another version, and for sources that do not compile to WebAssembly.
    """
    archive = read_fmu(fmu)
    file = target if target.suffix == ".fmu" else target / fmu.name
    if file.resolve() == fmu.resolve():
        raise InputInvalid(file, "the FMU itself", "another file or folder to write")
    if archive.description.kind != "FMI 3.0":
        version = archive.description.kind
        raise FmuError(
            fmu, f"{version}, for which the layered standard has no WebAssembly", "FMI 3.0"
        )
    if archive.sources is None:
        raise FmuError(fmu, "no C sources that are listed", "an FMU with C sources")
    given = compilation_of(fmu, archive.folder, archive.sources)
    try:
        component = component_file(
            given.files,
            name=archive.model_identifier,
            description=read_xml(archive.folder / "modelDescription.xml", place=str(fmu)),
            include=given.includes,
            flags=[flag for flag in given.flags if not flag.startswith("-l")],
        )
    except ToolchainError as error:
        raise FmuError(
            f"{fmu}: its sources do not compile to WebAssembly: {first_error(error)}"
        ) from None
    with zipfile.ZipFile(fmu) as zipped:
        members = {i.filename: zipped.read(i) for i in zipped.infolist() if not i.is_dir()}
    members[f"binaries/{WASM32.fmi3}/{archive.model_identifier}.wasm"] = component.read_bytes()
    members[MANIFEST] = manifest().encode()
    write_archive(file, members)
    return file
