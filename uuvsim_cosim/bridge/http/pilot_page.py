"""The page /pilot: keyboard and gamepad of a browser set the axes of a `keyboard` component."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.http.manual_axes import AXES, ManualAxes, known
from uuvsim_cosim.errors import InputInvalid

__all__ = ["pilot_page", "pilots", "steered"]

_FIELDS = ("page", "component", "axes", "release")


def pilot_page() -> str:
    """Return the page, one file of HTML that loads nothing else."""
    return Path(__file__).with_name("pilot.html").read_text(encoding="utf-8")


def pilots(service: Service) -> dict[str, object]:
    """Return the components with manual axes, and whether a page holds them."""
    found = _axes_here(service)
    return {
        "pilots": [
            {"component": path, "held": manual_axes.is_held} for path, manual_axes in found.items()
        ],
        "axes": list(AXES),
    }


def steered(service: Service, client: Client, request: Mapping[str, object]) -> dict[str, object]:
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
            f"pilot: component {component!r} takes no pilot; expected one of {', '.join(found)}"
            if found
            else "pilot: nothing here takes a pilot; expected `uuvsim serve SYSTEM --replace "
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
    return {path: manual_axes for path, manual_axes in known().items() if path in there}
