"""The C text of a component, as its reader sees it."""

from __future__ import annotations

import re

import pytest

from uuvsim_cosim.fmus.codegen.lowering import lower
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Model


@pytest.mark.parametrize("name", ["thruster", "bluerov2_heavy", "gps"])
def test_places_of_the_block_have_the_names_of_variables(name: str) -> None:
    lowered = lower(declare(name))
    assert not re.search(r"\bb\[\d", lowered.source)
    for placed in lowered.layout.placed:
        assert f"    v_{placed.variable.name} = {placed.offset}," in lowered.source


def test_each_result_names_its_variable() -> None:
    m = Model("two")
    x = m.state("x", (0.0, 0.0), unit="m")
    m.der(x, -x)
    m.output("y", 2.0 * x, unit="m")
    source = lower(m).source
    assert re.search(r"dx\[1\] = \S+; /\* der\(v_x \+ 1\) \*/", source)
    assert re.search(r"out\[1\] = \S+; /\* v_y \+ 1 \*/", source)


def test_names_that_are_no_words_of_c_stay_apart() -> None:
    m = Model("odd")
    a, b = m.input("a.b", unit="1"), m.input("a b", unit="1")
    m.output("y", a - b, unit="1")
    source = lower(m).source
    assert "b[v_a_b] - b[v_a_b_at_2]" in source
