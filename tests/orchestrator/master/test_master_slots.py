from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from uuvsim_cosim.orchestrator.master.master import Master
from uuvsim_cosim.orchestrator.master.prepared import prepare
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System


@pytest.fixture
def masters(first_order_fmi3: Path) -> Iterator[list[Master]]:
    """Two of the same chain; the second shows and takes values without a call."""
    fmu = str(first_order_fmi3)
    system = System("chain", "0.1").add("a", fmu).add("b", fmu).connect("a.y", "b.u")
    plan = flatten(system)
    live = [("a", "y"), ("b", "y"), ("b", "w"), ("b", "int32_out")]
    made = [
        Master(plan, prepare(plan)),
        Master(plan, prepare(plan), live=live, held=[("a", "u"), ("b", "v")]),
    ]
    for master in made:
        master.initialize()
    yield made
    for master in made:
        master.free()


def test_slots_are_get_and_set_without_a_call(masters: list[Master]) -> None:
    plain, quick = masters
    u, v = quick.slots("a", "u"), quick.slots("b", "v")
    assert u is not None
    assert v is not None
    for k in range(5):
        plain.set("a", "u", 0.5 * k)
        plain.set("b", "v", np.arange(3.0) * k)
        u[:], v[:] = 0.5 * k, np.arange(3.0) * k
        for master in masters:
            master.step(2)
        for path, name in (("a", "y"), ("b", "y"), ("b", "w"), ("b", "int32_out")):
            shown = quick.slots(path, name)
            np.testing.assert_array_equal(shown, np.ravel(plain.get(path, name)))


def test_a_reset_gives_held_inputs_their_start_values(masters: list[Master]) -> None:
    quick = masters[1]
    u = quick.slots("a", "u")
    assert u is not None
    u[:] = 3.0
    quick.step(3)
    quick.reset()
    assert u.tolist() == [0.0]
    assert quick.slots("a", "y") == [0.0]


def test_what_the_loop_does_not_read_has_no_slots(masters: list[Master]) -> None:
    assert masters[1].slots("a", "w") is None
    assert masters[1].slots("a", "string_out") is None
