"""Rows of slots: the same numbers as one value after another, in the order of the loop."""

from __future__ import annotations

import ctypes
from typing import Any, ClassVar

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Causality, Description, Variable, VariableType
from uuvsim_cosim.orchestrator.master.callback import Callbacks
from uuvsim_cosim.orchestrator.master.core_library import by_type, decode, encode
from uuvsim_cosim.orchestrator.master.slot_row import SlotRow

VALUES: dict[str, tuple[VariableType, Any]] = {
    "on": ("Boolean", True), "x": ("Float64", [0.5, -1.5, 2.5]), "n": ("Int32", -7),
    "y": ("Float64", 4.0), "big": ("UInt64", 2**63),
}  # fmt: skip


def variables(causality: Causality) -> list[Variable]:
    """One variable of each kind of slot; types are mixed on purpose."""
    return [
        Variable(name, type_, causality, "discrete" if type_ != "Float64" else "continuous",
                 np.shape(value), None, value) for name, (type_, value) in VALUES.items()
    ]  # fmt: skip


def test_a_row_has_the_numbers_at_the_places_of_the_loop() -> None:
    row = SlotRow(variables("input"))
    slots = np.frombuffer(bytearray(row.pack(row.start)), np.uint64)
    first = 0
    for v in by_type(variables("input")):
        np.testing.assert_array_equal(decode(v, slots[first : first + v.size]), VALUES[v.name][1])
        first += v.size
    assert row.unpack(slots.tobytes()) == row.start
    assert row.start[row.places["x"]] == (0.5, -1.5, 2.5)


def test_a_text_has_no_place_in_a_row() -> None:
    with pytest.raises(InputInvalid, match="row of slots: name: is String; expected a number"):
        SlotRow([Variable("name", "String", "input", "discrete", (), None, "")])


def test_the_loop_exchanges_whole_rows_with_a_component_that_has_them() -> None:
    class Mirror:
        description = Description("mirror", "python", {
            v.name: v for v in [*variables("input"), Variable("z", "Float64", "output",
                                "continuous", (2,), None, [0.0, 0.0])]
        }, description="", can_get_and_set_state=False, can_serialize_state=False)  # fmt: skip
        steps: ClassVar[list[tuple[bytes, float, float]]] = []

        def set_row(self, row: bytes) -> None:
            self.row = row

        def do_step(self, t: float, h: float) -> None:
            self.steps.append((self.row, t, h))

        def get_row(self) -> bytes:
            return SlotRow(self.description.of("output")).pack([1.5, 2.5])

    component: Any = Mirror()
    callbacks = Callbacks(component)
    inputs = SlotRow(variables("input"))
    slots = np.zeros(len(inputs.start), np.uint64)
    first = 0
    for v in by_type(variables("input")):
        encode(v, VALUES[v.name][1], slots[first : first + v.size])
        first += v.size
    read = (ctypes.c_double * 2)()
    callbacks._do_step(None, 0.25, 0.5, slots.ctypes.data)
    callbacks._get(None, ctypes.addressof(read))
    assert callbacks.error is None
    assert Mirror.steps == [(inputs.pack(inputs.start), 0.25, 0.5)]
    assert list(read) == [1.5, 2.5]
