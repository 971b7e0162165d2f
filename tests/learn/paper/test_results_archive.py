"""Results in one file and beside it: nothing is lost, and what lies beside it replaces a row."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.cli import status_of
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.paper.results import (
    ARCHIVE,
    Key,
    is_kept,
    pack,
    read_episode,
    read_result,
    read_results,
)

KEYS = [Key("batched", "source", "stt-masac", s) for s in (0, 1, 10)]
NUMBERS = ("return", "track", "dist", "viol", "clean")


def write(results: Path, key: Key, value: float, *, episode: bool = True) -> None:
    stem = results / key.stem
    stem.parent.mkdir(parents=True, exist_ok=True)
    of = {name: [value, 2 * value] for name in NUMBERS}
    numbers = {"uuvsim_result": 1, "algorithm": "masac", "cpu": 1.5, "episodes": of, "scripted": of}
    stem.with_name(f"{stem.name}.json").write_text(json.dumps(numbers))
    stem.with_name(f"{stem.name}.csv").write_text(f"step,return\n0,0\n80,{value}\n")
    if episode:
        stem.with_name(f"{stem.name}.episode.csv").write_text(f"t,x_1\n0.0,{value}\n")
    stem.with_name(f"{stem.name}.npz").write_bytes(b"a policy")


@pytest.fixture
def results(tmp_path: Path) -> Path:
    for key in KEYS:
        write(tmp_path, key, key.seed + 0.1, episode=key.seed != 10)
    return tmp_path


def test_what_is_packed_reads_as_before(results: Path) -> None:
    before = [read_result(results, key) for key in KEYS]
    assert pack(results) == results / ARCHIVE
    files = sorted(p.name for p in results.rglob("*") if p.is_file())
    assert files == sorted([ARCHIVE, *(f"stt-masac-{s}.npz" for s in (0, 1, 10))])
    for key, was in zip(KEYS, before, strict=True):
        now = read_result(results, key)
        assert now.about == was.about
        assert np.array_equal(now.returns, was.returns)
        assert np.array_equal(now.curve["return"], was.curve["return"])
        assert is_kept(results, key)
    assert read_episode(results, KEYS[1])["x_1"].tolist() == [1.1]
    with pytest.raises(InputInvalid, match=r"stt-masac-10: episode: .* expected a whole table"):
        read_episode(results, KEYS[2])


def test_seeds_are_in_the_order_of_numbers(results: Path) -> None:
    pack(results)
    write(results, Key("batched", "source", "stt-masac", 2), 7.0)
    (runs,) = read_results(results, "batched").values()
    assert [r.key.seed for r in runs] == [0, 1, 2, 10]


def test_a_file_beside_the_archive_replaces_its_row(results: Path) -> None:
    pack(results)
    write(results, KEYS[0], 99.0)
    assert read_result(results, KEYS[0]).returns.tolist() == [99.0, 198.0]
    pack(results)
    assert not list(results.rglob("*.json"))
    assert read_result(results, KEYS[0]).returns.tolist() == [99.0, 198.0]
    assert read_result(results, KEYS[1]).returns.tolist() == [1.1, 2.2]
    first = (results / ARCHIVE).read_bytes()
    pack(results)
    assert (results / ARCHIVE).read_bytes() == first


def test_another_file_in_its_place_is_refused(results: Path) -> None:
    (results / ARCHIVE).write_text("no Parquet")
    with pytest.raises(InputInvalid, match=rf"{ARCHIVE}: .* expected an archive"):
        read_results(results, "batched")
    with pytest.raises(InputInvalid, match=rf"{ARCHIVE}: .* expected an archive"):
        pack(results)
    assert (results / f"{KEYS[0].stem}.json").is_file()  # nothing is lost


def test_the_command_packs_what_it_has_judged(results: Path) -> None:
    assert status_of(["reproduce", "fig7", "--no-run", "--pack", "-o", str(results)]) == 0
    assert (results / ARCHIVE).is_file()
    assert not list(results.rglob("*.json"))
    page = (results / "README.md").read_text()
    assert status_of(["reproduce", "fig7", "--no-run", "-o", str(results)]) == 0
    assert (results / "README.md").read_text() == page
