"""Studies: many runs of one system (grids, Monte Carlo), with intervals of their means.

Parameters are fitted to recordings in `identification/`. It may import `envs`, `bridge`, `kernels`,
`scene`, `orchestrator` and below. Start with `study.py`, then `metric.py`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from uuvsim_cosim.studies.identification.identify import Identified, identify
from uuvsim_cosim.studies.result import StudyDifference, StudyResult
from uuvsim_cosim.studies.study import Study, StudyInterrupted

__all__ = [
    "Identified",
    "Study",
    "StudyDifference",
    "StudyInterrupted",
    "StudyResult",
    "identify",
    "study",
]


def study(source: Study | str | Path, out: str | Path | None = None, **options: Any) -> StudyResult:
    """Run a study, or the study in a file, and return its result.

    `source` is a `Study` or a YAML file. `out` is the folder of the results, by default the study's
    own. `options` are those of `Study.run`. Raises InputInvalid with every mistake in the file and
    its line, and the errors of `Study.run`.

    Example:

    >>> from pathlib import Path
    >>> import uuvsim_cosim as uuv
    >>> text = "{system: bluerov2_hold, duration: 2, metrics: {depth: 'mean(hull.eta[3])'}}"
    >>> _ = Path("depth.yaml").write_text(text)
    >>> result = uuv.study("depth.yaml", out="out")
    >>> result.runs, result.failed
    (1, 0)
    """
    return (source if isinstance(source, Study) else Study.read(source)).run(out, **options)
