"""System structure packages (.ssp): read from a safe unpacking, written reproducibly."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.importer.archive import shown, unpack
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.orchestrator.ssp.ssd_reader import read_ssd
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["read_ssp", "write_archive"]

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
