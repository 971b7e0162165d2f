"""Columns that are read by block have the samples of arrays."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.orchestrator.recording.samples import (
    Array,
    Column,
    blocks,
    computed,
    picked,
    track_rows,
    unwrapped,
    within,
)
from uuvsim_cosim.view.reports.page_data import Bins

LENGTH = 40
ANGLES = st.lists(st.floats(-9, 9) | st.just(float("nan")), min_size=LENGTH, max_size=LENGTH)
ROWS = st.integers(1, LENGTH)


def column(samples: Array, rows: int) -> Column:
    def read() -> Iterator[Array]:
        return (samples[k : k + rows] for k in range(0, len(samples), rows))

    return Column(read, len(samples))


@given(samples=ANGLES.map(np.array), rows=ROWS)
def test_a_function_of_columns_is_that_of_arrays(samples: Array, rows: int) -> None:
    both = column(samples, rows), column(samples[::-1], rows)
    found = computed(np.subtract, *both)
    assert isinstance(found, Column)
    np.testing.assert_array_equal(np.asarray(found), samples - samples[::-1])
    assert max(len(block) for block in blocks(found)) == rows


@given(samples=ANGLES.map(np.array), rows=ROWS)
def test_angles_of_columns_are_unwrapped_across_blocks(samples: Array, rows: int) -> None:
    found = np.asarray(unwrapped(column(samples, rows)))
    np.testing.assert_allclose(found, np.unwrap(samples), atol=1e-12)


@given(samples=ANGLES.map(np.array), rows=ROWS, first=ROWS, end=ROWS | st.none())
def test_rows_outside_of_a_range_are_nan(
    samples: Array, rows: int, first: int, end: int | None
) -> None:
    expected = samples.copy()
    expected[:first] = np.nan
    expected[LENGTH if end is None else end :] = np.nan
    np.testing.assert_array_equal(np.asarray(within(column(samples, rows), first, end)), expected)
    np.testing.assert_array_equal(np.asarray(within(samples, first, end)), expected)


@given(
    samples=ANGLES.map(np.array), rows=ROWS, some=st.lists(st.integers(0, LENGTH - 1)).map(sorted)
)
def test_rows_are_picked_across_blocks(samples: Array, rows: int, some: list[int]) -> None:
    index = np.array(some, np.intp)
    np.testing.assert_array_equal(picked(column(samples, rows), index), samples[index])


@given(rows=ROWS)
def test_rows_of_a_track_show_the_part_in_which_the_vehicle_moves(rows: int) -> None:
    """The vehicle travels 30 m in the first 10 rows, and then waits for 990."""
    north = np.minimum(np.arange(1000.0), 10.0) * 3.0
    found = track_rows(column(north, rows), column(0.0 * north, rows), 20)
    np.testing.assert_array_equal(found, track_rows(north, 0.0 * north, 20))
    assert set(range(1, 11)) <= set(found)
    assert {0, 999} <= set(found)
    assert len(found) <= 20
    assert len(track_rows(north, 0.0 * north, 1000)) == 1000


@given(samples=ANGLES.map(np.array), rows=ROWS, most=st.integers(1, 19))
def test_intervals_of_columns_have_the_extremes_of_arrays(
    samples: Array, rows: int, most: int
) -> None:
    bins = Bins([np.arange(float(LENGTH))], most)
    found = bins.of(column(samples, rows))
    np.testing.assert_array_equal(found, bins.of(samples))
    known = samples[np.isfinite(samples)]
    if known.size:
        assert (np.nanmin(found), np.nanmax(found)) == (known.min(), known.max())
