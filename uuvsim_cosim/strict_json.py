"""Conversion to strict JSON: no NaN, no infinity; plain numbers, texts, lists and objects."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

__all__ = ["Shown", "strict"]


@dataclass(frozen=True)
class Shown:
    """A value for JSON, and the text that is shown to people instead."""

    value: object
    text: str

    def __str__(self) -> str:
        """Return the text."""
        return self.text


def strict(value: object, place: str = "") -> tuple[Any, dict[str, str]]:
    """Return a value as JSON holds it, and the places of the numbers that JSON cannot hold.

    NaN and infinities become null; paths, dates and the like become text.
    """
    replaced: dict[str, str] = {}

    def plain(item: object, at: str) -> object:
        if item is None or isinstance(item, bool | int | str):
            return item
        if isinstance(item, Shown):
            return plain(item.value, at)
        if isinstance(item, float):
            if math.isfinite(item):
                return float(item)
            replaced[at] = repr(float(item))
            return None
        if isinstance(item, Mapping):
            return {str(k): plain(v, f"{at}.{k}" if at else str(k)) for k, v in item.items()}
        if isinstance(item, list | tuple | set | frozenset):
            return [plain(v, f"{at}[{n}]") for n, v in enumerate(item)]
        if hasattr(item, "tolist"):  # numpy's arrays and scalars
            return plain(item.tolist(), at)
        return str(item)

    return plain(value, place), replaced
