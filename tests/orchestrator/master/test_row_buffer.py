"""Room for rows: column by column, and columns apart by an odd number of cache lines."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.orchestrator.master.core import columns_of


@given(st.integers(1, 70), st.integers(0, 3000))
def test_columns_have_room_and_do_not_share_a_set_of_the_cache(columns: int, rows: int) -> None:
    room = columns_of(columns, rows)
    assert room.dtype == np.uint64
    assert room.shape[0] == columns
    assert rows <= room.shape[1] <= rows + 16
    assert room.strides[0] // 64 % 2 == 1
    assert not room.any()
    room[:] = 1
    assert room.flags.c_contiguous


def test_large_room_is_zero_and_can_be_written() -> None:
    room = columns_of(9, 40_000)
    assert not room.any()
    room[8, 39_999] = 7
    assert int(room.sum()) == 7
