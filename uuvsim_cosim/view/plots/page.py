"""Pages and pictures: colours, marks of lines, legend entries, and the HTML around a body.

The colours are light and dark, and distinct for colour-blind readers as well.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.view.plots.svg import escape

__all__ = ["MARKS", "encoded", "key_html", "own_file", "page_html", "picture_styles"]

LIGHT = {
    "page": "#f4f6f9", "card": "#ffffff", "line": "#e1e6ed", "ink": "#13202f", "muted": "#5d6b7c",
    "grid": "#e9edf2", "axis": "#aab4c0", "truth": "#1268b3", "estimate": "#e2622a",
    "desired": "#7d8a9a", "third": "#12907f", "fourth": "#8257c5", "fifth": "#a8780c",
    "sixth": "#c23b72", "seventh": "#4f7a28", "band": "#f6d9c8",
    "extreme": "#cfdcea", "water": "#dbe8f0",
}  # fmt: skip
DARK = {
    "page": "#0c131c", "card": "#131d29", "line": "#233143", "ink": "#e3eaf2", "muted": "#93a3b5",
    "grid": "#1d2937", "axis": "#4a5a6c", "truth": "#58aef0", "estimate": "#ff8d57",
    "desired": "#8d9bad", "third": "#3fcab4", "fourth": "#b394f0", "fifth": "#e0b444",
    "sixth": "#f283ab", "seventh": "#9ccc6a", "band": "#47301f",
    "extreme": "#263a50", "water": "#0f1f2e",
}  # fmt: skip


# Marks of lines by style, as SVG paths around (0, 0): lines are told apart without colour as well.
MARKS = {
    "truth": "M-3.3 0a3.3 3.3 0 1 0 6.6 0a3.3 3.3 0 1 0 -6.6 0Z",
    "estimate": "M-3 -3H3V3H-3Z",
    "third": "M0 -4L4 3.2H-4Z",
    "fourth": "M0 -4.4L4.4 0L0 4.4L-4.4 0Z",
    "fifth": "M-3 -3L3 3M-3 3L3 -3",
    "sixth": "M0 -4V4M-4 0H4",
    "seventh": "M0 4L4 -3.2H-4Z",
    "desired": "M0 -4.5V4.5",
}


def own_file(name: str) -> str:
    """Return the text of a file beside this module."""
    return files("uuvsim_cosim.view.plots").joinpath(name).read_text(encoding="utf-8")


def encoded(data: NDArray[np.generic]) -> str:
    """Return the bytes of an array as base64, for a page's script."""
    return base64.b64encode(np.ascontiguousarray(data).tobytes()).decode("ascii")


def page_html(
    title: str, kind: str, body: Sequence[str], *, style: str = "", scripts: str = ""
) -> str:
    """Return a page that opens offline; `kind` follows the title in the browser's tab.

    Its colours follow the reader's setting, or the attribute `data-theme` of its root.
    """
    light, dark = (";".join(f"--{k}:{v}" for k, v in colours.items()) for colours in (LIGHT, DARK))
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width,initial-scale=1">'
        f"<title>{escape(title)} · {escape(kind)}</title>\n<style>:root{{{light}}}\n"
        f"@media(prefers-color-scheme:dark){{:root:not([data-theme=light]){{{dark}}}}}\n"
        f":root[data-theme=dark]{{{dark}}}\n{own_file('report.css')}{own_file('plots.css')}{style}"
        f"</style></head>\n<body><main>{''.join(body)}</main>{scripts}</body></html>\n"
    )


def key_html(
    style: str, label: str, *, line: str = "M0 5H22", dashed: bool = False, mark: str | None = None
) -> str:
    """Return an entry of a legend: its line with the mark of its style, and its label."""
    mark = MARKS.get(style, "") if mark is None else mark
    shape = f'<path class="{style} marker" d="{mark}" transform="translate(11 5)"/>' if mark else ""
    dash = " dash" if dashed else ""
    return (
        f'<span class="key"><svg viewBox="0 0 22 10"><path class="line {style}{dash}" d="{line}"/>'
        f"{shape}</svg>{escape(label)}</span>"
    )


def picture_styles() -> str:
    """Return the styles of a free-standing SVG, without variables, which not every viewer knows."""
    css = re.sub(r"[{}]", r"\g<0>\g<0>", own_file("plots.css"))  # literal braces for `format`
    css = re.sub(r"var\(--(\w+)\)", r"{\1}", css)
    css += ".page{{fill:{page}}}.card{{fill:{card};stroke:{line}}}.ink{{fill:{ink}}}"
    return f"{css.format(**LIGHT)}\n@media(prefers-color-scheme:dark){{{css.format(**DARK)}}}"
