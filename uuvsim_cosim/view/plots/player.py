"""An episode as one HTML file: its pictures, a button and a slider; opens offline."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.view.plots.page import page_html
from uuvsim_cosim.view.plots.png import png
from uuvsim_cosim.view.plots.svg import escape

__all__ = ["player_html"]

SCRIPT = """
const f=[...document.querySelectorAll('#film img')],s=document.getElementById('at'),
b=document.getElementById('go');let k=0,t=null;
function show(i){f[k].hidden=true;k=i;f[k].hidden=false;s.value=k}
function stop(){clearInterval(t);t=null;b.textContent='play'}
b.onclick=()=>{if(t){stop();return}if(k===f.length-1)show(0);b.textContent='pause';
t=setInterval(()=>{k+1<f.length?show(k+1):stop()},PERIOD)};
s.oninput=()=>{stop();show(+s.value)};show(0);b.click();
"""


def player_html(
    title: str,
    subtitle: str,
    frames: Sequence[NDArray[np.uint8]],
    seconds: float,
    figures: Mapping[str, str],
) -> str:
    """Return the page; `seconds` lie between two pictures, `figures` are its results."""
    images = "".join(
        f'<img hidden alt="" src="data:image/png;base64,{base64.b64encode(png(x)).decode()}">'
        for x in frames
    )
    tiles = "".join(
        f'<div class="figure"><span>{escape(k)}</span><b>{escape(v)}</b></div>'
        for k, v in figures.items()
    )
    style = "#film img{width:100%;max-width:640px;display:block}#film img[hidden]{display:none}"
    script = SCRIPT.replace("PERIOD", f"{1000 * seconds:g}")
    body = [
        f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></header>",
        f'<div class="figures">{tiles}</div><div class="card"><div id="film">{images}</div>',
        '<p><button id="go" type="button">play</button> <input id="at" type="range" min="0" '
        f'max="{len(frames) - 1}" value="0" aria-label="frame" style="width:60%"></p></div>',
    ]
    return page_html(title, "uuvsim", body, style=style, scripts=f"<script>{script}</script>")
