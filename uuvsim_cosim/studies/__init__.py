"""Many runs of one system: grids, Monte Carlo, and how sure their means are."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from uuvsim_cosim.studies.study import Study, StudyInterrupted
from uuvsim_cosim.studies.study_result import StudyResult

__all__ = ["Study", "StudyInterrupted", "StudyResult", "study"]


def study(source: Study | str | Path, out: str | Path | None = None, **options: Any) -> StudyResult:
    """Run a study, or a study file; options as `Study.run`."""
    return (source if isinstance(source, Study) else Study.read(source)).run(out, **options)
