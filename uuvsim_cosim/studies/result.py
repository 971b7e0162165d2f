"""Folder and result of a study: settings, finished runs in parts, one table, intervals of means."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from uuvsim_cosim.cache import content_hash, write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.data_frames import library
from uuvsim_cosim.studies.intervals import interval, rank_correlation
from uuvsim_cosim.studies.run_table import Runs
from uuvsim_cosim.studies.simulate_runs import Outcome, Script

if TYPE_CHECKING:
    from pyarrow import Array, Table

__all__ = ["StudyFolder", "StudyResult", "result_of"]

OWN = ("study.json", "runs.parquet", "report.html")
SCHEMA_VERSION = 1


@final
class StudyFolder:
    """A folder that belongs to one study; each part is written whole or not at all.

    Raises InputInvalid if something else lies there, or another study, unless `restart`.
    """

    def __init__(self, path: Path, asked: Mapping[str, object], restart: bool) -> None:
        self.path = path.expanduser().absolute()
        self.parts = self.path / "parts"
        self.asked = json.loads(json.dumps(asked))
        if self.path.exists() and not self.path.is_dir():
            raise InputInvalid(self.path, "is a file", "a folder")
        if restart and (self.path / "study.json").is_file():
            shutil.rmtree(self.parts, ignore_errors=True)
            for name in OWN:
                (self.path / name).unlink(missing_ok=True)
        file = self.path / "study.json"
        try:
            if file.is_file():
                self._refuse_other(file)
            elif self.path.is_dir() and any(self.path.iterdir()):
                raise InputInvalid(
                    self.path, "has something else in it", "a new folder, or a study's"
                )
            self.parts.mkdir(parents=True, exist_ok=True)
            if not file.is_file():
                self.write({})
        except OSError as error:
            raise InputInvalid(f"{self.path}: cannot be written ({error.strerror})") from None

    def _refuse_other(self, file: Path) -> None:
        try:
            before = json.loads(file.read_text(encoding="utf-8"))["asked"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputInvalid(
                f"{file}: cannot be read as a study; --restart begins it anew"
            ) from None

        def short(value: object) -> str:
            text = json.dumps(value, ensure_ascii=False)
            return text if len(text) <= 60 else f"{text[:57]}..."

        changed = [k for k in self.asked if before.get(k) != self.asked[k]]
        if changed:
            changes = "; ".join(
                f"{k} was {short(before.get(k))}, now {short(self.asked[k])}" for k in changed
            )
            raise InputInvalid(
                self.path,
                f"was begun as another study: {changes}",
                "the same one, another folder, or --restart, which begins anew",
            )

    def write(self, more: Mapping[str, object]) -> None:
        """Write study.json: the settings, and the fields of `more`."""
        content = {"schema": SCHEMA_VERSION, "asked": self.asked, **more}
        text = json.dumps(content, indent=1, ensure_ascii=False)
        write_whole(self.path / "study.json", text.encode())

    def done(self) -> dict[int, Outcome]:
        """Return the runs that are finished, by number; parts that cannot be read count as none."""
        import pyarrow as pa
        import pyarrow.parquet as pq

        found: dict[int, Outcome] = {}
        for part in sorted(self.parts.glob("*.parquet")):
            try:
                rows = pq.read_table(part).to_pylist()
            except (pa.ArrowInvalid, OSError):
                continue
            for row in rows:
                found[int(row["run"])] = Outcome(list(row["numbers"]), row["failure"])
        return found

    def keep(self, runs: Sequence[int], outcomes: Sequence[Outcome]) -> None:
        """Write finished runs as one more part."""
        import pyarrow as pa

        table = pa.table(
            {
                "run": pa.array(runs, pa.int64()),
                "numbers": pa.array([o.numbers for o in outcomes], pa.list_(pa.float64())),
                "failure": pa.array([o.failure for o in outcomes], pa.string()),
            }
        )
        # Named by its runs: the same part written twice is one file.
        name = f"{content_hash([json.dumps(list(map(int, runs)))])}.parquet"
        _write_table(self.parts / name, table)

    def finish(self, table: Table, more: Mapping[str, object]) -> None:
        """Write the table, and study.json with the fields of `more`."""
        _write_table(self.path / "runs.parquet", table)
        self.write({**more, "finished": True})


def _write_table(path: Path, table: Table) -> None:
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    pq.write_table(table, sink)
    write_whole(path, sink.getvalue())


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

    def to_pandas(self) -> Any:
        """Return the table as a DataFrame with the run as index (extra ``data``).

        ``frame.attrs["units"]`` maps parameters and metrics to their units.
        """
        library("pandas")
        table = self.table()
        frame = table.to_pandas().set_index("run")
        units = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in table.schema}
        frame.attrs["units"] = {name: unit for name, unit in units.items() if unit}
        return frame

    def to_xarray(self) -> Any:
        """Return the table as a Dataset over ``run``, with units as attributes (extra ``data``)."""
        library("xarray")
        frame = self.to_pandas()
        data = frame.to_xarray()
        for name, unit in frame.attrs["units"].items():
            data[name].attrs["units"] = unit
        return data


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
