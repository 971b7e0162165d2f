"""`uuvsim map`, and the map after `uuvsim run`: the seabed of a run, or its points, as a file."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.run.summary import figure_table
from uuvsim_cosim.commands.shared.completion import of
from uuvsim_cosim.commands.shared.progress import RunProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, notice, number
from uuvsim_cosim.errors import InputInvalid, UuvsimError

if TYPE_CHECKING:
    from uuvsim_cosim.scene.mapping.mapping import SeabedMap

__all__ = ["map_command", "mapped"]


def map_command(
    run: Annotated[Path, typer.Argument(help="Folder that `uuvsim run` wrote.")],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="File to write: the map as .tif, or points as .laz, .las or .ply."
        ),
    ] = None,
    pose: Annotated[
        str,
        typer.Option(
            autocompletion=of("true", "navigation"),
            help="Pose of the vehicle to use: true or navigation.",
        ),
    ] = "true",
    every: Annotated[int, typer.Option(help="With points: write those of every N-th frame.")] = 10,
    settings: Annotated[
        Path | None, typer.Option(help="YAML file of scene and sensors, if not those of the run.")
    ] = None,
    scene: Annotated[
        str, typer.Option(help="Scene or terrain (.npz), if not that of the run.")
    ] = "",
    cell: Annotated[float | None, typer.Option(help="Cell size of the map in m.")] = None,
) -> None:
    """Map the seabed that a run surveyed, and write the map or its points."""
    from uuvsim_cosim.scene.mapping.map_files import check_target
    from uuvsim_cosim.scene.mapping.mapping import read_map, write_map
    from uuvsim_cosim.scene.mapping.settings_file import FILE, keep_settings
    from uuvsim_cosim.scene.mapping.survey import FORMATS, read_settings, survey_of
    from uuvsim_cosim.view.reports.survey_map import map_figures

    if every < 1:
        raise InputInvalid(f"--every {every}: expected 1 or more")
    if out is not None and out.suffix.lower() not in FORMATS:
        raise InputInvalid(f"--out {out}: expected a name that ends with {', '.join(FORMATS)}")
    if out is not None:
        check_target(out)
    if not run.is_dir():
        raise InputInvalid(run, "no such folder", "one that `uuvsim run` wrote")
    given = None if settings is None else read_settings(settings)
    if given is None and (scene or cell is not None) and (run / FILE).is_file():
        given = read_settings(run / FILE)
    survey = survey_of(run, given if given is None else given.changed(scene, cell))
    if out is not None:
        check_target(out, survey.crs)
    if pose not in survey.track.poses:
        raise InputInvalid(f"--pose {pose}: expected {' or '.join(survey.track.poses)}")
    made = None
    if given is None:
        with suppress(InputInvalid):  # a damaged one is made again
            made = read_map(run)
    if made is None:
        made = survey.map()
        if given is None or settings is not None:
            write_map(made, run)
        if settings is not None and settings.absolute() != (run / FILE).absolute():
            keep_settings(settings, run)
    figure_table(map_figures(made))
    if out is not None:
        n = survey.write(out, made, pose, every)
        what = "cells" if out.suffix.lower() in (".tif", ".tiff") else "points"
        line()
        file_table([out], **{what: number(n, ",")})


def mapped(system: str, folder: Path, progress: RunProgress) -> SeabedMap | None:
    """Make and save the map of a run whose system has settings of a survey; else return None.

    If no map can be made, a notice on stderr gives the reason: the run itself succeeded.
    """
    from uuvsim_cosim.scene.mapping.settings_file import keep_settings, settings_of_system

    settings = settings_of_system(system)
    if settings is None:
        return None
    from uuvsim_cosim.scene.mapping.mapping import write_map
    from uuvsim_cosim.scene.mapping.survey import survey_of

    progress.say("mapping the seabed")
    try:
        keep_settings(settings, folder)
        made = survey_of(folder).map()
        write_map(made, folder)
    except UuvsimError as error:
        progress.close()
        notice(f"no map was made: {error}")
        return None
    return made
