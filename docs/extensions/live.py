"""Sphinx extension: the directives ``live-component`` and ``live-vehicle`` compute in the browser.

    ```{live-component} thruster
    ```

    ```{live-vehicle} bluerov2_hold
    ```

A page has no resource of another server, and works from the disk. The files are written into
`_static/live` when the pages have been built.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

sys.path.insert(0, str(Path(__file__).parent))

from docutils import nodes
from live_components import live_of, script, style
from live_vehicles import place, vehicle_file, vehicle_script
from sphinx.util.docutils import SphinxDirective

if TYPE_CHECKING:
    from sphinx.application import Sphinx

FOLDER = "live"  # below _static


class LiveComponent(SphinxDirective):
    """The response of a component to its stimulus, with sliders of its parameters."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the place that the script fills, or the reason why it cannot."""
        (name,) = self.arguments
        live = live_of(name)
        if live.reason:
            text = f"This component does not run in a browser: {live.reason}."
            return [nodes.paragraph("", text)]
        self.env.metadata[self.env.docname]["live"] = name
        parsed, _ = self.parse_inline(live.text)
        place = (
            f'<div class="live" data-live="{name}"><noscript>The live response needs JavaScript.'
            "</noscript></div>"
        )
        return [nodes.paragraph("", "", *parsed), nodes.raw("", place, format="html")]


class LiveVehicle(SphinxDirective):
    """The live page of a shipped system, which a button starts."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Return the picture with the button."""
        (name,) = self.arguments
        self.env.metadata[self.env.docname]["live-vehicle"] = name
        return [nodes.raw("", place(name), format="html")]


def add_files(
    app: Sphinx, pagename: str, _template: str, _context: dict[str, Any], _doctree: Any
) -> None:
    """Add script and data to a page that has a live response."""
    about = app.env.metadata.get(pagename, {})
    if "live" in about or "live-vehicle" in about:
        app.add_css_file(f"{FOLDER}/live.css")
    if "live-vehicle" in about:
        app.add_js_file(f"{FOLDER}/live_vehicle.js", loading_method="defer")
    if name := about.get("live"):
        app.add_js_file(f"{FOLDER}/live.js", loading_method="defer")
        app.add_js_file(f"{FOLDER}/{name}.js", loading_method="defer")


def write_files(app: Sphinx, error: Exception | None) -> None:
    """Write the scripts and the data of all pages that have a live response."""
    if error is not None or app.builder.format != "html":
        return
    folder = Path(app.outdir) / "_static" / FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    texts = {"live.js": script(), "live.css": style(), "live_vehicle.js": vehicle_script()}
    for about in app.env.metadata.values():
        if name := about.get("live-vehicle"):
            texts[f"{name}.js"] = vehicle_file(name)
        if "live" in about:
            texts[f"{about['live']}.js"] = live_of(about["live"]).file
    for file, text in texts.items():
        (folder / file).write_text(text, encoding="utf-8")


def setup(app: Sphinx) -> dict[str, Any]:
    """Connect to Sphinx."""
    app.add_directive("live-component", LiveComponent)
    app.add_directive("live-vehicle", LiveVehicle)
    app.connect("html-page-context", add_files)
    app.connect("build-finished", write_files)
    return {"parallel_read_safe": True, "version": "1"}
