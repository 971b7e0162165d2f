"""Settings of a survey: `mapping.yaml` beside a system or in a run's folder."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.parameter_files import read_yaml
from uuvsim_cosim.scene.mapping.scans import Sonde, sonde

__all__ = ["FILE", "SurveySettings", "keep_settings", "read_settings", "settings_of_system"]

FILE = "mapping.yaml"


@dataclass(frozen=True, eq=False)
class SurveySettings:
    """The scene (id or path), the map's cell [m], its sensors, and sensors of the system itself."""

    scene: str
    cell: float
    sondes: tuple[Sonde, ...]
    components: tuple[str, ...] = ()

    def changed(self, scene: str = "", cell: float | None = None) -> SurveySettings:
        """Return settings with another scene or cell."""
        return replace(self, scene=scene or self.scene, cell=self.cell if cell is None else cell)


def read_settings(file: Path) -> SurveySettings:
    """Read settings; raises ParameterInvalid with every mistake by its line."""
    data = read_yaml(file, "mapping.schema.json")
    given = list(enumerate(data["sensors"]))
    sondes = tuple(_sonde(file, i, one) for i, one in given if "component" not in one)
    components = tuple(str(one["component"]) for _, one in given if "component" in one)
    scene = str(data["scene"])
    beside = file.parent / scene
    return SurveySettings(
        str(beside) if "/" in scene or scene.endswith(".npz") else scene,
        float(data.get("cell", 0.1)),
        sondes,
        components,
    )


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
        shutil.copyfile(file, run / FILE)
    except OSError as error:
        raise InputInvalid(f"{run / FILE}: cannot be written ({error.strerror})") from None


def _sonde(file: Path, i: int, given: Mapping[str, Any]) -> Sonde:
    kind = str(given["kind"])
    options = {k: int(given[k]) for k in ("columns", "rows", "beams") if k in given}
    known = ("columns", "rows") if kind == "depth_camera" else ("beams",)
    foreign = [k for k in options if k not in known]
    if foreign:
        raise InputInvalid(file, f"sensors.{i}: a {kind} has no {foreign[0]}", " and ".join(known))
    try:
        return sonde(kind, str(given["preset"]), float(given["period"]), **options)
    except UuvsimError as error:
        raise InputInvalid(f"{file}: sensors.{i}: {error}") from None
