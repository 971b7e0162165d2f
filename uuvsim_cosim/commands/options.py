"""Options of the form NAME=VALUE: read, or refused with what was expected."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from uuvsim_cosim.errors import InputInvalid

__all__ = ["assignments", "by_component", "value_of"]


def assignments(
    option: str, texts: Iterable[str], expected: str, *, dotted: bool
) -> dict[str, str]:
    """Give {left: right} of texts ``left=right``; `dotted`: the left side must hold a dot."""
    found: dict[str, str] = {}
    for text in texts:
        left, equals, right = (part.strip() for part in text.partition("="))
        component, dot, rest = left.rpartition(".")
        if not equals or not left or not right or (dotted and not (component and dot and rest)):
            raise InputInvalid(f"{option} {text}: expected {expected}")
        if left in found:
            raise InputInvalid(f"{option} {text}: {left} is given twice; expected once")
        found[left] = right
    return found


def by_component(found: dict[str, str]) -> dict[str, dict[str, str]]:
    """Group {component.variable: value} by component; an index may stand behind the variable."""
    grouped: dict[str, dict[str, str]] = {}
    for left, right in found.items():
        component, _, variable = left.rpartition(".")
        grouped.setdefault(component, {})[variable] = right
    return grouped


def value_of(text: str) -> Any:
    """Give a number for a text that is one; any other text stays, e.g. ``2 km/h`` or ``true``."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
