"""The file of a survey's settings: beside a system, and kept in the folder of a run.

Each run looks for it, so that this file imports none of the mapping.
"""

from __future__ import annotations

from pathlib import Path

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.modeline import headed, keep_schemas

__all__ = ["FILE", "keep_settings", "settings_of_system"]

FILE = "mapping.yaml"


def settings_of_system(system: str) -> Path | None:
    """Return the file of settings of a system, by its name or its .ssd; None if it has none."""
    path = Path(system)
    beside = path.parent if path.suffix.lower() in (".ssd", ".ssp") else None
    folder = beside or content("orchestrator", "systems") / system
    file = folder / FILE
    return file if file.is_file() else None


def keep_settings(file: Path, run: Path) -> None:
    """Copy settings into the folder of a run, so that its map can be made again."""
    try:
        text = headed("mapping", file.read_text(encoding="utf-8"))
        (run / FILE).write_text(text, encoding="utf-8")
        keep_schemas(run / FILE)
    except OSError as error:
        raise InputInvalid(f"{run / FILE}: cannot be written ({error.strerror})") from None
