"""Plots beside the scene: one signal over time as SVG, with a cursor at the moment shown."""

from __future__ import annotations

import base64

import numpy as np

from uuvsim_cosim.view.plots.page import picture_styles
from uuvsim_cosim.view.plots.plots import Frame, Line, TimePanel
from uuvsim_cosim.view.recorded.traces import Traces

__all__ = ["PLOTTED", "plot_markdown", "plotted"]

PLOTTED = ("hull.eta", "hull.nu", "dvl.altitude", "battery.voltage", "wrench.tau")
STYLES = ("truth", "estimate", "third", "fourth", "desired", "truth")
SAMPLES = 400


def plotted(traces: Traces) -> list[str]:
    """List the signals that can be plotted, those of most interest first."""
    names = [n for n, v in traces.values.items() if v.ndim == 1 or v.shape[1] <= 12]
    first = [n for wanted in PLOTTED for n in names if n == wanted or n.endswith("." + wanted)]
    return list(dict.fromkeys([*first, *sorted(names)]))


def plot_markdown(traces: Traces, name: str, t: float | None = None, *, dark: bool = False) -> str:
    """Return a plot of a signal as Markdown: an image that holds its SVG."""
    value = traces.values[name]
    picks = np.unique(np.linspace(0, len(traces.time) - 1, SAMPLES).astype(int))
    columns = value.reshape(len(value), -1)[picks].astype(float)
    time = traces.time[picks]
    lines = [
        Line(str(i + 1), columns[:, i], STYLES[i % len(STYLES)], 3) for i in range(columns.shape[1])
    ]
    frame = Frame(width=360, height=170)
    inside = TimePanel(name, traces.units.get(name, ""), lines).draw(time, frame)
    if t is not None and len(time) > 1:
        share = (t - time[0]) / (time[-1] - time[0])
        x = frame.left + share * (frame.width - frame.left - frame.right)
        inside += (
            f'<path d="M{x:.1f} {frame.top:g}V{frame.height - frame.bottom:g}" stroke="#e5484d"/>'
        )
    style = picture_styles().partition("@media")[0]
    svg = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {frame.width:g} {frame.height:g}" '
        f'width="{2 * frame.width:g}" height="{2 * frame.height:g}"><style>{style}</style>'
        f'<rect width="100%" height="100%" fill="#fff"/>{inside}</svg>'
    )
    encoded = base64.b64encode(svg.encode()).decode()
    unit = traces.units.get(name, "") or "1"
    return f"**{_plain(name)}** in {_plain(unit)}\n\n![plot](data:image/svg+xml;base64,{encoded})"


def _plain(text: str) -> str:
    """Return a name that Markdown does not interpret."""
    return f"`{text}`" if "`" not in text else text.replace("`", "")
