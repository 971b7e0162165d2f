"""Frames and columns: what is written is read, and what is no frame is refused in words."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.bridge.desk import SignalInfo
from uuvsim_cosim.bridge.wire import Disconnected, Limits, Reader, frame
from uuvsim_cosim.bridge.wire_calls import steps_of
from uuvsim_cosim.bridge.wire_values import columns_of, json_of, taken, unpacked
from uuvsim_cosim.errors import InputInvalid

SCHEMA = {
    info.name: info
    for info in (
        SignalInfo("a.x", "Float64", (2, 3), "m", "input", True),
        SignalInfo("a.n", "Int32", (), "1", "parameter", True),
        SignalInfo("a.on", "Boolean", (), "1", "parameter", True),
        SignalInfo("a.s", "String", (), "1", "parameter", True),
    )
}


def pieces(data: bytes, size: int) -> Callable[[int, bool], bytes]:
    """Give bytes piece by piece, as a socket may."""
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
    columns, texts, payload = columns_of({**values, "a.s": "word"}, SCHEMA)
    assert texts == [{"name": "a.s", "value": "word"}]
    back = unpacked(columns, payload, SCHEMA)
    assert set(back) == set(values)
    for name, value in values.items():
        assert np.array_equal(back[name], value)
        assert back[name].dtype == np.asarray(value).dtype


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"a.y": 1}, "near names: a.x"),
        ({"a.x": [1, 2]}, "2 numbers were read; expected 6 numbers of type Float64 in m"),
        ({"a.x": ["word"]}, "expected 6 numbers"),
        ({"a.n": 1.5}, "expected 1 number of type Int32"),
        ({"a.n": 1e12}, "expected -2147483648 to 2147483647"),
        ({"a.n": math.nan}, "Int32"),
        ({"a.on": 2}, "expected 0 to 1"),
        ({"a.s": 3}, "expected a text"),
        ([1], "expected an object"),
    ],
)
def test_values_that_do_not_fit_are_refused_in_words(values: object, words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        taken(values, SCHEMA)


def test_a_text_passes_as_it_is_for_it_may_carry_a_unit() -> None:
    assert taken({"a.x": "0.4 km/h"}, SCHEMA) == {"a.x": "0.4 km/h"}


@pytest.mark.parametrize(
    ("columns", "count", "words"),
    [
        ([{"name": "a.x"}], 5, "5 numbers are left in the payload; expected 6"),
        ([{"name": "a.x"}], 7, "7 numbers were read; the columns name 6"),
        ([{"name": "a.x", "shape": [2, -3]}], 6, "shape"),
        ([{"name": "a.x", "shape": [1 << 40]}], 6, "shape"),
        ([{}], 6, "a name"),
        ("a.x", 6, "a list"),
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
