"""Folder of a study: its settings, finished runs in parts, and in the end one table."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, final

from uuvsim_cosim.cache import content_hash, write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.simulate_runs import Outcome

if TYPE_CHECKING:
    from pyarrow import Table

__all__ = ["StudyFolder"]

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
        try:
            self._check()
            self.parts.mkdir(parents=True, exist_ok=True)
            if not (self.path / "study.json").is_file():
                self.write({})
        except OSError as error:
            raise InputInvalid(f"{self.path}: cannot be written ({error.strerror})") from None

    def _check(self) -> None:
        if not self.path.is_dir() or not any(self.path.iterdir()):
            return
        file = self.path / "study.json"
        if not file.is_file():
            raise InputInvalid(self.path, "has something else in it", "a new folder, or a study's")
        try:
            before = json.loads(file.read_text(encoding="utf-8"))["asked"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputInvalid(
                f"{file}: cannot be read as a study; --restart begins it anew"
            ) from None
        changed = [k for k in self.asked if before.get(k) != self.asked[k]]
        if changed:
            changes = "; ".join(
                f"{k} was {_short(before.get(k))}, now {_short(self.asked[k])}" for k in changed
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
        import io

        import pyarrow as pa
        import pyarrow.parquet as pq

        table = pa.table(
            {
                "run": pa.array(runs, pa.int64()),
                "numbers": pa.array([o.numbers for o in outcomes], pa.list_(pa.float64())),
                "failure": pa.array([o.failure for o in outcomes], pa.string()),
            }
        )
        sink = io.BytesIO()
        pq.write_table(table, sink)
        # Named by its runs: the same part written twice is one file.
        name = f"{content_hash([json.dumps(list(map(int, runs)))])}.parquet"
        write_whole(self.parts / name, sink.getvalue())

    def finish(self, table: Table, more: Mapping[str, object]) -> Path:
        """Write the table, and study.json with the fields of `more`."""
        import io

        import pyarrow.parquet as pq

        sink = io.BytesIO()
        pq.write_table(table, sink)
        write_whole(self.path / "runs.parquet", sink.getvalue())
        self.write({**more, "finished": True})
        return self.path / "runs.parquet"


def _short(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
