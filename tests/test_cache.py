"""The cache: what it kept is known again, and nothing else is."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from uuvsim_cosim.cache import intact, keep, whole_file, write_whole
from uuvsim_cosim.errors import InputInvalid


def test_only_what_was_kept_is_intact(tmp_path: Path) -> None:
    path = tmp_path / "a"
    assert not intact(path)
    path.write_bytes(b"12")
    assert not intact(path)
    keep(path, b"12")
    assert intact(path)
    path.write_bytes(b"13")
    assert not intact(path)


def test_writers_at_once_leave_one_whole_file_and_nothing_else(tmp_path: Path) -> None:
    contents = [bytes([i]) * 100_000 for i in range(16)]
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda data: write_whole(tmp_path / "a", data), contents))
    assert (tmp_path / "a").read_bytes() in contents
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_file_that_cannot_be_written_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "b").touch()
    with pytest.raises(InputInvalid, match=r"cache file .*a: cannot be written \(Is a dir"):
        keep(tmp_path / "a", b"1")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_writer_that_fails_leaves_the_old_file_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("old")

    def write() -> None:
        with whole_file(path) as scratch:
            assert (scratch.parent, scratch.suffix) == (tmp_path, ".csv")
            scratch.write_text("ne")
            raise ValueError("half way")

    with pytest.raises(ValueError, match="half way"):
        write()
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.csv"]


def test_the_data_is_on_the_disk_before_the_name_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    for name in ("fsync", "replace"):
        whole = getattr(os, name)
        monkeypatch.setattr(os, name, lambda *a, n=name, f=whole: (calls.append(n), f(*a)))
    write_whole(tmp_path / "a", b"1")
    assert calls == ["fsync", "replace"]


def test_a_pipe_is_written_to_and_not_replaced(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    try:
        write_whole(pipe, b"12")
        assert os.read(reader, 10) == b"12"
    finally:
        os.close(reader)
    assert pipe.is_fifo()


def test_a_device_is_written_to_and_not_replaced() -> None:
    write_whole(Path(os.devnull), b"1")
    assert not Path(os.devnull).is_file()
