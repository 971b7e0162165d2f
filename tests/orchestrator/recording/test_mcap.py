"""MCAP files hold the recorded values for any reader of ROS 2 messages; memory holds a block."""

from __future__ import annotations

import base64
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader

from uuvsim_cosim.errors import RecordingError
from uuvsim_cosim.orchestrator.recording import columns, mcap
from uuvsim_cosim.orchestrator.recording.mcap_file import McapFile
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals

ROWS = 300


@pytest.fixture
def signals() -> Signals:
    random = np.random.default_rng(3)
    numbers = 10.0 ** random.uniform(-30, 30, (ROWS, 3)) * random.choice([-1.0, 1.0], (ROWS, 3))
    special = np.resize([0.0, -0.0, 1.0, np.nan, np.inf, -np.inf, 5e-324, 1e22, 0.1, 1e-7], ROWS)
    texts, blobs = np.empty(ROWS, object), np.empty((ROWS, 2), object)
    texts[:] = [("a,]", 'q"\\', "ü\n", "")[k % 4] for k in range(ROWS)]
    for k in range(ROWS):
        blobs[k] = [bytes([k % 256]), b""]
    values: dict[str, np.ndarray] = {
        "a.b.vector": numbers, "a.b.special": special, "a.b.one": numbers[:, :1].copy(),
        "c.i": random.integers(-(2**62), 2**62, ROWS), "c.u": np.full(ROWS, 2**64 - 1, np.uint64),
        "c.flag": random.random(ROWS) < 0.5, "c.flags": random.random((ROWS, 2)) < 0.5,
        "d.text": texts, "d.blobs": blobs, "e.single": special.astype(np.float32),
    }  # fmt: skip
    ticks = np.arange(2**32 - 5, 2**32 - 5 + ROWS)
    return Signals(ticks / 100, ticks, values, dict.fromkeys(values, "m"), {}, {"tick": "1/100"})


KINDS = {"float64": "d", "float32": "f", "int64": "q", "uint64": "Q", "bool": "?"}


def decoded(definition: str, data: bytes) -> dict[str, Any]:
    """Return the values of a CDR message by field, as its definition alone says them."""
    assert data[:4] == b"\0\1\0\0"
    at, found = 4, {}

    def one(kind: str) -> Any:
        nonlocal at
        code = "<I" if kind == "string" else "<" + KINDS[kind]
        size = struct.calcsize(code)
        at += -(at - 4) % size  # a value is aligned to its size
        (value,) = struct.unpack_from(code, data, at)
        at += size
        if kind == "string":
            text, at = data[at : at + value], at + value
            assert text[-1:] == b"\0"
            return text[:-1].decode()
        return value

    for line in definition.splitlines():
        type_, name = line.partition("#")[0].split()
        kind, _, size = type_.partition("[")
        found[name] = [one(kind) for _ in range(int(size[:-1]))] if size else one(kind)
    assert at == len(data)
    return found


def expected(value: Any) -> Any:
    """Return a recorded value as it is in a message: bytes are text in base64."""
    if isinstance(value, list):
        return [expected(v) for v in value]
    return base64.b64encode(value).decode() if isinstance(value, bytes) else value


@pytest.mark.parametrize("chunk", [1, 20_000, 1 << 22])
def test_a_reader_of_the_library_decodes_the_recorded_values(
    signals: Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(mcap, "CHUNK", chunk)
    mcap.write_mcap(signals, tmp_path / "r.mcap")
    lists = {name: array.tolist() for name, array in signals.items()}
    at = {round(tick * 1e7): k for k, tick in enumerate(signals.ticks.tolist())}
    paths = {name.rpartition(".")[0] for name in signals}
    with (tmp_path / "r.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == ROWS * len(paths)
        assert set(summary.statistics.channel_message_counts.values()) == {ROWS}
        assert summary.statistics.message_start_time == min(at)
        assert summary.statistics.message_end_time == max(at)
        seen = set()
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            row, path = at[message.log_time], channel.topic[1:].replace("/", ".")
            assert message.publish_time == message.log_time
            assert message.sequence == signals.ticks[row] & 0xFFFFFFFF
            values = decoded(schema.data.decode(), message.data)
            seen |= {f"{path}.{variable}" for variable in values}
            for variable, value in values.items():
                assert repr(value) == repr(expected(lists[f"{path}.{variable}"][row]))
        assert seen == set(signals)


def test_names_that_ros_has_not_become_fields_and_read_back(tmp_path: Path) -> None:
    values = {f"a-b.{name}": np.arange(2.0) for name in ("der(x)", "der x ", "1st", "µ")}
    mcap.write_mcap(Signals(np.arange(2.0), np.arange(2), values, {}), tmp_path / "r.mcap")
    with (tmp_path / "r.mcap").open("rb") as stream:
        schema, _, _ = next(iter(make_reader(stream).iter_messages()))
    assert schema is not None
    assert schema.name == "uuvsim/msg/AB"
    fields = [line.split()[1] for line in schema.data.decode().splitlines()]
    assert fields == ["der_x_", "der_x__", "x_1st", "x__"]
    assert list(mcap.read_mcap(tmp_path / "r.mcap")) == list(values)


def test_an_index_finds_the_messages_of_one_channel_and_of_a_span_of_time(
    signals: Signals, tmp_path: Path
) -> None:
    mcap.write_mcap(signals, tmp_path / "r.mcap")
    at = [int(np.rint(t * 1e9)) for t in signals.time]
    with (tmp_path / "r.mcap").open("rb") as stream:
        reader = make_reader(stream)
        found = list(
            reader.iter_messages(topics=["/c"], starting_at=at[100], ending_before=at[110])
        )
    assert [m.log_time for _, _, m in found] == at[100:110]
    values = [decoded(s.data.decode(), m.data)["i"] for s, _, m in found if s is not None]
    assert values == signals["c.i"][100:110].tolist()


def test_messages_of_a_scene_may_follow_and_precede_blocks(tmp_path: Path) -> None:
    def further(writer: McapFile) -> None:
        schema = writer.register_schema("foxglove.X", "jsonschema", b"{}")
        channel = writer.register_channel("/x", "json", schema, {})
        for k in range(3):
            writer.add_message(channel, k, b"%d" % k)

    signals = Signals(np.arange(2.0), np.arange(2), {"a.y": np.arange(2.0)}, {})
    mcap.write_mcap(signals, tmp_path / "r.mcap", further)
    with (tmp_path / "r.mcap").open("rb") as stream:
        seen = [(c.topic, m.data) for _, c, m in make_reader(stream).iter_messages()]
    assert [data for topic, data in seen if topic == "/x"] == [b"0", b"1", b"2"]
    assert mcap.read_mcap(tmp_path / "r.mcap")["a.y"].tolist() == [0.0, 1.0]


def test_rows_become_messages_block_by_block(
    signals: Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows: list[tuple[int, int]] = []
    records = mcap._records

    def counted(channels: Any, whole: Any, block: Signals, part: slice, stamps: Any) -> Any:
        rows.append((len(block.time), part.stop - part.start))
        return records(channels, whole, block, part, stamps)

    monkeypatch.setattr(mcap, "_records", counted)
    monkeypatch.setattr(columns, "BLOCK", 64)
    mcap.write_mcap(signals, tmp_path / "r.mcap")
    assert max(size for size, _ in rows) == 64
    assert sum(part for _, part in rows) == ROWS


def test_a_file_is_read_in_blocks_with_the_values_that_were_written(
    signals: Signals, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mcap.write_mcap(signals, tmp_path / "r.mcap")
    sizes: list[int] = []
    pack = mcap._Messages._pack
    monkeypatch.setattr(mcap, "BLOCK", 64)
    monkeypatch.setattr(
        mcap._Messages, "_pack", lambda self: (sizes.append(len(self._waiting)), pack(self))
    )
    back = mcap.read_mcap(tmp_path / "r.mcap")
    assert max(sizes) == 64
    for name, array in signals.items():
        assert back[name].dtype == array.dtype
        np.testing.assert_array_equal(back[name], array)
    assert list(back) == list(signals)


def test_a_file_of_an_earlier_version_is_refused_by_what_it_holds(tmp_path: Path) -> None:
    with (tmp_path / "old.mcap").open("wb") as out:
        file = McapFile(out, "uuvsim-cosim")
        file.add_metadata("uuvsim", {"recording": "{}"})
        schema = file.register_schema(name="hull", encoding="jsonschema", data=b"{}")
        file.add_message(file.register_channel("/hull", "json", schema, {}), 0, b"{}")
        file.finish()
    with pytest.raises(RecordingError, match=r"has messages of 'json', as earlier versions wrote"):
        read_signals(tmp_path / "old.mcap")
