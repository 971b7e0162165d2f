"""Units: what may be connected, and by which factor."""

import math

import pytest

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.units import (
    frequency_of,
    parse_unit,
    seconds_of,
    unit_of,
    value_conversion,
)


@pytest.mark.parametrize(
    ("name", "factor"),
    [
        ("kg.m2", 1.0),
        ("N.s2/rad2", 1.0),
        ("km/h", 1 / 3.6),
        ("deg/s", math.pi / 180),
        ("mm2", 1e-6),
    ],
)
def test_a_product_of_powers_has_the_product_of_factors(name: str, factor: float) -> None:
    assert parse_unit(name).factor == pytest.approx(factor, rel=1e-15)


def test_hertz_is_not_radians_per_second() -> None:
    assert not parse_unit("Hz").commensurable(parse_unit("rad/s"))
    assert not parse_unit("rpm").commensurable(parse_unit("rad/s"))


def test_newton_is_kilogram_metre_per_second_squared() -> None:
    assert parse_unit("N").exponents == parse_unit("kg.m/s2").exponents


def test_conversion_of_a_temperature_has_an_offset() -> None:
    factor, offset = parse_unit("degC").conversion_to(parse_unit("K"))
    assert factor * 20.0 + offset == pytest.approx(293.15)


def test_conversion_back_gives_the_value() -> None:
    there = parse_unit("kPa").conversion_to(parse_unit("Pa"))
    back = parse_unit("Pa").conversion_to(parse_unit("kPa"))
    assert (3.5 * there[0] + there[1]) * back[0] + back[1] == pytest.approx(3.5)


def test_an_unknown_unit_is_refused_with_its_place() -> None:
    with pytest.raises(ParameterInvalid, match=r"hull\.mass.*furlong"):
        unit_of("furlong", "hull.mass")


# The international yard and pound of 1959, the nautical mile of 1929, NIST SP 811 (2008).
@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("kn", "m/s", 1852 / 3600), ("knots", "m/s", 1852 / 3600), ("kt", "km/h", 1.852),
        ("ft", "m", 0.3048), ("feet", "m", 0.3048), ("foot", "in", 12), ("inches", "mm", 25.4),
        ("fathoms", "ft", 6), ("yd", "ft", 3), ("nmi", "m", 1852), ("ft/min", "m/s", 0.00508),
        ("lb", "kg", 0.45359237), ("pounds", "kg", 0.45359237), ("lbf", "N", 4.4482216152605),
        ("psi", "Pa", 6894.757293168361), ("lbf/in2", "psi", 1), ("bar", "kPa", 100),
        ("dbar", "Pa", 1e4), ("mbar", "Pa", 100), ("atm", "Pa", 101325),
        ("lb/ft3", "kg/m3", 16.01846),
        ("rpm", "rad/s", 2 * math.pi / 60), ("rev/s", "rad/s", 2 * math.pi), ("rpm", "Hz", 1 / 60),
        ("rev", "rad", 2 * math.pi), ("rpm/s", "rad/s2", 2 * math.pi / 60), ("t", "kg", 1000),
        ("L", "m3", 1e-3),
    ],
)  # fmt: skip
def test_a_value_in_a_unit_of_ships_and_workshops_is_converted(
    text: str, unit: str, value: float
) -> None:
    pair = value_conversion(parse_unit(text), parse_unit(unit))
    assert pair is not None
    assert pair == (pytest.approx(value, rel=1e-6), 0.0)


def test_degrees_fahrenheit_have_an_offset() -> None:
    pair = value_conversion(parse_unit("degF"), parse_unit("degC"))
    assert pair is not None
    assert pair[0] * 212.0 + pair[1] == pytest.approx(100.0)


@pytest.mark.parametrize(
    ("text", "unit"), [("Hz", "rad/s"), ("rpm", "m"), ("lb", "N"), ("1", "rad")]
)
def test_a_value_of_another_kind_is_not_converted(text: str, unit: str) -> None:
    assert value_conversion(parse_unit(text), parse_unit(unit)) is None


@pytest.mark.parametrize(
    ("text", "value"),
    [("90", 90), ("90 s", 90), ("1.5min", 90), ("20 ms", 0.02), ("100ms", 0.1), ("2 minutes", 120),
     ("1e2 s", 100), ("0.5 h", 1800), (" 3 ", 3), ("300us", 3e-4)],
)  # fmt: skip
def test_a_time_may_carry_a_unit(text: str, value: float) -> None:
    assert seconds_of(text, "x") == value  # exactly, so that it is a whole number of steps


@pytest.mark.parametrize("text", ["ten", "", "3 m", "3 parsec", "1 2", "1,5", "s"])
def test_what_is_no_time_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(InputInvalid, match=r"--until.*expected seconds, such as 90"):
        seconds_of(text, "--until")


def test_a_frequency_is_in_hertz() -> None:
    assert frequency_of("6 rpm", "x") == pytest.approx(0.1)
    assert frequency_of("0.1 Hz", "x") == 0.1
    with pytest.raises(InputInvalid, match="hertz"):
        frequency_of("1 rad/s", "x")
