"""Two recordings compared."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.recording.compare import compare_signals
from uuvsim_cosim.orchestrator.recording.signals import Signals


def recording(
    values: Mapping[str, Any], time: Any = None, units: Mapping[str, str] | None = None
) -> Signals:
    arrays = {name: np.asarray(value) for name, value in values.items()}
    rows = len(next(iter(arrays.values())))
    at = np.arange(rows) / 10 if time is None else np.asarray(time, dtype=float)
    return Signals(at, np.arange(rows), arrays, units or dict.fromkeys(values, "m"))


def test_a_recording_equals_itself() -> None:
    a = recording({"x": [1.0, math.nan, math.inf], "n": [1, 2, 3], "s": np.array(["a", "b", "c"])})
    found = compare_signals(a, a)
    assert found.equal
    assert (found.rows, found.signals) == (3, 3)


def test_the_earliest_difference_comes_first_with_time_and_size() -> None:
    a = recording({"late": [0.0, 0.0, 0.0], "early": [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]})
    b = recording({"late": [0.0, 0.0, 9.0], "early": [[0.0, 0.0], [0.0, 2.0], [0.0, -3.0]]})
    first, second = compare_signals(a, b).differences
    assert (first.signal, first.time, first.a, first.b, first.size) == ("early[2]", 0.1, 0, 2, 2)
    assert (first.largest, first.largest_time) == (3.0, 0.2)
    assert (second.signal, second.time, second.unit) == ("late", 0.2, "m")


def test_a_difference_of_exactly_the_tolerance_is_none() -> None:
    a, b = recording({"x": [0.0, 1.0]}), recording({"x": [0.0, 1.5]})
    assert compare_signals(a, b, 0.5).equal
    assert not compare_signals(a, b, 0.499).equal


def test_one_bit_differs_without_a_tolerance() -> None:
    a, b = recording({"x": [1.0]}), recording({"x": [math.nextafter(1.0, 2.0)]})
    (found,) = compare_signals(a, b).differences
    assert found.size == 2.0**-52


@pytest.mark.parametrize(("p", "q"), [(math.nan, 1.0), (math.inf, 1.0), (math.inf, -math.inf)])
def test_what_is_finite_in_one_alone_differs_infinitely(p: float, q: float) -> None:
    (found,) = compare_signals(recording({"x": [p]}), recording({"x": [q]}), 1e300).differences
    assert found.size == math.inf


def test_large_integers_are_compared_exactly() -> None:
    a = recording({"n": np.array([2**64 - 1], np.uint64)})
    b = recording({"n": np.array([2**64 - 2], np.uint64)})
    (found,) = compare_signals(a, b).differences
    assert (found.a, found.b, found.size) == (2**64 - 1, 2**64 - 2, 1.0)


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (recording({"y": [1.0, 2.0]}), "x: only in A"),
        (recording({"x": [[1.0, 2.0], [1.0, 2.0]]}), "x: size 1 in A, 2 in B"),
        (recording({"x": [1.0, 2.0]}, units={"x": "ft"}), "x: in m in A, in ft in B"),
        (recording({"x": [1.0, 2.0, 3.0]}), "time: 2 rows up to 0.1 s in A, 3 rows up to 0.2 s"),
        (recording({"x": [1.0, 2.0]}, time=[0.0, 0.2]), "time: row 2 is at 0.1 s in A, at 0.2 s"),
    ],
)
def test_other_signals_sizes_units_and_times_are_differences(other: Signals, said: str) -> None:
    found = compare_signals(recording({"x": [1.0, 2.0]}), other)
    assert not found.equal
    assert found.mismatches[0].startswith(said)


def test_a_difference_behind_the_end_of_the_shorter_recording_is_its_length() -> None:
    a, b = recording({"x": [1.0, 2.0]}), recording({"x": [1.0, 2.0, 99.0]})
    found = compare_signals(a, b)
    assert not found.differences
    assert found.rows == 2


@pytest.mark.parametrize("wrong", [-1.0, math.nan, math.inf])
def test_a_tolerance_that_is_none_is_refused(wrong: float) -> None:
    a = recording({"x": [1.0]})
    with pytest.raises(InputInvalid, match="0 or more"):
        compare_signals(a, a, wrong)
