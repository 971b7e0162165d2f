"""Manual axes of a vehicle: the four values that a page sent last, and which page holds them.

One page pilots at a time. Its values hold for half a second: if the page is closed, hidden or
loses its connection, the axes become zero. After three seconds of silence another page may pilot.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from math import inf, isfinite
from time import monotonic
from typing import NamedTuple, final

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.errors import InputInvalid

__all__ = ["AXES", "ManualAxes", "SetPoint", "manual_axes_of", "pilots", "steer"]

AXES = ("surge", "sway", "heave", "yaw")  # of the body: ahead, to starboard, down, to starboard
LASTS = 0.5  # [s] for which the values of a page hold
HELD = 3.0  # [s] of silence after which another page may pilot

_FIELDS = ("page", "component", "axes", "release")  # of a page's request
_known: dict[str, ManualAxes] = {}


class SetPoint(NamedTuple):
    """The command of a client that computes the axes, such as a vehicle over MAVLink."""

    mode: float = -1.0  # number of its mode; -1: there is no such client, or it is disarmed
    pose: tuple[float, float, float, float] | None = None  # N E D [m], psi [rad]
    velocity: tuple[float, float, float, float] | None = None  # N E D [m/s], r [rad/s]


@final
class ManualAxes:
    """The axes of one component; any thread may set and read them."""

    def __init__(self, path: str, clock: Callable[[], float] = monotonic) -> None:
        self.path = path
        self._clock = clock
        self._lock = threading.Lock()
        self._page: str | None = None
        self._updated = -inf  # time of the last values
        self._axes = dict.fromkeys(AXES, 0.0)
        self._setpoint = SetPoint()

    def update(
        self, page: str, axes: Mapping[str, object], setpoint: SetPoint | None = None
    ) -> str | None:
        """Set the axes from a page, limited to [-1, 1]; return a message if another page controls.

        `setpoint` is the command from which a client has computed them.

        Raises InputInvalid for other names or values.
        """
        for name in axes:
            if name not in AXES:
                raise InputInvalid(f"axis {name!r}", f"some of {', '.join(AXES)}")
        fitted: dict[str, float] = {}
        for name in AXES:
            value = axes.get(name, 0.0)
            if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
                raise InputInvalid(name, f"{value!r}", "a number from -1 to 1")
            fitted[name] = max(-1.0, min(1.0, float(value)))
        with self._lock:
            now = self._clock()
            if self._page not in (None, page) and now - self._updated < HELD:
                return (
                    f"another page controls {self.path}; expected that page to release control, "
                    "or to be silent for "
                    f"{HELD:g} s"
                )
            self._page, self._updated, self._axes = page, now, fitted
            self._setpoint = setpoint or SetPoint()
            return None

    def release(self, page: str) -> None:
        """Release the axes, if this page pilots."""
        with self._lock:
            if self._page == page:
                self._page, self._updated = None, -inf

    def now(self) -> tuple[float, float, float, float]:
        """Return surge, sway, heave and yaw, each from -1 to 1; zeros if no values hold."""
        return self.commands()[0]

    def commands(self) -> tuple[tuple[float, float, float, float], SetPoint]:
        """Return the axes, and the set-point from which they were computed."""
        with self._lock:
            live = self._page is not None and self._clock() - self._updated < LASTS
            surge, sway, heave, yaw = (self._axes[name] if live else 0.0 for name in AXES)
            return (surge, sway, heave, yaw), self._setpoint if live else SetPoint()

    @property
    def is_held(self) -> bool:
        """Whether a page pilots."""
        with self._lock:
            return self._page is not None and self._clock() - self._updated < HELD


def manual_axes_of(path: str) -> ManualAxes:
    """Return the axes of a component of this process."""
    return _known.setdefault(path, ManualAxes(path))


def pilots(service: Service) -> dict[str, object]:
    """Return the components with manual axes, and whether a page holds them."""
    found = _axes_here(service)
    return {
        "pilots": [
            {"component": path, "held": manual_axes.is_held} for path, manual_axes in found.items()
        ],
        "axes": list(AXES),
    }


def steer(service: Service, client: Client, request: Mapping[str, object]) -> dict[str, object]:
    """Set the axes from a page's request; return whether it pilots, and the vehicle's state."""
    check(client, "set")
    for field in request:
        if field not in _FIELDS:
            raise InputInvalid("pilot", f"field {field!r}", f"some of {', '.join(_FIELDS)}")
    page, axes = request.get("page"), request.get("axes", {})
    if not isinstance(page, str) or not 4 <= len(page) <= 64:
        raise InputInvalid("pilot", "page", "a text of 4 to 64 letters that no other page has")
    if not isinstance(axes, dict):
        raise InputInvalid("pilot", f"axes {axes!r}", f"an object of {', '.join(AXES)}")
    found = _axes_here(service)
    component = request.get("component") or next(iter(found), None)
    if not isinstance(component, str) or component not in found:
        raise InputInvalid(
            f"pilot: component {component!r} has no manual control; expected one of "
            f"{', '.join(found)}"
            if found
            else "pilot: no component has manual control; expected `uuvsim serve SYSTEM --replace "
            "pilot=keyboard`"
        )
    manual_axes = found[component]
    if request.get("release"):
        manual_axes.release(page)
        refused: str | None = "let go: the vehicle stops"
    else:
        refused = manual_axes.update(page, axes)
    moment = service.moment()
    seen: dict[str, list[float]] = {}
    if "read" in client.allowed:
        values = service.get(client, [f"{component}.eta", f"{component}.nu"])
        seen = {name: list(map(float, values[f"{component}.{name}"])) for name in ("eta", "nu")}
    return {
        "component": component,
        "pilots": refused is None,
        "words": refused or "",
        "time": moment.time,
        "running": moment.running,
        "seen": seen,
    }


def _axes_here(service: Service) -> dict[str, ManualAxes]:
    """Return the manual axes of the components of this service."""
    there = {c["path"] for c in service.describe().get("components", ()) if c["kind"] == "keyboard"}
    return {path: manual_axes for path, manual_axes in list(_known.items()) if path in there}
