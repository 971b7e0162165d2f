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
from uuvsim_cosim.studies.interval_table import IntervalRow, latex_table
from uuvsim_cosim.studies.intervals import interval, rank_correlation
from uuvsim_cosim.studies.run_table import Runs
from uuvsim_cosim.studies.simulate_runs import Outcome, Script

if TYPE_CHECKING:
    from pyarrow import Array, Table

__all__ = ["StudyDifference", "StudyFolder", "StudyResult", "result_of"]

OWN = ("study.json", "system.ssd", "runs.parquet", "report.html")
SCHEMA_VERSION = 1


@final
class StudyFolder:
    """Folder that belongs to one study; each part is written whole or not at all.

    `sources` are the publications of the draws, as (file, text). Raises InputInvalid for a folder
    with other files or of another study, unless `restart`.
    """

    def __init__(
        self,
        path: Path,
        asked: Mapping[str, object],
        restart: bool,
        sources: Sequence[tuple[str, str]] = (),
    ) -> None:
        self.path = path.expanduser().absolute()
        self.parts = self.path / "parts"
        self.asked = json.loads(json.dumps(asked))
        self.sources = list(sources)
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
                raise InputInvalid(self.path, "contains other files", "a new folder, or a study's")
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
                f"{file}: cannot be read as a study; --restart starts it again"
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
                f"contains another study: {changes}",
                "the same study, another folder, or --restart, which starts again",
            )

    def write(self, more: Mapping[str, object]) -> None:
        """Write study.json: the settings, and the fields of `more`."""
        content = {
            "schema": SCHEMA_VERSION,
            "asked": self.asked,
            "sources of the draws": self.sources,
            **more,
        }
        text = json.dumps(content, indent=1, ensure_ascii=False)
        write_whole(self.path / "study.json", text.encode())

    def done(self) -> dict[int, Outcome]:
        """Return the finished runs by number; parts that cannot be read are ignored."""
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
        """Write finished runs as a further part."""
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
    """Folder and summary of a study, as `Study.run` returns them.

    `folder` has the files, and `name` is the study's. Of `runs` runs, `failed` have failed and
    `resumed` were finished by an earlier call. `backend` is "kernel" or "master", "" if nothing was
    left to run; `wall_time` is in seconds; `remarks` are messages about the study. `intervals` has
    for each metric at each point of the grid the number of finite values "n", their "mean", "std"
    and "median", and the limits "low" and "high" of the 95 % bootstrap interval of the mean.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> boat = boat.set("hull.tau", [50.0, 0.0, 0.0, 0.0, 0.0, 0.0])  # N, N.m
    >>> study = uuv.Study(boat, duration=5, metrics={"speed": "final(hull.nu[1])"}, seeds=2)
    >>> result = study.run("out")
    >>> result.table().column_names
    ['run', 'point', 'seed', 'speed', 'failure']
    >>> result.to_pandas()["speed"].round(2).tolist()  # m/s
    [0.55, 0.55]
    >>> result.to_xarray()["speed"].attrs["units"], result.file.name
    ('m/s', 'runs.parquet')
    >>> [f"{row.mean:.2f} {row.unit}" for row in result.rows()]
    ['0.55 m/s']
    >>> result.to_latex({"speed": "final speed"}).splitlines()[4].split(" & ")[:2]
    ['final speed', 'm/s']
    >>> result.difference(result).rows()[0].mean
    0.0
    """

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
        """The Parquet file of the table, `runs.parquet`."""
        return self.folder / "runs.parquet"

    def table(self) -> Table:
        """Read the table, one row a run: run, point, seed, parameters, metrics, failure.

        The fields of parameters and metrics have their units as metadata.
        """
        import pyarrow.parquet as pq

        return pq.read_table(self.file)

    def to_pandas(self) -> Any:
        """Return the table as a DataFrame with the run as index (extra ``data``).

        ``frame.attrs["units"]`` maps parameters and metrics to their units. Raises InputInvalid if
        pandas is not installed.
        """
        library("pandas")
        frame = self.table().to_pandas().set_index("run")
        frame.attrs["units"] = {name: unit for name, unit in self._units().items() if unit}
        return frame

    def to_xarray(self) -> Any:
        """Return the table as a Dataset over ``run``, with units as attributes (extra ``data``).

        Raises InputInvalid if pandas or xarray is not installed.
        """
        library("xarray")
        frame = self.to_pandas()
        data = frame.to_xarray()
        for name, unit in frame.attrs["units"].items():
            data[name].attrs["units"] = unit
        return data

    def difference(self, other: StudyResult) -> StudyDifference:
        """Return this study minus another, run by run, with intervals of the mean differences.

        Runs of this study and of `other` with the same seed at the same grid point are a pair. A
        pair with a run that failed is left out. Raises InputInvalid if seeds, grids or the draws of
        common parameters differ, or if there is no common metric.
        """
        ours, theirs = self.table(), other.table()
        metrics = [m for m in self._metrics() if m in other._metrics()]
        common = [n for n in ours.column_names if n in theirs.column_names and n != "failure"]
        for name in common:
            if name not in metrics and ours[name].to_pylist() != theirs[name].to_pylist():
                place = f"{self.folder} and {other.folder}"
                raise InputInvalid(place, f"{name!r} differs between their runs", "the same values")
        if not metrics:
            place, read = f"{other.folder}", ", ".join(other._metrics())
            raise InputInvalid(place, f"metrics {read}", f"one of {', '.join(self._metrics())}")
        point = ours["point"].to_numpy()
        rows = []
        for before in self.intervals:
            if before["metric"] in metrics:
                a, b = (np.asarray(t[before["metric"]])[point == before["point"]]
                        for t in (ours, theirs))  # fmt: skip
                rows.append({**before, **asdict(interval(a - b))})
        return StudyDifference(self, other, tuple(rows))

    def rows(self) -> tuple[IntervalRow, ...]:
        """Return the means of all metrics with units and intervals, by grid point."""
        return _rows(self.intervals, self._units())

    def to_latex(
        self, names: Mapping[str, str] | None = None, *, caption: str = "", label: str = ""
    ) -> str:
        """Return the means with intervals as a table for LaTeX (package booktabs).

        `names` chooses metrics, and words for them: ``{"error": "position error"}``; without it,
        all metrics are shown. It may also name grid axes. With `caption`, the text is a table
        environment, with `label` for references. Texts are escaped. Raises InputInvalid for a name
        that is no metric and no grid axis.
        """
        return _latex(self.rows(), names, self._units(), "mean", caption, label)

    def _metrics(self) -> list[str]:
        return list(dict.fromkeys(str(i["metric"]) for i in self.intervals))

    def _units(self) -> dict[str, str]:
        return {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in self.table().schema}


@dataclass(frozen=True)
class StudyDifference:
    """Paired differences of two studies, `first` minus `second`.

    `intervals` has the same numbers for each metric at each point of the grid as those of a
    `StudyResult`, of the differences.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> boat = uuv.System("boat", tick="0.1").add("hull", "model:bluerov2_heavy")
    >>> metrics = {"speed": "final(hull.nu[1])"}
    >>> results = [
    ...     uuv.Study(
    ...         boat.set("hull.tau", [force, 0.0, 0.0, 0.0, 0.0, 0.0]),  # N, N.m
    ...         duration=5, metrics=metrics, seeds=2,
    ...     ).run(f"{force:g}")
    ...     for force in (50.0, 20.0)
    ... ]
    >>> faster = results[0].difference(results[1])
    >>> row = faster.rows()[0]
    >>> row.metric, row.n, row.mean > 0
    ('speed', 2, True)
    >>> "mean difference" in faster.to_latex()
    True
    """

    first: StudyResult
    second: StudyResult
    intervals: tuple[dict[str, Any], ...]  # as those of a StudyResult

    def rows(self) -> tuple[IntervalRow, ...]:
        """Return the mean differences with units and intervals, by grid point."""
        return _rows(self.intervals, self.first._units())

    def to_latex(
        self, names: Mapping[str, str] | None = None, *, caption: str = "", label: str = ""
    ) -> str:
        """Return the differences as a table for LaTeX (package booktabs).

        `names`, `caption` and `label` are as in `StudyResult.to_latex`.
        """
        units = self.first._units()
        return _latex(self.rows(), names, units, "mean difference", caption, label)


def _rows(found: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> tuple[IntervalRow, ...]:
    return tuple(
        IntervalRow(
            i["at"], i["metric"], units[i["metric"]], i["n"], i["mean"], i["low"], i["high"]
        )
        for i in found
    )


def _latex(
    rows: Sequence[IntervalRow], names: Mapping[str, str] | None, units: Mapping[str, str],
    mean: str, caption: str, label: str,
) -> str:  # fmt: skip
    words = names or {}
    metrics = {row.metric for row in rows}
    axes = {axis for row in rows for axis in row.at}
    if unknown := [name for name in words if name not in metrics | axes]:
        raise InputInvalid(
            "names", f"{unknown[0]!r}", f"one of {', '.join(sorted(metrics | axes))}"
        )
    chosen = metrics & set(words) or metrics
    shown = [row for row in rows if row.metric in chosen]
    return latex_table(shown, words, units, mean=mean, caption=caption, label=label)


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
