"""Units in FMI's terms: seven SI exponents and rad, a factor and an offset.

Hz, rpm and 1/s are not rad/s: rad counts as a dimension of its own, so a wrong connection is
found instead of being off by 2 pi.

Times and frequencies that users write are bare numbers in s and Hz, or have a unit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid

__all__ = ["Unit", "frequency_of", "parse_unit", "seconds_of", "unit_of", "value_conversion"]

BASE = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Unit:
    """A unit: value in base units = factor · value + offset; exponents in the order of `BASE`."""

    name: str
    exponents: tuple[int, ...]
    factor: float = 1.0
    offset: float = 0.0

    def commensurable(self, other: Unit) -> bool:
        """Return whether a value in this unit can be converted into the other."""
        return self.exponents == other.exponents

    def conversion_to(self, other: Unit) -> tuple[float, float]:
        """Return (factor, offset) with value_in_other = factor · value + offset."""
        if self.factor == other.factor and self.offset == other.offset:
            return 1.0, 0.0
        return self.factor / other.factor, (self.offset - other.offset) / other.factor


def _exponents(**powers: int) -> tuple[int, ...]:
    return tuple(powers.get(b, 0) for b in BASE)


_PI = 3.141592653589793
_NAMED = {
    "1": Unit("1", _exponents()),
    "kg": Unit("kg", _exponents(kg=1)),
    "g": Unit("g", _exponents(kg=1), 1e-3),
    "m": Unit("m", _exponents(m=1)),
    "km": Unit("km", _exponents(m=1), 1e3),
    "cm": Unit("cm", _exponents(m=1), 1e-2),
    "mm": Unit("mm", _exponents(m=1), 1e-3),
    "s": Unit("s", _exponents(s=1)),
    "ms": Unit("ms", _exponents(s=1), 1e-3),
    "us": Unit("us", _exponents(s=1), 1e-6),
    "min": Unit("min", _exponents(s=1), 60.0),
    "h": Unit("h", _exponents(s=1), 3600.0),
    "A": Unit("A", _exponents(A=1)),
    "K": Unit("K", _exponents(K=1)),
    "degC": Unit("degC", _exponents(K=1), 1.0, 273.15),
    "mol": Unit("mol", _exponents(mol=1)),
    "cd": Unit("cd", _exponents(cd=1)),
    "rad": Unit("rad", _exponents(rad=1)),
    "deg": Unit("deg", _exponents(rad=1), _PI / 180.0),
    "Hz": Unit("Hz", _exponents(s=-1)),
    "rpm": Unit("rpm", _exponents(s=-1), 1.0 / 60.0),
    "rev": Unit("rev", _exponents(), 1.0),
    "N": Unit("N", _exponents(kg=1, m=1, s=-2)),
    "kN": Unit("kN", _exponents(kg=1, m=1, s=-2), 1e3),
    "kgf": Unit("kgf", _exponents(kg=1, m=1, s=-2), 9.80665),
    "Pa": Unit("Pa", _exponents(kg=1, m=-1, s=-2)),
    "kPa": Unit("kPa", _exponents(kg=1, m=-1, s=-2), 1e3),
    "bar": Unit("bar", _exponents(kg=1, m=-1, s=-2), 1e5),
    "J": Unit("J", _exponents(kg=1, m=2, s=-2)),
    "W": Unit("W", _exponents(kg=1, m=2, s=-3)),
    "kW": Unit("kW", _exponents(kg=1, m=2, s=-3), 1e3),
    "Wh": Unit("Wh", _exponents(kg=1, m=2, s=-2), 3600.0),
    "Ah": Unit("Ah", _exponents(A=1, s=1), 3600.0),
    "C": Unit("C", _exponents(A=1, s=1)),
    "V": Unit("V", _exponents(kg=1, m=2, s=-3, A=-1)),
    "mV": Unit("mV", _exponents(kg=1, m=2, s=-3, A=-1), 1e-3),
    "Ohm": Unit("Ohm", _exponents(kg=1, m=2, s=-3, A=-2)),
    "T": Unit("T", _exponents(kg=1, s=-2, A=-1)),
    "uT": Unit("uT", _exponents(kg=1, s=-2, A=-1), 1e-6),
    "%": Unit("%", _exponents(), 1e-2),
    # Of ships and of the United States: exact by definition, but psi, which is lbf/in2.
    "kn": Unit("kn", _exponents(m=1, s=-1), 1852.0 / 3600.0),
    "nmi": Unit("nmi", _exponents(m=1), 1852.0),
    "ft": Unit("ft", _exponents(m=1), 0.3048),
    "in": Unit("in", _exponents(m=1), 0.0254),
    "yd": Unit("yd", _exponents(m=1), 0.9144),
    "fathom": Unit("fathom", _exponents(m=1), 1.8288),
    "lb": Unit("lb", _exponents(kg=1), 0.45359237),
    "lbf": Unit("lbf", _exponents(kg=1, m=1, s=-2), 0.45359237 * 9.80665),
    "psi": Unit("psi", _exponents(kg=1, m=-1, s=-2), 0.45359237 * 9.80665 / 0.0254**2),
    "mbar": Unit("mbar", _exponents(kg=1, m=-1, s=-2), 100.0),
    "dbar": Unit("dbar", _exponents(kg=1, m=-1, s=-2), 1e4),
    "hPa": Unit("hPa", _exponents(kg=1, m=-1, s=-2), 100.0),
    "atm": Unit("atm", _exponents(kg=1, m=-1, s=-2), 101325.0),
    "degF": Unit("degF", _exponents(K=1), 5.0 / 9.0, 273.15 - 32.0 * 5.0 / 9.0),
    "L": Unit("L", _exponents(m=3), 1e-3),
    "t": Unit("t", _exponents(kg=1), 1e3),
}
_WORDS = {
    "kt": "kn", "kts": "kn", "knot": "kn", "knots": "kn", "foot": "ft", "feet": "ft",
    "inch": "in", "inches": "in", "fathoms": "fathom", "ftm": "fathom", "lbs": "lb",
    "pound": "lb", "pounds": "lb", "rps": "rev/s", "sec": "s", "second": "s",
    "seconds": "s", "minute": "min", "minutes": "min", "hour": "h", "hours": "h", "metre": "m",
    "metres": "m", "meter": "m", "meters": "m", "degree": "deg", "degrees": "deg", "bars": "bar",
}  # fmt: skip
_TURNS = ("rpm", "rev", "rps")
_FACTOR = re.compile(r"([A-Za-z%]+|1)(-?\d+)?$")


def value_conversion(unit: Unit, wanted: Unit) -> tuple[float, float] | None:
    """Return (factor, offset) from a value that somebody wrote to the unit that is wanted.

    Unlike for a connection, where rpm and rad/s may be a mistake, a value that is written in
    revolutions is an angle: 60 rpm is 2 pi rad/s. None if the units are not commensurable.
    """
    if unit.commensurable(wanted):
        return unit.conversion_to(wanted)
    if any(turn in re.findall("[a-z]+", unit.name) for turn in _TURNS):
        angle = tuple(e + (name == "rad") for e, name in zip(unit.exponents, BASE, strict=True))
        if angle == wanted.exponents:
            return 2.0 * _PI * unit.factor / wanted.factor, 0.0
    return None


def parse_unit(name: str) -> Unit:
    """Read a unit such as ``kg.m2``, ``N.s2/rad2`` or ``rad/s``; raises ValueError if unknown."""
    text = name.replace(" ", "").replace("*", ".").replace("^", "").replace("·", ".")
    text = _WORDS.get(text, text)
    if text in _NAMED:
        return Unit(name, _NAMED[text].exponents, _NAMED[text].factor, _NAMED[text].offset)
    exponents = [0] * len(BASE)
    factor = 1.0
    for place, part in enumerate(text.split("/")):
        for item in part.strip("()").split("."):
            match = _FACTOR.match(item)
            if match is None or match[1] not in _NAMED:
                raise ValueError(f"unknown unit {item!r} in {name!r}")
            unit, power = _NAMED[match[1]], int(match[2] or 1) * (1 if place == 0 else -1)
            exponents = [e + power * u for e, u in zip(exponents, unit.exponents, strict=True)]
            factor *= unit.factor**power
    return Unit(name, tuple(exponents), factor)


def unit_of(name: str, place: str) -> Unit:
    """Read a unit; raises ParameterInvalid that names the place."""
    try:
        return parse_unit(name)
    except ValueError as error:
        raise ParameterInvalid(
            place, error, f"a product such as 'kg.m2' or 'N.s/m' of {', '.join(_NAMED)}"
        ) from None


_TEXT = re.compile(
    r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:inf|nan))\s*(.*?)\s*$", re.I
)


def seconds_of(text: str, place: str) -> float:
    """Return a time in s: ``90``, ``"90 s"``, ``1.5min``, ``20 ms``; raises InputInvalid."""
    return _value(text, place, parse_unit("s"), "seconds, such as 90, '90 s', '1.5 min' or '20 ms'")


def frequency_of(text: str, place: str) -> float:
    """Return a frequency in Hz: ``0.1``, ``"0.1 Hz"``, ``6 rpm``; raises InputInvalid."""
    return _value(text, place, parse_unit("Hz"), "hertz, such as 0.1 or '0.1 Hz'")


def _value(text: str, place: str, wanted: Unit, expected: str) -> float:
    match = _TEXT.match(text)
    if match is None:
        raise InputInvalid(place, f"{text!r}", expected)
    value = float(match[1])
    if not match[2]:
        return value
    try:
        unit = parse_unit(match[2])
    except ValueError:
        raise InputInvalid(place, f"unit {match[2]!r} of {text!r}", expected) from None
    if not unit.commensurable(wanted):
        raise InputInvalid(place, f"{text!r} is in {match[2]}", expected)
    found = value * unit.factor
    # 100 ms is 0.1 s, the number that is written so, and not the nearest product.
    rounded = float(f"{found:.15g}")
    return rounded if math.isclose(found, rounded, rel_tol=1e-15) else found
