"""Studies: many runs of one system (grids, Monte Carlo), and how sure their means are.

Parameters are fitted to recordings in `identification/`. It may import `envs`, `bridge`, `kernels`,
`scene`, `orchestrator` and below. Start with `study.py`, then `metric.py`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from uuvsim_cosim.studies.result import StudyResult
from uuvsim_cosim.studies.study import Study, StudyInterrupted

__all__ = ["Study", "StudyInterrupted", "StudyResult", "study"]


def study(source: Study | str | Path, out: str | Path | None = None, **options: Any) -> StudyResult:
    """Run a study, or a study file; options as `Study.run`."""
    return (source if isinstance(source, Study) else Study.read(source)).run(out, **options)
