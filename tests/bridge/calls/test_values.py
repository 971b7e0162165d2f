"""Numbers that travel as bytes: each takes eight, and none is rounded."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.bridge.calls.values import array_of, numbers_of
from uuvsim_cosim.errors import InputInvalid


@pytest.mark.parametrize("kind", ["i1", "<i4", ">i4", "<f4", "<f8", ">f8", "?"])
def test_each_number_becomes_a_float64_of_eight_bytes(kind: str) -> None:
    array = np.array([[1, 0], [1, 1]], kind)
    assert np.array_equal(np.frombuffer(numbers_of(array), "<f8"), [1.0, 0.0, 1.0, 1.0])


@pytest.mark.parametrize("kind", ["<i8", ">i8", "<u8", ">u8"])
def test_whole_numbers_of_64_bits_stay_whole(kind: str) -> None:
    large = 2**63 - 1 if "i" in kind else 2**64 - 1
    read = np.frombuffer(numbers_of(np.array([large, 1], kind)), f"<{kind[1:]}")
    assert read.tolist() == [large, 1]


@pytest.mark.parametrize("value", [[True, 0, 0], (0.5, False), [[1, 2], [3, True]]])
def test_booleans_among_numbers_are_refused(value: object) -> None:
    with pytest.raises(InputInvalid, match=r"hull\.v_c: .*; expected numbers, without true"):
        array_of("hull.v_c", value)


def test_numbers_and_booleans_alone_are_kept() -> None:
    assert array_of("x", [1, 2.5]).tolist() == [1, 2.5]
    assert array_of("x", [True, False]).dtype == bool
    assert array_of("x", True).dtype == bool
