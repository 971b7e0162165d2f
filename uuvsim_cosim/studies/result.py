"""Result of a study: a table with one row for each run, and intervals of means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.studies.folder import StudyFolder
from uuvsim_cosim.studies.intervals import interval, rank_correlation
from uuvsim_cosim.studies.run_table import Runs
from uuvsim_cosim.studies.simulate_runs import Script

if TYPE_CHECKING:
    from pyarrow import Array, Table

__all__ = ["StudyResult", "result_of"]


@dataclass(frozen=True)
class StudyResult:
    """Folder and summary of a study; `resumed` runs were finished by an earlier call."""

    folder: Path
    name: str
    runs: int
    failed: int
    resumed: int
    backend: str
    wall_time: float  # s
    remarks: tuple[str, ...]
    intervals: tuple[dict[str, Any], ...]

    @property
    def file(self) -> Path:
        """The file of the table."""
        return self.folder / "runs.parquet"

    def table(self) -> Table:
        """Read the table: run, point, seed, parameters, metrics, failure."""
        import pyarrow.parquet as pq

        return pq.read_table(self.file)


def result_of(
    folder: StudyFolder, runs: Runs, script: Script, remarks: Sequence[str], *, name: str,
    backend: str, resumed: int, wall_time: float,
) -> StudyResult:  # fmt: skip
    """Write the table and study.json from the finished parts."""
    import pyarrow as pa

    done = folder.done()
    outcomes = [done[r] for r in range(runs.n)]
    numbers = np.array([o.numbers for o in outcomes]).reshape(runs.n, -1)
    metrics = [(c, m) for m in script.metrics for c in m.columns]
    about = runs.about()
    columns = runs.columns()
    fields = [pa.field(n, pa.int64()) for n in ("run", "point", "seed")]
    arrays: list[Array] = [
        pa.array(range(runs.n), pa.int64()),
        pa.array([runs.point(r) for r in range(runs.n)], pa.int64()),
        pa.array([runs.seed(r) for r in range(runs.n)], pa.int64()),
    ]
    for each in about:
        fields.append(pa.field(each["name"], pa.float64(), metadata={"unit": each["unit"]}))
        arrays.append(pa.array(columns[each["name"]].astype(float)))
    for (label, m), values in zip(metrics, numbers.T, strict=True):
        fields.append(pa.field(label, pa.float64(), metadata={"unit": m.root.unit or ""}))
        arrays.append(pa.array(values))
    fields.append(pa.field("failure", pa.string()))
    arrays.append(pa.array([o.failure for o in outcomes], pa.string()))
    failed = sum(o.failure is not None for o in outcomes)

    point = np.array([runs.point(r) for r in range(runs.n)])
    grid = [a["name"] for a in about if a["kind"] == "grid"]
    found: list[dict[str, Any]] = []
    for p in range(len(runs.points)):
        here = slice(p * len(runs.seeds), (p + 1) * len(runs.seeds))
        at = {axis: float(columns[axis][here][0]) for axis in grid}
        for (label, _), values in zip(metrics, numbers.T, strict=True):
            found.append({"point": p, "at": at, "metric": label, **asdict(interval(values[here]))})
    rank = {
        label: {
            a["name"]: rank_correlation(columns[a["name"]].astype(float), values, point)
            for a in about
            if a["kind"] == "drawn"
        }
        for (label, _), values in zip(metrics, numbers.T, strict=True)
    }
    shown = [
        {"name": n, "unit": m.root.unit or "", "expression": m.metric.expression}
        for n, m in metrics
    ]
    folder.finish(
        pa.Table.from_arrays(arrays, schema=pa.schema(fields)),
        {
            "name": name,
            "system": script.system.name,
            "description": script.system.description,
            "duration": float(script.steps * script.system.base_step),
            "parameters": about,
            "metrics": shown,
            "intervals": _plain(found),
            "rank correlation": _plain(rank),
            "runs": runs.n,
            "failed": failed,
            "remarks": list(remarks),
            "backend": backend,
            "wall time": wall_time,
        },
    )
    return StudyResult(
        folder.path, name, runs.n, failed, resumed, backend, wall_time, tuple(remarks),
        tuple(found),
    )  # fmt: skip


def _plain(value: object) -> object:
    """Return a value with None instead of NaN and infinities, which JSON does not have."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_plain(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value
