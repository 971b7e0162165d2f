"""Colours of plots and pages, light and dark, distinct for colour-blind readers as well."""

from __future__ import annotations

import re
from importlib.resources import files

__all__ = ["page_styles", "picture_styles"]

LIGHT = {
    "page": "#f4f6f9", "card": "#ffffff", "line": "#e1e6ed", "ink": "#13202f", "muted": "#5d6b7c",
    "grid": "#e9edf2", "axis": "#aab4c0", "truth": "#1268b3", "estimate": "#e2622a",
    "desired": "#7d8a9a", "third": "#12907f", "fourth": "#8257c5", "band": "#f6d9c8",
    "extreme": "#cfdcea", "water": "#dbe8f0",
}  # fmt: skip
DARK = {
    "page": "#0c131c", "card": "#131d29", "line": "#233143", "ink": "#e3eaf2", "muted": "#93a3b5",
    "grid": "#1d2937", "axis": "#4a5a6c", "truth": "#58aef0", "estimate": "#ff8d57",
    "desired": "#8d9bad", "third": "#3fcab4", "fourth": "#b394f0", "band": "#47301f",
    "extreme": "#263a50", "water": "#0f1f2e",
}  # fmt: skip


def _variables(colours: dict[str, str]) -> str:
    return ";".join(f"--{name}:{colour}" for name, colour in colours.items())


def _own(name: str) -> str:
    return files("uuvsim_cosim.view.plots").joinpath(name).read_text(encoding="utf-8")


def page_styles() -> str:
    """Return the style sheet of a page; its colours follow the reader's setting or the button."""
    return (
        f":root{{{_variables(LIGHT)}}}\n"
        f"@media(prefers-color-scheme:dark){{:root:not([data-theme=light]){{{_variables(DARK)}}}}}\n"
        f":root[data-theme=dark]{{{_variables(DARK)}}}\n" + _own("report.css") + _own("plots.css")
    )


def picture_styles() -> str:
    """Return the styles of a free-standing SVG, without variables, which not every viewer knows."""
    light, dark = (_resolved(_own("plots.css"), colours) for colours in (LIGHT, DARK))
    page = ".page{{fill:{page}}}.card{{fill:{card};stroke:{line}}}.ink{{fill:{ink}}}"
    light += page.format(**LIGHT)
    dark += page.format(**DARK)
    return f"{light}\n@media(prefers-color-scheme:dark){{{dark}}}"


def _resolved(css: str, colours: dict[str, str]) -> str:
    return re.sub(r"var\(--(\w+)\)", lambda match: colours[match[1]], css)
