"""The survey of a run: settings, scene and track together make the map, points and files."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from uuvsim_cosim.errors import InputInvalid
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
from uuvsim_cosim.scene.mapping.recorded_scans import recorded_sonde
from uuvsim_cosim.scene.mapping.survey_settings import FILE, SurveySettings, read_settings
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["FORMATS", "Survey", "survey_of"]

FORMATS = (".tif", ".tiff", ".laz", ".las", ".ply")


@dataclass(frozen=True, eq=False)
class Survey:
    """A track above a scene, and what it is mapped with."""

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
        made = map_seabed(self.track, self.caster, s.sondes, s.cell, s.scene, progress)
        return replace(made, crs=self.crs, northing=self.northing, easting=self.easting,
                       vertical_datum=self.vertical_datum)  # fmt: skip

    def write(self, file: Path, made: SeabedMap, pose: str = "true", every: int = 1) -> int:
        """Write the map (.tif) or the points (.laz, .las, .ply); gives cells or points written."""
        kind = file.suffix.lower()
        if kind not in FORMATS:
            raise InputInvalid(f"{file}: expected a name that ends with {', '.join(FORMATS)}")
        check_target(file, self.crs)
        if kind in (".tif", ".tiff"):
            write_geotiff(made, file, pose)
            return made.window.rows * made.window.columns
        batches = run_points(self.track, self.caster, self.settings.sondes, pose, every)
        if kind == ".ply":
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
        recorded = [recorded_sonde(run, component, signals) for component in settings.components]
        settings = replace(settings, sondes=(*settings.sondes, *recorded))
    scene = scene_named(settings.scene)
    terrain = scene.terrain
    if terrain is None:
        raise InputInvalid(f"scene {settings.scene}", "has no terrain", "one to map")
    return Survey(track, Caster(scene), settings, terrain.crs, terrain.northing, terrain.easting,
                  terrain.vertical_datum)  # fmt: skip
