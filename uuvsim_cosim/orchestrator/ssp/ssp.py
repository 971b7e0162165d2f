"""System structure packages (.ssp): read from a safe unpacking, written reproducibly."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid, Problem, SystemInvalid
from uuvsim_cosim.fmus.importer.archive import shown, unpack
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.parameters.ssp_xml import SspVersion
from uuvsim_cosim.orchestrator.plan.seeds import component_seed
from uuvsim_cosim.orchestrator.ssp.ssd import format_ssd
from uuvsim_cosim.orchestrator.ssp.ssd_reader import read_ssd
from uuvsim_cosim.orchestrator.system.elements import Element
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.sources import FmuSource, ModelSource, TableSource
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["pack", "read_ssp", "write_archive"]

_EPOCH = (1980, 1, 1, 0, 0, 0)


def read_ssp(path: Path, variant: str = "SystemStructure.ssd", tick: str | None = None) -> System:
    """Read the system of a package; `variant` names another .ssd at its top."""
    folder = unpack(path)
    names = sorted(p.name for p in folder.glob("*.ssd"))
    name = variant if variant.lower().endswith(".ssd") else f"{variant}.ssd"
    if name not in names:
        stems = [Path(n).stem for n in names]
        expected = expected_names(Path(name).stem, stems, "a variant")
        raise InputInvalid(shown(path), f"no variant {variant!r}", expected)
    return read_ssd(folder / name, tick, confined=True)


def write_archive(members: Mapping[str, bytes], path: Path) -> None:
    """Write a zip archive, never an incomplete one; equal members give equal bytes."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(members, key=lambda n: (n != "SystemStructure.ssd", n)):
            info = zipfile.ZipInfo(name, _EPOCH)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            info.create_system = 3
            archive.writestr(info, members[name])
    try:
        write_whole(path, buffer.getvalue())
    except OSError as error:
        raise InputInvalid(
            path, f"cannot be written ({error.strerror})", "a folder that can be written"
        ) from None


def pack(
    system: System,
    path: Path,
    fmi: Literal[2, 3] = 2,
    seed: int = 0,
    platforms: Sequence[str] = ("host",),
) -> None:
    """Write a system as .ssp with all its FMUs inside: FMI 2 and SSP 1.0, or FMI 3 and SSP 2.0.

    Each component's seed is written as a value, so that other tools draw the same numbers.
    Raises SystemInvalid for components that are neither declarations nor FMUs.
    """
    with TemporaryDirectory(prefix="uuvsim-pack-") as scratch:
        packing = _Packing(fmi, seed, tuple(platforms), Path(scratch))
        packed = packing.packed(system, "")
        if packing.problems:
            raise SystemInvalid(packing.problems)
        version: SspVersion = "1.0" if fmi == 2 else "2.0"
        members = {f"resources/{f.name}": f.read_bytes() for f in packing.resources.iterdir()}
        members["SystemStructure.ssd"] = format_ssd(packed, version, Path(scratch))
    write_archive(members, path)


class _Packing:
    """Folder with the FMUs of a system, each source once."""

    def __init__(
        self, fmi: Literal[2, 3], seed: int, platforms: tuple[str, ...], folder: Path
    ) -> None:
        self.fmi, self.seed, self.platforms, self.folder = fmi, seed, platforms, folder
        self.resources = folder / "resources"
        self.resources.mkdir()
        self.files: dict[str, str] = {}
        self.problems: list[Problem] = []

    def packed(self, system: System, prefix: str) -> System:
        elements = tuple(self._element(system, e, prefix) for e in system.elements)
        if self.problems:
            return system
        return replace(system, elements=elements, base=self.folder)

    def _element(self, system: System, element: Element, prefix: str) -> Element:
        path = prefix + element.name
        nested = system.nested_or_none(element.name)
        if nested is not None:
            return replace(element, source=self.packed(nested, f"{path}."))
        assert isinstance(element.source, str)
        source = resolve(element.source, system.base)
        if source.text not in self.files:
            problem: Problem | None = None
            if isinstance(source, ModelSource):
                from uuvsim_cosim.fmus.export.fmu_file import build_fmu

                file = build_fmu(source.declare(), fmi=self.fmi, platforms=self.platforms)
            elif not isinstance(source, FmuSource | TableSource):
                expected = "an FMU or a model, which other tools can run"
                problem = Problem(path, f"a {source.kind} component", expected)
            else:
                file = source.path
                if self.fmi == 2 and source.describe().kind == "FMI 3.0":
                    read = f"{file.name} is FMI 3.0, which SSP 1.0 does not know"
                    problem = Problem(path, read, "FMI 2.0, or packing as FMI 3")
            if problem is not None:
                self.problems.append(problem)
                return element
            name = file.name
            if (self.resources / name).exists():
                name = f"{file.stem}_{path.replace('.', '_')}{file.suffix}"
            (self.resources / name).write_bytes(file.read_bytes())
            self.files[source.text] = name
        start = dict(element.start)
        if "seed" in system.checked.descriptions[element.name].variables:
            start.setdefault("seed", component_seed(self.seed, path))
        packed = f"resources/{self.files[source.text]}"
        options = source.text.partition("#")[2] if isinstance(source, FmuSource) else ""
        return replace(element, source=f"{packed}#{options}" if options else packed, start=start)
