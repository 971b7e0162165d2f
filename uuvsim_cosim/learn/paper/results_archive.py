"""Archive of the results of a benchmark in one Parquet file, with newer results beside it.

A run writes its results as files, each whole or not at all, so that several runs can work at the
same time and any can be killed. `pack` moves them into the archive. A file beside the archive takes
precedence over its row there.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.errors import InputInvalid

__all__ = ["ARCHIVE", "Kept", "Key", "kept", "keys_of_budget", "pack"]

ARCHIVE = "results.parquet"
_TEXTS = ("numbers", "curve", "episode")
_ENDINGS = (".json", ".csv", ".episode.csv")


@dataclass(frozen=True, order=True)
class Key:
    """The name of a run."""

    budget: str
    scenario: str
    way: str  # "stt-masac"
    seed: int

    @property
    def stem(self) -> str:
        """The path of its files, without their ending."""
        return f"{self.budget}/{self.scenario}/{self.way}-{self.seed}"


@dataclass(frozen=True)
class Kept:
    """The files of a run, as text."""

    place: str  # of the numbers, for messages
    numbers: str  # JSON
    curve: str | None  # CSV
    episode: str | None  # CSV; of a task of one agent: none


def kept(results: Path, key: Key) -> Kept | None:
    """Return the files of a run, or None; raises InputInvalid if they cannot be read."""
    paths = [results / f"{key.stem}{ending}" for ending in _ENDINGS]
    try:
        if not paths[0].is_file():
            return _archived(results).get(key)
        texts = [p.read_text(encoding="utf-8") if p.is_file() else None for p in paths]
        if not paths[0].is_file():  # packed by another process, which deletes the numbers first
            return _archived(results).get(key)
    except (OSError, ValueError) as error:
        raise InputInvalid(
            paths[0], f"cannot be read ({error})", "a result of `uuvsim reproduce`"
        ) from None
    return Kept(str(paths[0]), texts[0] or "", *texts[1:])


def keys_of_budget(results: Path, budget: str) -> Iterator[Key]:
    """Yield the runs of a budget that have results, in order."""
    found = {key for key in _archived(results) if key.budget == budget}
    yield from sorted(found | set(_loose(results, budget)))


def pack(results: Path) -> Path:
    """Move the files of results into the archive; policies stay as files."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    budgets = [p.name for p in results.iterdir() if p.is_dir()] if results.is_dir() else []
    loose = sorted(key for budget in budgets for key in _loose(results, budget))
    every = dict(_archived(results))
    for key in loose:
        found = kept(results, key)
        assert found is not None
        every[key] = found
    rows = [{**vars(key), **{n: getattr(every[key], n) for n in _TEXTS}} for key in sorted(every)]
    sink = pa.BufferOutputStream()
    schema = pa.schema([
        ("budget", pa.string()), ("scenario", pa.string()), ("way", pa.string()),
        ("seed", pa.int64()), *((n, pa.string()) for n in _TEXTS),
    ])  # fmt: skip
    pq.write_table(pa.Table.from_pylist(rows, schema), sink, compression="zstd")
    path = results / ARCHIVE
    write_whole(path, sink.getvalue().to_pybytes())
    for key in loose:  # in the archive, whole, by now
        for ending in _ENDINGS:
            (results / f"{key.stem}{ending}").unlink(missing_ok=True)
    return path


def _loose(results: Path, budget: str) -> Iterator[Key]:
    for path in sorted((results / budget).glob("*/*.json")):
        way, _, seed = path.stem.rpartition("-")
        if not way or not seed.isdigit():
            raise InputInvalid(path, "no run's name", "WAY-SEED.json")
        yield Key(budget, path.parent.name, way, int(seed))


def _archived(results: Path) -> dict[Key, Kept]:
    path = results / ARCHIVE
    try:
        stat = path.stat()
    except FileNotFoundError:
        return {}
    return _read(path, stat.st_mtime_ns, stat.st_size)


@lru_cache(maxsize=2)
def _read(path: Path, *_: int) -> dict[Key, Kept]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        rows = pq.read_table(os.fspath(path)).to_pylist()
        keys = [Key(r["budget"], r["scenario"], r["way"], r["seed"]) for r in rows]
        texts = [Kept("", *(r[n] for n in _TEXTS)) for r in rows]
    except (OSError, KeyError, pa.ArrowException) as error:
        raise InputInvalid(
            path, f"{type(error).__name__}: {error}", "an archive of `uuvsim reproduce`"
        ) from None
    return {k: replace(t, place=f"{path}: {k.stem}") for k, t in zip(keys, texts, strict=True)}
