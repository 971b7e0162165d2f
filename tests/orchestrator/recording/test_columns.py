"""Columns of a recording are read when they are asked for, with the values of the whole file."""

from __future__ import annotations

import pickle
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import uuvsim_cosim as uuv
from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.recording import columns
from uuvsim_cosim.orchestrator.recording.columns import LazyArrays, Source, as_array
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.samples import at_rows
from uuvsim_cosim.view.recorded.traces import traces_of


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run") / "hold"
    return uuv.run("bluerov2_hold", until=2.0, backend="native", out=folder).folder


def test_signals_are_the_columns_of_the_file(run: Path) -> None:
    signals, table = read_signals(run), pq.read_table(run / "signals.parquet")
    assert isinstance(signals.values_by_name, LazyArrays)
    for name in signals:
        value = signals[name]
        if value.ndim == 1:
            assert np.array_equal(value, table.column(name).to_numpy())
        for k in range(value.shape[1] if value.ndim == 2 else 0):
            assert np.array_equal(value[:, k], table.column(f"{name}[{k + 1}]").to_numpy())
        assert traces_of(run).size(name) == value[:1].size


def test_memory_holds_the_signals_used_last(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = read_signals(run).values_by_name
    assert isinstance(values, LazyArrays)
    names = list(values)
    first = values[names[0]]
    assert values[names[0]] is first
    monkeypatch.setattr(columns, "KEPT", first.nbytes)
    values[names[1]]
    assert values[names[0]] is not first
    assert np.array_equal(values[names[0]], first)


def test_another_process_gets_the_arrays_themselves(run: Path) -> None:
    signals = read_signals(run)
    copied = pickle.loads(pickle.dumps(signals))
    assert isinstance(copied.values_by_name, dict)
    assert all(np.array_equal(copied[name], signals[name]) for name in signals)


@pytest.mark.parametrize(
    "array",
    [
        pa.array([1.5, np.nan, -0.0]),
        pa.array([2**63, 1], pa.uint64()),
        pa.array([-(2**62), 3]),
        pa.array([True, False, True] * 5),
        pa.array(["a", "b"]),
        pa.array([], pa.float64()),
        pa.array([], pa.bool_()),
    ],
)
def test_an_array_is_that_of_arrow_whatever_its_chunks(array: pa.Array) -> None:
    column = pa.chunked_array([array, array.slice(1), array.slice(0, 1)], array.type)
    expected = column.to_numpy()
    assert as_array(column).dtype == expected.dtype
    assert np.array_equal(as_array(column), expected, equal_nan=expected.dtype.kind == "f")


def test_a_column_that_is_damaged_is_refused_when_it_is_read(run: Path, tmp_path: Path) -> None:
    data = bytearray((run / "signals.parquet").read_bytes())
    data[200 : len(data) // 2] = b"\xff" * (len(data) // 2 - 200)
    (tmp_path / "signals.parquet").write_bytes(data)
    with pytest.raises(RecordingError, match="damaged"):
        dict(read_signals(tmp_path))


def test_only_the_columns_that_are_asked_for_are_read() -> None:
    asked: list[int] = []

    class Columns:
        rows = 2

        def parts(self, numbers: Sequence[int]) -> Iterator[pa.RecordBatch]:
            asked.extend(numbers)
            for factor in (1.0, 2.0):
                arrays = [pa.array([factor * number]) for number in numbers]
                yield pa.RecordBatch.from_arrays(arrays, [str(number) for number in numbers])

        def batches(self, most: int) -> Iterator[pa.RecordBatch]:
            raise NotImplementedError

    arrays = LazyArrays(
        Columns(), {"a": Source((2, 3), True, True), "b": Source((4,), False, True)}
    )
    assert list(arrays) == ["a", "b"]
    assert "a" in arrays
    assert not asked
    assert arrays["a"].tolist() == [[2.0, 3.0], [4.0, 6.0]]
    assert asked == [2, 3]
    asked.clear()
    assert [block.tolist() for block in arrays.element_blocks("b", 0)] == [[4.0], [8.0]]
    assert asked == [4]


@pytest.mark.parametrize("ending", ["parquet", "arrows"])
def test_some_rows_of_a_wide_signal_are_those_of_the_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ending: str
) -> None:
    values = np.arange(21.0).reshape(7, 3)
    about = [{"path": "s", "variable": "image", "index": str(k + 1)} for k in range(3)]
    fields = [pa.field("time", pa.float64()), pa.field("tick", pa.int64())]
    fields += [pa.field(f"s.image[{k + 1}]", pa.float64(), metadata=about[k]) for k in range(3)]
    rows = [pa.array(np.arange(7.0)), pa.array(np.arange(7)), *map(pa.array, values.T.copy())]
    table = pa.Table.from_arrays(rows, schema=pa.schema(fields))
    if ending == "parquet":
        pq.write_table(table, tmp_path / "signals.parquet", row_group_size=3)
    else:
        with pa.ipc.new_stream(str(tmp_path / "signals.arrows"), table.schema) as stream:
            stream.write_table(table, max_chunksize=3)
    monkeypatch.setattr(columns, "WIDE", 2)
    recorded = read_signals(tmp_path).values_by_name
    for picked in ([], [0], [2, 3, 6], list(range(7))):
        found = at_rows(recorded, "s.image", np.array(picked, int))
        assert np.array_equal(found, values[picked])
        assert np.array_equal(found, at_rows({"s.image": values}, "s.image", np.array(picked, int)))
    assert np.array_equal(recorded["s.image"], values)


def test_a_block_reader_holds_one_block_of_rows(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(columns, "BLOCK", 64)
    signals = read_signals(run)
    held: list[weakref.ref[np.ndarray]] = []
    joined: dict[str, list[np.ndarray]] = {name: [] for name in signals}
    for block in signals.blocks():
        assert sum(there() is not None for there in held) <= len(signals)
        assert len(block.time) <= 64
        held += [weakref.ref(array) for array in block.values()]
        for name, array in block.items():
            joined[name].append(array.copy())
        del array
    assert len(held) == len(signals) * -(-len(signals.time) // 64)
    assert all(np.array_equal(np.concatenate(joined[name]), signals[name]) for name in signals)


def test_signals_in_memory_have_the_same_blocks_as_those_of_a_file(run: Path) -> None:
    lazy = read_signals(run)
    held = replace(lazy, values_by_name=dict(lazy))
    for a, b in zip(lazy.blocks(), held.blocks(), strict=True):
        assert np.array_equal(a.time, b.time)
        assert np.array_equal(a.ticks, b.ticks)
        assert all(np.array_equal(a[name], b[name]) for name in lazy)
