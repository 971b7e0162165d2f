"""Map of the seabed after `uuvsim run` of a survey."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.commands.shared.run_progress import RunProgress
from uuvsim_cosim.commands.shared.terminal import notice
from uuvsim_cosim.errors import UuvsimError

if TYPE_CHECKING:
    from uuvsim_cosim.scene.mapping.mapping import SeabedMap

__all__ = ["mapped"]


def mapped(system: str, folder: Path, progress: RunProgress) -> SeabedMap | None:
    """Make and save the map of a run whose system has settings of a survey; else return None.

    If no map can be made, a notice on stderr gives the reason: the run itself succeeded.
    """
    from uuvsim_cosim.scene.mapping.survey import keep_settings, settings_of_system

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
