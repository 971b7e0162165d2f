"""What a run records of values that no row holds."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.bridge.server.active_run import Record, Store
from uuvsim_cosim.fmus.description import Variable


@pytest.mark.parametrize(
    ("type_", "value"),
    [("Binary", b"a\0"), ("String", "thrüster"), ("Float64", 0.5), ("UInt64", 2**64 - 1)],
)
def test_a_value_is_kept_whole_in_each_row(type_: Any, value: Any) -> None:
    place: Any = SimpleNamespace(
        variable=Variable("p", type_, "parameter", "fixed"), element=None, path="a"
    )
    record: Any = object.__new__(Record)
    record._places, record._read = {"a.p": place}, lambda _: value
    kind = np.dtype("O" if isinstance(value, bytes | str) else np.array(value).dtype)
    record._store = Store(3, {"a.p": (kind, ())}, in_file=False)
    record._rows, record._has_time = 0, False
    record._put(3, np.arange(3.0), {})
    assert record._store.first_rows(3)["a.p"].tolist() == [value] * 3
