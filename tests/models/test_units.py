"""Units: what may be connected, and by which factor."""

import math

import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.units import parse_unit, unit_of


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
