from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.importer.variables_fmi2 import fold


def scalar(name: str, reference: int = 0, **changes: Any) -> Variable:
    return replace(
        Variable(name, "Float64", "input", "continuous", value_references=(reference,)), **changes
    )


@given(
    st.lists(st.integers(1, 4), min_size=1, max_size=3).map(tuple),
    st.randoms(use_true_random=False),
)
def test_a_complete_group_folds_row_by_row_whatever_its_order(shape: Any, random: Any) -> None:
    names = [",".join(str(i + 1) for i in index) for index in np.ndindex(*shape)]
    scalars = [scalar(f"x[{n}]", r, start=float(r)) for r, n in enumerate(names)]
    random.shuffle(scalars)
    (x,) = fold(scalars).values()
    assert (x.name, x.shape) == ("x", shape)
    assert x.value_references == tuple(range(len(names)))
    np.testing.assert_array_equal(x.start, np.arange(len(names), dtype=float).reshape(shape))


@pytest.mark.parametrize(
    "scalars",
    [
        [scalar("x[1]"), scalar("x[3]")],
        [scalar("x[0]"), scalar("x[1]")],
        [scalar("x[1]"), scalar("x[2]", type="Int32")],
        [scalar("x[1]"), scalar("x[2]", causality="output")],
        [scalar("x[1]"), scalar("x[2]", variability="discrete")],
        [scalar("x[1]"), scalar("x[2]"), scalar("x")],
        [scalar("x[1]"), scalar("x[1,1]")],
        [scalar("x[1].a"), scalar("x[2].a")],
    ],
)
def test_a_group_that_does_not_agree_stays_scalar(scalars: list[Variable]) -> None:
    assert fold(scalars) == {v.name: v for v in scalars}


def test_elements_keep_units_that_differ() -> None:
    eta = fold([scalar("eta[1]", unit="m"), scalar("eta[2]", unit="rad")])["eta"]
    assert (eta.unit, eta.units) == (None, ("m", "rad"))
    tau = fold([scalar("tau[1]", unit="N"), scalar("tau[2]", unit="N")])["tau"]
    assert (tau.unit, tau.units) == ("N", ("N", "N"))


def test_dependencies_name_what_was_folded() -> None:
    scalars = [
        scalar("u[1]"),
        scalar("u[2]"),
        scalar("a"),
        scalar("y[1]", causality="output", dependencies=("u[1]", "u[2]")),
        scalar("y[2]", causality="output", dependencies=("a",)),
    ]
    assert fold(scalars)["y"].dependencies == ("u", "a")


def test_one_undeclared_element_leaves_the_group_undeclared() -> None:
    scalars = [
        scalar("y[1]", causality="output", dependencies=()),
        scalar("y[2]", causality="output"),
    ]
    assert fold(scalars)["y"].dependencies is None


def test_a_folded_range_admits_what_each_element_admits() -> None:
    scalars = [scalar("x[1]", min=-1.0, max=2.0), scalar("x[2]", min=-3.0)]
    x = fold(scalars)["x"]
    assert (x.min, x.max) == (-3.0, None)
