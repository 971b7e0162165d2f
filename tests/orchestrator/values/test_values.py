"""Values that users give as text: what does not fit is named, element by element."""

from __future__ import annotations

import math

import pytest

from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.values.endpoints import find_variable
from uuvsim_cosim.orchestrator.values.values import Misfit, conversion, fit

SIX = Variable("Kp", "Float64", "parameter", "tunable", shape=(6,), unit="m")
ONE = Variable("k", "Float64", "parameter", "tunable", unit="m")


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("1,2,3,4,5,x", "where element 6, 'x', is no number"),
        ("[1, 2, 3, 4, 5, x]", "where element 6, 'x', is no number"),
        ("1 2 3 4 5 x", "where element 6, 'x', is no number"),
        ("1,y,3,4,5,x", "where element 2, 'y', is no number"),
        ("x,2,3,4,5,6", "where element 1, 'x', is no number"),
        ("1,2x,3,4,5,6", "where element 2, '2x', is no number"),
        ("1,2,3,4,5,", "where element 6 is empty"),
    ],
)
def test_an_element_that_is_no_number_is_named(text: str, told: str) -> None:
    with pytest.raises(Misfit) as caught:
        fit(SIX, text)
    assert caught.value.read == f"{text!r}, {told}"
    assert caught.value.expected.startswith("6 values of type Float64 such as")


@pytest.mark.parametrize(
    "text",
    [
        "1,2,3,4,5,6",
        "[1 2 3 4 5 6]",
        "1, 2, 3, 4, 5, 6 m",
        "100;200;300;400;500;600cm",
        "1 2 3 4 5 6m",
    ],
)
def test_lists_are_read_with_any_separator_and_a_unit_at_their_end(text: str) -> None:
    assert fit(SIX, text) == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)


@pytest.mark.parametrize(("text", "value"), [("0.4", 0.4), ("40 cm", 0.4), ("4e-1m", 0.4)])
def test_a_scalar_is_read_with_its_unit(text: str, value: float) -> None:
    assert fit(ONE, text) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [("2 kn", "m/s", 2 * 1852 / 3600), ("3000 rpm", "rad/s", 100 * math.pi), ("6 ft", "m", 1.8288)],
)
def test_a_value_is_read_in_knots_feet_and_revolutions(text: str, unit: str, value: float) -> None:
    variable = Variable("x", "Float64", "input", "continuous", unit=unit)
    assert fit(variable, text) == pytest.approx(value)


def test_a_connection_between_revolutions_and_radians_is_refused() -> None:
    assert conversion("rpm", "rad/s", {}) is None
    assert conversion("rpm", "rad/s", {}, of_value=True) is not None


def test_index_0_is_told_that_indices_count_from_1() -> None:
    description = Description("pid", "native", {"Kp": SIX})
    with pytest.raises(Misfit) as caught:
        find_variable("Kp[0]", description)
    assert str(caught.value.at("controller.Kp[0]")) == (
        "controller.Kp[0]: index [0] of Kp; expected indices from 1 to 6, as [2] or [1:3]; "
        "indices count from 1"
    )
