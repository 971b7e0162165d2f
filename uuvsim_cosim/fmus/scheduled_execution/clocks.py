"""Input clocks of a Scheduled Execution FMU, as its model description declares them."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from xml.etree.ElementTree import Element

from uuvsim_cosim.errors import FmuError
from uuvsim_cosim.fmus.importer.archive import shown
from uuvsim_cosim.fmus.importer.read_description import FmuArchive
from uuvsim_cosim.fmus.importer.safe_xml import read_xml

__all__ = ["PERIODIC", "InputClock", "read_clocks"]

PERIODIC = ("constant", "fixed", "tunable")
_VARIABILITIES = (*PERIODIC, "changing", "countdown", "triggered")


@dataclass(frozen=True)
class InputClock:
    """An input clock, which activates one model partition.

    `interval` and `shift` are exact numbers of seconds; `interval` is None if the FMU gives it
    while it runs. Of clocks that tick at one instant, the smallest `priority` is first.
    """

    name: str
    reference: int
    variability: str  # intervalVariability
    priority: int
    interval: Fraction | None  # [s]
    shift: Fraction  # [s] from the start time to the first tick of a periodic clock


def read_clocks(archive: FmuArchive) -> tuple[InputClock, ...]:
    """Return the input clocks in the order of their priorities; raises FmuError if one is wrong."""
    place = f"{shown(archive.path)}/modelDescription.xml"
    root = read_xml(archive.folder / "modelDescription.xml", place=place)
    inputs = (e for e in root.iterfind("ModelVariables/Clock") if e.get("causality") == "input")
    found = [_clock(e, f"{place}: clock {e.get('name')!r}") for e in inputs]
    return tuple(sorted(found, key=lambda c: c.priority))


def _clock(element: Element, place: str) -> InputClock:
    kind = element.get("intervalVariability", "")
    if kind not in _VARIABILITIES:
        expected = f"one of {', '.join(_VARIABILITIES)}"
        raise FmuError(place, f"intervalVariability {kind!r}", expected)
    priority = _number(element, "priority", place)
    if priority is None:
        raise FmuError(place, "no priority", "a whole number, which Scheduled Execution requires")
    interval = _seconds(element, "interval", place)
    if kind in PERIODIC:
        if interval is None and kind == "constant":
            raise FmuError(place, "no intervalDecimal", "one, which a constant clock requires")
        if interval is not None and interval <= 0:
            raise FmuError(place, f"an interval of {float(interval):g} s", "more than 0 s")
    shift = _seconds(element, "shift", place) or Fraction(0)
    if shift < 0:
        raise FmuError(place, f"a shift of {float(shift):g} s", "0 s or more")
    return InputClock(
        element.get("name", ""), int(element.get("valueReference", "")), kind, int(priority),
        interval if kind in PERIODIC else None, shift,
    )  # fmt: skip


def _seconds(element: Element, word: str, place: str) -> Fraction | None:
    """Return the interval or shift [s]; the rational number is used if there is one."""
    counter = _number(element, f"{word}Counter", place)
    resolution = _number(element, "resolution", place)
    if counter is not None and resolution:
        return counter / resolution
    return _number(element, f"{word}Decimal", place)


def _number(element: Element, attribute: str, place: str) -> Fraction | None:
    text = element.get(attribute)
    if text is None:
        return None
    try:
        return Fraction(text.strip())
    except (ValueError, ZeroDivisionError):
        raise FmuError(place, f"{attribute} {text!r}", "a number") from None
