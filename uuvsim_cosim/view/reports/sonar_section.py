"""Images of the run's sonars in a report: a picture with a slider, or a waterfall."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.view.plots.png import Pixels, png
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.sonar.pictures import levels_of, pictures
from uuvsim_cosim.view.sonar.recorded import all_scans
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = ["sonar_section"]

FRAMES = 16  # pictures of a sonar in the page
SIZE = 360  # pixels of an image
STEP = 8  # of a colour's 256 levels, so that pictures stay small
SCRIPT = """<script>for(const card of document.querySelectorAll('.sonar')){
const frames=[...card.querySelectorAll('img')],slider=card.querySelector('input');
if(slider)slider.oninput=()=>frames.forEach((x,k)=>x.hidden=k!==+slider.value)}</script>"""


def sonar_section(run: Path, traces: Traces) -> str:
    """Return the section of a report; "" for a run without images of a sonar."""
    if not any(name.endswith(".magnitude") for name in traces.values):
        return ""
    try:
        cards = "".join(_card(scans) for scans in all_scans(run))
    except UuvsimError as error:
        cards = f'<div class="card"><p>No picture: {escape(str(error))}</p></div>'
    if not cards:
        return ""
    return f'<section><h2>Sonar</h2><div class="grid2">{cards}</div></section>{SCRIPT}'


def _card(scans: SonarScans) -> str:
    levels = levels_of(scans)
    if scans.is_side_scan:
        drawn = list(pictures(scans, "waterfall", levels, SIZE))
    else:
        picks = np.unique(np.linspace(0, len(scans) - 1, FRAMES).round().astype(int))
        drawn = list(_fans(scans, picks.tolist()))
    images = "".join(
        f'<img {"hidden " if k else ""}alt="{escape(scans.name)}" style="max-width:100%" '
        f'src="data:image/png;base64,{base64.b64encode(png(_coarse(each))).decode("ascii")}">'
        for k, each in enumerate(drawn)
    )
    slider = (
        f'<input type="range" min="0" max="{len(drawn) - 1}" value="0" style="width:100%" '
        f'aria-label="ping of {escape(scans.name)}">'
        if len(drawn) > 1
        else ""
    )
    words = f"{len(scans)} images; {levels.words(scans.unit)}"
    return (
        f'<div class="card sonar"><h3>{escape(scans.name)}<span class="keys">{escape(words)}</span>'
        f"</h3>{images}{slider}</div>"
    )


def _fans(scans: SonarScans, picks: list[int]) -> Iterator[Pixels]:
    levels = levels_of(scans)
    for k in picks:
        yield next(pictures(scans.at(float(scans.time[k])), "fan", levels, SIZE))


def _coarse(pixels: Pixels) -> Pixels:
    return np.asarray(pixels // STEP * STEP, np.uint8)
