"""Systems by name (those of this package) or by file."""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.orchestrator.system.formats import READERS, read_structure
from uuvsim_cosim.orchestrator.system.sources import FmuSource
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["available", "load", "system_file"]


def available() -> list[str]:
    """Return the names of the shipped systems.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> uuv.available()[:2]
    ['bluerov2_ardusub', 'bluerov2_hold']
    """
    folder = content("orchestrator", "systems")
    if not folder.is_dir():
        return []
    return sorted(p.name for p in folder.iterdir() if _file_in(p) is not None)


def system_file(name: str) -> Path:
    """Return the .ssd file of a shipped system."""
    folder = content("orchestrator", "systems")
    found = _file_in(folder / name) if name.isprintable() and "/" not in name else None
    if found is None:
        names = available()
        raise InputInvalid(
            f"there is no system {name!r}{did_you_mean(name, names)}",
            f"one of {', '.join(names) or 'none'}, or a path to an .ssd, .ssp or .fmu",
        )
    return found


def load(name_or_path: str | Path, tick: str | None = None) -> System:
    """Load a system by the name of a shipped one, or from a file.

    `name_or_path` is a name, or a path: .ssd, .ssp (``x.ssp#VariantB``), .fmu, or OSP's .xml.
    `tick` is the base step [s] for files that define none. Raises InputInvalid for a name or a file
    that does not exist, SystemInvalid for a system that is not valid, FmuError for an FMU that
    cannot be read.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> system = uuv.load("bluerov2_hold")
    >>> len(system.components), float(system.base_step)  # [s]
    (13, 0.01)
    """
    text = str(name_or_path)
    file, _, variant = text.partition("#")
    path = Path(file).expanduser()
    suffix = path.suffix.lower()
    if suffix not in (".fmu", *READERS):
        path, suffix = system_file(text), ".ssd"
    if not path.is_file():
        raise InputInvalid(path, "no such file", "an .ssd, .ssp, .fmu or .xml")
    path = path.absolute()
    if suffix == ".fmu":
        # A system of one FMU, with the step of its default experiment.
        description = FmuSource(path).describe()
        step = tick or description.default_step_size or "0.01"
        name = "".join(c if c.isalnum() or c == "_" else "_" for c in path.stem)
        return System(name, step, description.description, base=path.parent).add(name, path.name)
    system = read_structure(path, variant, tick)
    assert isinstance(system, System)
    return system


def _file_in(folder: Path) -> Path | None:
    for name in (f"{folder.name}.ssd", "SystemStructure.ssd"):
        if (folder / name).is_file():
            return folder / name
    return None
