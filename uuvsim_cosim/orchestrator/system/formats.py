"""File formats of systems: the functions that read and write files, by suffix.

The functions are in `orchestrator.ssp` and `orchestrator.osp`, which import this package. So they
are only named here, and imported when the first file of a format is read or written.
"""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.lazy import by_name
from uuvsim_cosim.orchestrator.system.elements import Structure

__all__ = ["READERS", "read_structure", "write_structure"]

_HERE = "orchestrator"
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
    structure: Structure = by_name(READERS[suffix])(path, tick=tick, **options)
    return structure


def write_structure(structure: Structure, path: Path) -> None:
    """Write a system as .ssd."""
    by_name(_WRITER)(structure, path)
