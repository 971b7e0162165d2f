"""Manual axes of a vehicle: the four values that a page sent last, and which page holds them.

One page pilots at a time. Its values hold for half a second: if the page is closed, hidden or
loses its connection, the axes become zero. After three seconds of silence another page may pilot.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from math import inf, isfinite
from time import monotonic
from typing import final

from uuvsim_cosim.errors import InputInvalid

__all__ = ["AXES", "ManualAxes", "known", "manual_axes_of"]

AXES = ("surge", "sway", "heave", "yaw")  # of the body: ahead, to starboard, down, to starboard
LASTS = 0.5  # [s] for which the values of a page hold
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
        self._updated = -inf  # time of the last values
        self._axes = (0.0, 0.0, 0.0, 0.0)

    def update(self, page: str, axes: Mapping[str, object]) -> str | None:
        """Set the axes from a page; return the reason as a message if another page pilots."""
        fitted = _fitted(axes)
        with self._lock:
            now = self._clock()
            if self._page not in (None, page) and now - self._updated < HELD:
                return (
                    f"another page pilots {self.path}; expected that it lets go, or is silent for "
                    f"{HELD:g} s"
                )
            self._page, self._updated, self._axes = page, now, fitted
            return None

    def release(self, page: str) -> None:
        """Release the axes, if this page pilots."""
        with self._lock:
            if self._page == page:
                self._page, self._updated, self._axes = None, -inf, (0.0, 0.0, 0.0, 0.0)

    def now(self) -> tuple[float, float, float, float]:
        """Return surge, sway, heave and yaw, each from -1 to 1; zeros if no values hold."""
        with self._lock:
            live = self._page is not None and self._clock() - self._updated < LASTS
            return self._axes if live else (0.0, 0.0, 0.0, 0.0)

    @property
    def is_held(self) -> bool:
        """Whether a page pilots."""
        with self._lock:
            return self._page is not None and self._clock() - self._updated < HELD


def manual_axes_of(path: str) -> ManualAxes:
    """Return the axes of a component of this process."""
    return _known.setdefault(path, ManualAxes(path))


def known() -> Mapping[str, ManualAxes]:
    """Return the axes of this process by component."""
    return dict(_known)


def _fitted(axes: Mapping[str, object]) -> tuple[float, float, float, float]:
    """Return the axes, limited to [-1, 1]; raises InputInvalid for other names or values."""
    for name in axes:
        if name not in AXES:
            raise InputInvalid(f"axis {name!r}", f"some of {', '.join(AXES)}")
    read = []
    for name in AXES:
        value = axes.get(name, 0.0)
        if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
            raise InputInvalid(name, f"{value!r}", "a number from -1 to 1")
        read.append(max(-1.0, min(1.0, float(value))))
    return (read[0], read[1], read[2], read[3])
