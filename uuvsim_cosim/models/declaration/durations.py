"""Times and frequencies that users write: bare numbers in s and Hz, or with a unit."""

from __future__ import annotations

import math
import re

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.units import Unit, parse_unit

__all__ = ["frequency_of", "seconds_of"]

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
