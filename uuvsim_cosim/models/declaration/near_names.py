"""The end of a message about a name that does not exist: names close to it, else those that do."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches

__all__ = ["close_names", "did_you_mean", "expected_names"]

_LONGEST = 80  # characters that are compared: the time grows with the product of both lengths
_MOST = 20  # names that are listed


def close_names(name: object, known: Iterable[object], cutoff: float = 0.6) -> list[str]:
    """Return at most three names that are close to a wrong one, the closest first."""
    return get_close_matches(str(name)[:_LONGEST], [str(k) for k in known], n=3, cutoff=cutoff)


def expected_names(name: object, known: Iterable[object], what: str = "") -> str:
    """Return what is expected in a name's place: close names, else those that there are.

    `what` says what a name stands for: "the name of a component".
    """
    names = [str(k) for k in known]
    if not names:
        return f"{what or 'a name'}, but there is none"
    if close := close_names(name, names):
        return f"{what or 'one'} such as {', '.join(close)}"
    listed = ", ".join(names[:_MOST]) + (", …" if len(names) > _MOST else "")
    return f"{what}, one of {listed}" if what else f"one of {listed}"


def did_you_mean(name: object, known: Iterable[object]) -> str:
    """Return the names close to a wrong one: " (did you mean a or b?)"; "" if there is none."""
    close = close_names(name, known)
    return f" (did you mean {' or '.join(close)}?)" if close else ""
