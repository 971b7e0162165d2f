"""Manual axes of a vehicle: the four values that a page sent last, and which page holds them.

One page pilots at a time. What it said counts for half a second: released, lost or hidden, it
pilots with zeros. After three seconds of silence another page may take over.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from time import monotonic
from typing import Any, final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["AXES", "ManualAxes", "known", "manual_axes_of"]

AXES = ("surge", "sway", "heave", "yaw")  # of the body: ahead, to starboard, down, to starboard
LASTS = 0.5  # [s] that what a page said counts
HELD = 3.0  # [s] of silence after which another page may pilot

_known: dict[str, ManualAxes] = {}


@final
class ManualAxes:
    """The axes of one component; any thread may set and read them."""

    def __init__(self, path: str, clock: Callable[[], float] = monotonic) -> None:
        self.path = path
        self._clock = clock
        self._lock = threading.Lock()
        self._page: str | None = None
        self._said = -math.inf
        self._axes = (0.0, 0.0, 0.0, 0.0)

    def say(self, page: str, axes: Mapping[str, Any]) -> str | None:
        """Take what a page says; gives why not, in words, if another one pilots."""
        fitted = _fitted(axes)
        with self._lock:
            now = self._clock()
            if self._page not in (None, page) and now - self._said < HELD:
                return (
                    f"another page pilots {self.path}; expected that it lets go, or is silent for "
                    f"{HELD:g} s"
                )
            self._page, self._said, self._axes = page, now, fitted
            return None

    def let_go(self, page: str) -> None:
        """Let go, if this page pilots."""
        with self._lock:
            if self._page == page:
                self._page, self._said, self._axes = None, -math.inf, (0.0, 0.0, 0.0, 0.0)

    def now(self) -> tuple[float, float, float, float]:
        """Return surge, sway, heave and yaw, each from -1 to 1; zeros if nobody said so lately."""
        with self._lock:
            live = self._page is not None and self._clock() - self._said < LASTS
            return self._axes if live else (0.0, 0.0, 0.0, 0.0)

    @property
    def is_held(self) -> bool:
        """Whether a page pilots."""
        with self._lock:
            return self._page is not None and self._clock() - self._said < HELD


def manual_axes_of(path: str) -> ManualAxes:
    """Return the axes of a component of this process."""
    return _known.setdefault(path, ManualAxes(path))


def known() -> Mapping[str, ManualAxes]:
    """Return the axes of this process by component."""
    return dict(_known)


def _fitted(axes: Mapping[str, Any]) -> tuple[float, float, float, float]:
    for name in axes:
        if name not in AXES:
            raise InputInvalid(f"axis {name!r}; expected some of {', '.join(AXES)}")
    read = []
    for name in AXES:
        value = axes.get(name, 0.0)
        number = isinstance(value, int | float) and not isinstance(value, bool)
        if not number or not math.isfinite(value):
            raise InputInvalid(f"{name}: {value!r}; expected a number from -1 to 1")
        read.append(max(-1.0, min(1.0, float(value))))
    return (read[0], read[1], read[2], read[3])
