"""File formats of systems: the functions that read and write files, by suffix.

The functions are in `orchestrator.ssp` and `orchestrator.osp`, which import this package. So they
are only named here, and imported when the first file of a format is read or written.
"""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from uuvsim_cosim.orchestrator.system.elements import Structure

__all__ = ["READERS", "read_structure", "write_structure"]

_HERE = "uuvsim_cosim.orchestrator"
READERS = {  # (path, tick=…), and variant=… of a package
    ".ssd": f"{_HERE}.ssp.ssd_reader:read_ssd",
    ".ssp": f"{_HERE}.ssp.ssp:read_ssp",
    ".xml": f"{_HERE}.osp.osp:read_osp",
}
_WRITER = f"{_HERE}.ssp.ssd:write_ssd"


def read_structure(path: Path, variant: str = "", tick: str | None = None) -> Structure:
    """Read a system from a file whose suffix is among `READERS`.

    `variant` is the variant of a package (.ssp); other formats have none. `tick` is the base step
    in s for files that define none.
    """
    suffix = path.suffix.lower()
    options = {"variant": variant} if variant and suffix == ".ssp" else {}
    structure: Structure = _function(READERS[suffix])(path, tick=tick, **options)
    return structure


def write_structure(structure: Structure, path: Path) -> None:
    """Write a system as .ssd."""
    _function(_WRITER)(structure, path)


def _function(name: str) -> Any:
    module, _, function = name.partition(":")
    return getattr(import_module(module), function)
