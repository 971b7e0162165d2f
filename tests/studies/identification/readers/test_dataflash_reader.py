"""Index of DataFlash logs: the same messages as pymavlink's reader, and damaged bytes counted."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.studies.identification.readers.ardusub_logs import Dataflash, dataflash
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.readers import dataflash_reader
from uuvsim_cosim.studies.identification.readers.dataflash_reader import DataFlash


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return dataflash(tmp_path / "1.BIN")


def equal(found: Any, expected: Any) -> bool:
    if isinstance(expected, bytes):
        return bytes(found).split(b"\0")[0] == expected.split(b"\0")[0]
    return bool(found == expected)


@pytest.mark.parametrize("block", [512, 4096, 1 << 24])
def test_every_message_is_that_of_pymavlink(
    log: Path, block: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    from pymavlink.DFReader import DFReader_binary

    monkeypatch.setattr(dataflash_reader, "_BLOCK", block)
    mine = DataFlash(log)
    assert (mine.lost, mine.cut, mine.conflicts) == (0, 0, [])
    arrays = {name: mine.messages(name) for name in mine.names}
    seen = dict.fromkeys(arrays, 0)
    with closing(DFReader_binary(str(log))) as reader:
        while (message := reader.recv_msg()) is not None:
            name = message.get_type()
            row = arrays[name][seen[name]]
            seen[name] += 1
            for column, value in zip(mine.layouts[name].columns, message._elements, strict=True):
                assert equal(row[column], value), (name, column)
    assert seen == {name: mine.count(name) for name in mine.names}
    assert sum(seen.values()) > 300


def test_fixed_point_columns_have_their_factor(tmp_path: Path) -> None:
    log = Dataflash()
    log.describe(19, "RFND", "QCBB", "TimeUS,Dist,Stat,Orient")
    log.put("RFND", 5, 123, 4, 25)
    (tmp_path / "1.BIN").write_bytes(log.data)
    assert DataFlash(tmp_path / "1.BIN").column("RFND", "Dist").tolist() == pytest.approx([1.23])


def test_damaged_bytes_are_skipped_and_counted(log: Path) -> None:
    whole = DataFlash(log)
    place = int(whole.offsets("ATT")[20])
    data = bytearray(log.read_bytes())
    data[place : place + 2] = b"\0\0"  # one header
    data[-100:-100] = b"noise" * 30 + b"\xa3\x95\x0a"  # and bytes that look like one
    log.write_bytes(data)
    damaged = DataFlash(log)
    assert damaged.count("ATT") == whole.count("ATT") - 1
    assert damaged.gaps == 2
    for name in whole.names:
        assert abs(damaged.count(name) - whole.count(name)) <= 1
    t = damaged.column("ATT", "TimeUS")
    assert np.all(np.diff(t) > 0)


def test_a_message_that_looks_like_headers_inside_is_one_message(tmp_path: Path) -> None:
    log = Dataflash()
    log.describe(20, "MSG", "QZ", "TimeUS,Message")
    log.describe(21, "EV", "QB", "TimeUS,Id")
    log.put("MSG", 1, b"\xa3\x95\x15" * 20)
    log.put("EV", 2, 10)
    (tmp_path / "1.BIN").write_bytes(log.data)
    found = DataFlash(tmp_path / "1.BIN")
    assert (found.count("MSG"), found.count("EV"), found.lost) == (1, 1, 0)


def test_a_message_that_is_declared_again_with_other_fields_is_a_conflict(tmp_path: Path) -> None:
    log = Dataflash()
    log.describe(21, "EV", "QB", "TimeUS,Id")
    log.put("EV", 2, 10)
    log.describe(21, "EV", "QH", "TimeUS,Id")
    (tmp_path / "1.BIN").write_bytes(log.data)
    found = DataFlash(tmp_path / "1.BIN")
    assert found.conflicts == ["EV"]
    assert found.column("EV", "Id").tolist() == [10]


def test_an_incomplete_last_message_is_left_out(log: Path) -> None:
    whole = DataFlash(log)
    log.write_bytes(log.read_bytes()[:-5])
    cut = DataFlash(log)
    assert cut.cut > 0
    assert cut.lost == 0
    assert sum(map(cut.count, cut.names)) == sum(map(whole.count, whole.names)) - 1


def test_a_file_without_a_message_is_refused_with_its_first_bytes(tmp_path: Path) -> None:
    (tmp_path / "a.BIN").write_bytes(b"no log at all" * 10)
    with pytest.raises(InputInvalid, match=r"a\.BIN.*6e 6f 20.*expected a DataFlash log"):
        DataFlash(tmp_path / "a.BIN")
    (tmp_path / "b.BIN").write_bytes(b"")
    with pytest.raises(InputInvalid, match=r"b\.BIN.*begins with nothing"):
        DataFlash(tmp_path / "b.BIN")
