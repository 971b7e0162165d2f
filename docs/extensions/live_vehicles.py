"""A live vehicle on a page of the documentation: the page of a system, which a button loads."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import uuvsim_cosim as uuv
from uuvsim_cosim.view.live_page.live_page import live_page_html

__all__ = ["place", "vehicle_file", "vehicle_script"]

# A BlueROV2 from above, with its four horizontal thrusters.
_PICTURE = (
    '<svg viewBox="-60 -40 120 80" role="img" aria-label="a vehicle from above">'
    '<rect x="-38" y="-26" width="76" height="52" rx="8" fill="#e0a92e" stroke="#13202f"/>'
    '<g fill="none" stroke="#13202f" stroke-width="3">'
    '<circle cx="-34" cy="-24" r="9"/><circle cx="34" cy="-24" r="9"/>'
    '<circle cx="-34" cy="24" r="9"/><circle cx="34" cy="24" r="9"/></g>'
    '<path d="M16 -8L28 0L16 8" fill="none" stroke="#13202f" stroke-width="3"/></svg>'
)


@cache
def vehicle_file(name: str) -> str:
    """Return the script that hands over the page of a shipped system."""
    html = json.dumps(live_page_html(uuv.load(name))).replace("</", "<\\/")
    return f"uuvsimVehicle({json.dumps(name)},{html});\n"


def vehicle_script() -> str:
    """Return the script of pages with a live vehicle."""
    own = Path(__file__).parent / "live_files" / "live_vehicle.js"
    return own.read_text("utf-8")


def place(name: str) -> str:
    """Return the HTML of a live vehicle before it is started."""
    size = len(vehicle_file(name).encode()) / 1000
    return (
        f'<div class="live-vehicle" data-vehicle="{name}"><div class="live-poster">{_PICTURE}'
        f'<button type="button">Fly a vehicle on this page</button></div>'
        f'<p role="status">The button loads {size:.0f} kB of this site; nothing is installed.</p>'
        "<noscript>The live vehicle needs JavaScript.</noscript></div>"
    )
