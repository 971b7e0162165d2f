"""What users give to reset: seeds, start values, masks; refused in a sentence if wrong."""

from __future__ import annotations

from collections.abc import Mapping
from operator import index
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["base_seed", "mask_of", "start_of"]

_KNOWN = ("start", "reset_mask")


def base_seed(seed: Any) -> int:
    """Give a seed as a whole number; raises InputInvalid."""
    try:
        number = index(seed)
    except TypeError:
        number = -1
    if number < 0 or isinstance(seed, bool | np.bool_):
        raise InputInvalid(f"seed {seed!r}; expected a whole number from 0, or None")
    return number


def start_of(options: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Give the start values of reset's options; raises InputInvalid for unknown options."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise InputInvalid(f"options {options!r}; expected a dictionary")
    start = options.get("start") or {}
    if not isinstance(start, Mapping):
        raise InputInvalid(f"options, start: {start!r}; expected start values by name")
    return start


def mask_of(options: Mapping[str, Any] | None, n: int) -> NDArray[np.bool_] | None:
    """Give the environments to reset, from reset's options; None is all."""
    mask = None if options is None else options.get("reset_mask")
    if mask is None:
        return None
    chosen = np.asarray(mask)
    if chosen.dtype != bool or chosen.shape != (n,) or not chosen.any():
        raise InputInvalid(
            f"options, reset_mask: {chosen.dtype} of shape {chosen.shape}; expected {n} "
            "Booleans, at least one of them true"
        )
    return chosen.copy()
