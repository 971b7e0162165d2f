"""The page /pilot: keyboard and gamepad of a browser become the hands of a `keyboard` component."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.bridge.desk import Client, Desk
from uuvsim_cosim.bridge.hands import AXES, Hands, known
from uuvsim_cosim.bridge.roles import check
from uuvsim_cosim.errors import InputInvalid

__all__ = ["pilot_page", "pilots", "steered"]

_FIELDS = ("page", "component", "axes", "release")


def pilot_page() -> str:
    """Give the page, one file of HTML that loads nothing else."""
    return Path(__file__).with_name("pilot.html").read_text(encoding="utf-8")


def pilots(desk: Desk) -> dict[str, Any]:
    """Give the components that take hands, and whether somebody holds them."""
    found = _here(desk)
    return {
        "pilots": [{"component": path, "held": hands.is_held} for path, hands in found.items()],
        "axes": list(AXES),
    }


def steered(desk: Desk, client: Client, said: Mapping[str, Any]) -> dict[str, Any]:
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
    found = _here(desk)
    component = said.get("component") or next(iter(found), None)
    if component not in found:
        raise InputInvalid(
            f"pilot: component {component!r} takes no hands; expected one of {', '.join(found)}"
            if found
            else "pilot: nothing here takes hands; expected `uuvsim serve SYSTEM --replace "
            "pilot=keyboard`"
        )
    hands = found[component]
    if said.get("release"):
        hands.let_go(page)
        refused: str | None = "let go: the vehicle stops"
    else:
        refused = hands.say(page, axes)
    moment = desk.moment()
    return {
        "component": component,
        "pilots": refused is None,
        "words": refused or "",
        "time": moment.time,
        "running": moment.running,
        "seen": _seen(desk, client, component),
    }


def _here(desk: Desk) -> dict[str, Hands]:
    there = {c["path"] for c in desk.describe().get("components", ()) if c["kind"] == "keyboard"}
    return {path: hands for path, hands in known().items() if path in there}


def _seen(desk: Desk, client: Client, component: str) -> dict[str, Any]:
    """Give what the component sees of the vehicle, if the client may read it."""
    if "read" not in client.allowed:
        return {}
    names = [f"{component}.eta", f"{component}.nu"]
    values = desk.get(client, names)
    return {name.rpartition(".")[2]: list(map(float, values[name])) for name in names}
