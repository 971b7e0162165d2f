"""The survey of a run: settings, scene and track together make the map, points and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.parameter_files import read_yaml
from uuvsim_cosim.models.worlds.ground import scene_named
from uuvsim_cosim.scene.mapping.map_files import check_target, write_geotiff, write_las, write_ply
from uuvsim_cosim.scene.mapping.mapping import (
    Progress,
    SeabedMap,
    Track,
    map_seabed,
    run_points,
    track_of_run,
)
from uuvsim_cosim.scene.mapping.scans import RangeSensor, range_sensor, recorded_sensor
from uuvsim_cosim.scene.mapping.settings_file import FILE
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = [
    "FORMATS",
    "Survey",
    "SurveySettings",
    "read_settings",
    "survey_of",
]

FORMATS = (".tif", ".tiff", ".laz", ".las", ".ply")


@dataclass(frozen=True, eq=False)
class SurveySettings:
    """The scene (id or path), the map's cell [m], its sensors, and sensors of the system itself."""

    scene: str
    cell: float
    sensors: tuple[RangeSensor, ...]
    components: tuple[str, ...] = ()

    def changed(self, scene: str = "", cell: float | None = None) -> SurveySettings:
        """Return settings with another scene or cell."""
        return replace(self, scene=scene or self.scene, cell=self.cell if cell is None else cell)


def read_settings(file: Path) -> SurveySettings:
    """Read settings; raises ParameterInvalid with every mistake by its line."""
    data = read_yaml(file, "mapping.schema.json")
    sensors, components = [], []
    for i, given in enumerate(data["sensors"]):
        if "component" in given:
            components.append(str(given["component"]))
            continue
        sensor = str(given["kind"])
        options = {k: int(given[k]) for k in ("columns", "rows", "beams") if k in given}
        known = ("columns", "rows") if sensor == "depth_camera" else ("beams",)
        if foreign := [k for k in options if k not in known]:
            raise InputInvalid(
                file, f"sensors.{i}: a {sensor} has no {foreign[0]}", " and ".join(known)
            )
        try:
            made = range_sensor(sensor, str(given["preset"]), float(given["period"]), **options)
        except UuvsimError as error:
            raise InputInvalid(f"{file}: sensors.{i}: {error}") from None
        sensors.append(made)
    scene = str(data["scene"])
    beside = file.parent / scene
    return SurveySettings(
        str(beside) if "/" in scene or scene.endswith(".npz") else scene,
        float(data.get("cell", 0.1)),
        tuple(sensors),
        tuple(components),
    )


@dataclass(frozen=True, eq=False)
class Survey:
    """A track above a scene, with the sensors and settings of its map."""

    track: Track
    caster: Caster
    settings: SurveySettings
    crs: str = ""
    northing: float = 0.0
    easting: float = 0.0
    vertical_datum: str = ""

    def map(self, progress: Progress | None = None) -> SeabedMap:
        """Make the map, by each pose of the track."""
        s = self.settings
        made = map_seabed(self.track, self.caster, s.sensors, s.cell, s.scene, progress)
        return replace(made, crs=self.crs, northing=self.northing, easting=self.easting,
                       vertical_datum=self.vertical_datum)  # fmt: skip

    def write(self, file: Path, made: SeabedMap, pose: str = "true", every: int = 1) -> int:
        """Write the map (.tif) or the points (.laz, .las, .ply); return the number of either."""
        ending = file.suffix.lower()
        if ending not in FORMATS:
            raise InputInvalid(f"{file}: expected a name that ends with {', '.join(FORMATS)}")
        check_target(file, self.crs)
        if ending in (".tif", ".tiff"):
            write_geotiff(made, file, pose)
            return made.window.rows * made.window.columns
        batches = run_points(self.track, self.caster, self.settings.sensors, pose, every)
        if ending == ".ply":
            return write_ply(batches, file)
        return write_las(batches, file, self.crs, (self.northing, self.easting))


def survey_of(run: Path, settings: SurveySettings | None = None) -> Survey:
    """Return the survey of a run's folder, by its own settings or others."""
    if settings is None:
        file = run / FILE
        if not file.is_file():
            raise InputInvalid(run, f"has no {FILE}", "a run of seabed_mapping, or --settings FILE")
        settings = read_settings(file)
    track = track_of_run(run)
    if settings.components:
        from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals

        signals = read_signals(run)
        recorded = [recorded_sensor(run, component, signals) for component in settings.components]
        settings = replace(settings, sensors=(*settings.sensors, *recorded))
    scene = scene_named(settings.scene)
    terrain = scene.terrain
    if terrain is None:
        raise InputInvalid(f"scene {settings.scene}", "has no terrain", "one to map")
    return Survey(track, Caster(scene), settings, terrain.crs, terrain.northing, terrain.easting,
                  terrain.vertical_datum)  # fmt: skip
