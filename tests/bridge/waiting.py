"""Waiting for a condition, however long a loaded machine needs until it holds."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE = 120.0  # [s] after which an event counts as missing; it normally comes at once
_LOOK = 0.005  # [s] between two looks


def until(holds: Callable[[], object], meanwhile: Callable[[], object] = lambda: None) -> None:
    """Wait until a condition holds; between two looks, do something."""
    latest = time.monotonic() + PATIENCE
    while not holds():
        assert time.monotonic() < latest, "the condition did not hold"
        meanwhile()
        time.sleep(_LOOK)
