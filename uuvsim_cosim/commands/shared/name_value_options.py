"""Reader of options of the form NAME=VALUE."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from uuvsim_cosim.errors import InputInvalid

__all__ = ["assignments", "by_component", "rates", "seconds", "step_text", "value_of"]


def seconds(option: str) -> Callable[[str], float]:
    """Return the parser of an option that takes a time: ``90``, ``"90 s"`` or ``1.5min``."""

    def parse(text: str) -> float:
        from uuvsim_cosim.models.declaration.units import seconds_of

        return seconds_of(str(text), option)

    return parse


def step_text(text: str, option: str) -> str:
    """Return a step in s as text; one without a unit stays as it is, ``1/50`` for example."""
    if "/" in text or not any(c.isalpha() for c in text.lower().replace("e", "")):
        return text
    from uuvsim_cosim.models.declaration.units import seconds_of

    return repr(seconds_of(text, option))


def assignments(
    option: str, texts: Iterable[str], expected: str, *, dotted: bool
) -> dict[str, str]:
    """Return {left: right} of texts ``left=right``; `dotted`: the left side must hold a dot."""
    found: dict[str, str] = {}
    for text in texts:
        left, equals, right = (part.strip() for part in text.partition("="))
        component, dot, rest = left.rpartition(".")
        if not equals or not left or not right or (dotted and not (component and dot and rest)):
            raise InputInvalid(f"{option} {text}: expected {expected}")
        if left in found:
            raise InputInvalid(f"{option} {text}", f"{left} is given twice", "once")
        found[left] = right
    return found


def rates(texts: Iterable[str]) -> dict[str, str]:
    """Return the communication steps [s] of ``component=step``; a step may carry a unit."""
    found = assignments("--rate", texts, "component=step, such as 0.02 or 20ms", dotted=False)
    return {name: step_text(text, f"--rate {name}") for name, text in found.items()}


def by_component(found: dict[str, str]) -> dict[str, dict[str, str]]:
    """Group {component.variable: value} by component; an index may stand behind the variable."""
    grouped: dict[str, dict[str, str]] = {}
    for left, right in found.items():
        component, _, variable = left.rpartition(".")
        grouped.setdefault(component, {})[variable] = right
    return grouped


def value_of(text: str) -> float | str:
    """Return a number if the text is one; else the text, e.g. ``2 km/h`` or ``true``."""
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text
