"""The page /pilot: keyboard and gamepad of a browser set the axes of a `keyboard` component."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.bridge.access.roles import check
from uuvsim_cosim.bridge.calls.service import Client, Service
from uuvsim_cosim.bridge.http.manual_axes import AXES, ManualAxes, known
from uuvsim_cosim.errors import InputInvalid

__all__ = ["pilot_page", "pilots", "steered"]

_FIELDS = ("page", "component", "axes", "release")


def pilot_page() -> str:
    """Return the page, one file of HTML that loads nothing else."""
    return Path(__file__).with_name("pilot.html").read_text(encoding="utf-8")


def pilots(service: Service) -> dict[str, Any]:
    """Return the components that take manual axes, and whether somebody holds them."""
    found = _here(service)
    return {
        "pilots": [
            {"component": path, "held": manual_axes.is_held} for path, manual_axes in found.items()
        ],
        "axes": list(AXES),
    }


def steered(service: Service, client: Client, said: Mapping[str, Any]) -> dict[str, Any]:
    """Take what a page says of its axes; gives whether it pilots, and where the vehicle is."""
    check(client, "set")
    for field in said:
        if field not in _FIELDS:
            raise InputInvalid(f"pilot: field {field!r}; expected some of {', '.join(_FIELDS)}")
    page, axes = said.get("page"), said.get("axes", {})
    if not isinstance(page, str) or not 4 <= len(page) <= 64:
        raise InputInvalid("pilot: page; expected a text of 4 to 64 letters that no other page has")
    if not isinstance(axes, dict):
        raise InputInvalid(f"pilot: axes {axes!r}; expected an object of {', '.join(AXES)}")
    found = _here(service)
    component = said.get("component") or next(iter(found), None)
    if component not in found:
        raise InputInvalid(
            f"pilot: component {component!r} takes no pilot; expected one of {', '.join(found)}"
            if found
            else "pilot: nothing here takes a pilot; expected `uuvsim serve SYSTEM --replace "
            "pilot=keyboard`"
        )
    manual_axes = found[component]
    if said.get("release"):
        manual_axes.let_go(page)
        refused: str | None = "let go: the vehicle stops"
    else:
        refused = manual_axes.say(page, axes)
    moment = service.moment()
    return {
        "component": component,
        "pilots": refused is None,
        "words": refused or "",
        "time": moment.time,
        "running": moment.running,
        "seen": _seen(service, client, component),
    }


def _here(service: Service) -> dict[str, ManualAxes]:
    there = {c["path"] for c in service.describe().get("components", ()) if c["kind"] == "keyboard"}
    return {path: manual_axes for path, manual_axes in known().items() if path in there}


def _seen(service: Service, client: Client, component: str) -> dict[str, Any]:
    """Return what the component sees of the vehicle, if the client may read it."""
    if "read" not in client.allowed:
        return {}
    names = [f"{component}.eta", f"{component}.nu"]
    values = service.get(client, names)
    return {name.rpartition(".")[2]: list(map(float, values[name])) for name in names}
