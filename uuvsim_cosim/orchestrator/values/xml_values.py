"""Numbers, Booleans and texts in the XML files of SSP and OSP."""

from __future__ import annotations

from math import isfinite
from xml.etree.ElementTree import Element

from uuvsim_cosim.errors import InputInvalid

__all__ = ["BOOLEANS", "boolean", "float_of", "int_of", "local_name", "number", "text_of"]

BOOLEANS = {"true": True, "1": True, "false": False, "0": False}  # xs:boolean


def local_name(xml: Element) -> str:
    """Return an element's name without its namespace; "" for a comment."""
    return xml.tag.rpartition("}")[2] if isinstance(xml.tag, str) else ""


def number(value: float) -> str:
    """Write a number so that it reads back as the same bits."""
    return repr(float(value))


def boolean(text: str | None, default: bool = False) -> bool:
    """Read an xs:boolean."""
    return default if text is None else text.strip() in ("true", "1")


def text_of(value: object) -> str:
    """Write one element of a value."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return number(value) if isinstance(value, float) else str(value)


def float_of(xml: Element, attribute: str, place: str, default: float) -> float:
    """Read a finite number of an attribute; raises InputInvalid with the place."""
    text = xml.get(attribute)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputInvalid(place, f"{attribute} {text!r}", "a number such as 0.5")
    return value


def int_of(xml: Element, attribute: str, place: str, default: int) -> int:
    """Read a whole number of an attribute; raises InputInvalid with the place."""
    text = xml.get(attribute)
    if text is None:
        return default
    try:
        return int(text)
    except ValueError:
        raise InputInvalid(place, f"{attribute} {text!r}", "a whole number such as 2") from None
