"""Frames and columns: what is written is read, and what is no frame is refused in words."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.bridge.calls.call_table import steps_of
from uuvsim_cosim.bridge.calls.connection_limits import Limits
from uuvsim_cosim.bridge.calls.service import SignalInfo
from uuvsim_cosim.bridge.calls.values import columns_of, json_of, json_texts, numbers_of, unpacked
from uuvsim_cosim.bridge.tcp.framing import Disconnected, Reader, frame
from uuvsim_cosim.errors import InputInvalid

SCHEMA = {
    info.name: info
    for info in (
        SignalInfo("a.x", "Float64", (2, 3), "m", "input", True),
        SignalInfo("a.n", "Int32", (), "1", "parameter", True),
        SignalInfo("a.i", "Int64", (3,), "1", "input", True),
        SignalInfo("a.u", "UInt64", (), "1", "input", True),
        SignalInfo("a.on", "Boolean", (), "1", "parameter", True),
        SignalInfo("a.s", "String", (), "1", "parameter", True),
    )
}


def pieces(data: bytes, size: int) -> Callable[[int, bool], bytes]:
    """Return bytes piece by piece, as a socket may."""
    parts = [data[at : at + size] for at in range(0, len(data), size)]
    return lambda _count, _begun: parts.pop(0) if parts else b""


@given(
    text=st.dictionaries(st.text(max_size=5), st.integers(), max_size=3),
    numbers=st.lists(st.floats(allow_nan=False), max_size=5),
    size=st.integers(1, 40),
)
def test_a_frame_is_read_as_it_was_written_however_it_is_cut(
    text: dict[str, Any], numbers: list[float], size: int
) -> None:
    payload = np.array(numbers, dtype="<f8").tobytes()
    reader = Reader(pieces(2 * frame(text, payload), size), Limits())
    assert [reader.frame(), reader.frame()] == [(text, payload), (text, payload)]


def test_the_layout_of_a_frame_is_the_documented_one() -> None:
    data = frame({"call": "x"}, struct.pack("<d", 0.5))
    assert struct.unpack_from("<II", data) == (13, 8)
    assert data[8:] == b'{"call": "x"}' + struct.pack("<d", 0.5)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\n\r\n", "begins with two little-endian uint32"),
        (struct.pack("<II", 2, 0) + b"{]", "not JSON"),
        (struct.pack("<II", 2, 0) + b"[]", "expected an object"),
        (struct.pack("<II", 9, 0) + b'{"a":NaN}', "NaN is no JSON"),
        (struct.pack("<II", 13, 0) + b'{"a":1,"a":2}', "'a' is given twice"),
        (struct.pack("<II", 0, 4) + b"1234", "multiple of 8"),
        (struct.pack("<II", 2, 0) + b"\xff\xff", "not JSON"),
        (struct.pack("<II", 0, 1 << 31), "at most"),
        (struct.pack("<II", 4 << 10, 0) + b"[" * (4 << 10), "not JSON"),
    ],
)
def test_what_is_no_frame_is_refused_in_words(data: bytes, words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        Reader(pieces(data, 1000), Limits()).frame()


def test_an_announced_length_takes_no_memory() -> None:
    asked: list[int] = []

    def receive(size: int, begun: bool) -> bytes:
        asked.append(size)
        return struct.pack("<II", 0, 8 << 20) if len(asked) == 1 else b""

    with pytest.raises(Disconnected):
        Reader(receive, Limits()).frame()
    assert max(asked) <= 1 << 16


def test_columns_are_read_as_they_were_written() -> None:
    values = {"a.x": np.arange(6.0).reshape(2, 3), "a.n": np.int32(7), "a.on": np.bool_(True)}
    columns, texts, arrays = columns_of({**values, "a.s": "word"}, SCHEMA)
    assert texts == [{"name": "a.s", "value": "word"}]
    back = unpacked(columns, b"".join(map(numbers_of, arrays)), SCHEMA)
    assert set(back) == set(values)
    for name, value in values.items():
        assert np.array_equal(back[name], value)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("a.i", np.array([-(2**63), 2**53 + 1, 2**63 - 1])),
        ("a.i[2]", -(2**53) - 1),
        ("a.u", 2**64 - 1),
        ("a.u", 0),
        ("a.i", np.array([1, 2, 3])),
    ],
)
def test_integers_of_64_bits_are_exact_in_columns(name: str, value: Any) -> None:
    columns, _, arrays = columns_of({name: value}, SCHEMA, integers=True)
    payload = b"".join(map(numbers_of, arrays))
    if name.endswith("]"):  # an element is read, not set
        assert int.from_bytes(payload, "little", signed=True) == value
        return
    assert unpacked(columns, payload, SCHEMA)[name].tolist() == np.asarray(value).tolist()


@pytest.mark.parametrize("value", [2**53 + 1, -(2**63) + 1, 2**63 - 1])
def test_an_integer_that_float64_would_round_is_refused(value: int) -> None:
    with pytest.raises(InputInvalid, match=f"{value} is not exact as float64"):
        columns_of({"a.i": np.array([0, 1, value])}, SCHEMA)
    assert columns_of({"a.i": np.array([0, 1, 2**62])}, SCHEMA)[0][0].keys() == {
        "name", "type", "shape",
    }  # fmt: skip


@settings(deadline=None, max_examples=20)
@given(st.lists(st.floats(), max_size=4), st.integers(0, 3 * 8192 + 1))
def test_json_in_pieces_is_json(numbers: list[float], size: int) -> None:
    values = {"x": np.resize(np.array([*numbers, 0.5]), (size, 2)), "s": "word", "n": 2**63}
    text = "".join(json_texts(values))
    assert json.loads(text) == json_of(values)


@pytest.mark.parametrize(
    ("columns", "count", "words"),
    [
        ([{"name": "a.x"}], 5, "5 numbers are left in the payload; expected 6"),
        ([{"name": "a.x"}], 7, "7 numbers were read; the columns name 6"),
        ([{"name": "a.x", "shape": [2, -3]}], 6, "shape"),
        ([{"name": "a.x", "shape": [1 << 40]}], 6, "shape"),
        ([{}], 6, "a name"),
        ("a.x", 6, "a list"),
        ([{"name": "a.x", "format": "f4"}], 6, "expected float64, int64 or uint64"),
        ([{"name": "a.n"}, {"name": "a.n"}], 2, "given twice"),
    ],
)
def test_columns_that_do_not_fit_are_refused_in_words(
    columns: object, count: int, words: str
) -> None:
    with pytest.raises(InputInvalid, match=words):
        unpacked(columns, bytes(8 * count), SCHEMA)


def test_json_has_null_where_a_number_is_none() -> None:
    assert json_of({"x": np.array([1.0, math.nan, math.inf])}) == {"x": [1.0, None, None]}


@pytest.mark.parametrize(("dt", "n"), [(0.0, 0), (0.01, 1), (1.0, 100), (86400.0, 8640000)])
def test_a_time_is_so_many_steps(dt: float, n: int) -> None:
    assert steps_of(dt, Fraction("0.01")) == n


@pytest.mark.parametrize("dt", [0.013, -0.01, math.nan, math.inf, 1e300, 1e-6])
def test_a_time_that_is_no_whole_number_of_steps_is_refused(dt: float) -> None:
    with pytest.raises(InputInvalid, match="whole multiple"):
        steps_of(dt, Fraction("0.01"))
