"""Section of a run's report: run again from an instant on, on the page beside the report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uuvsim_cosim.view.live_page.run_page import preventing
from uuvsim_cosim.view.plots.svg import escape

__all__ = ["again_html"]


def again_html(folder: Path, provenance: Mapping[str, Any], page: Path) -> str:
    """Return the section: a link to the page, how to write the page, or what prevents it."""
    problems = preventing(folder, provenance)
    if problems:
        items = "".join(f"<li>{escape(str(p))}</li>" for p in problems)
        inside = f"<p>No page can repeat this run, because of:</p><ul>{items}</ul>"
    elif page.is_file():
        tick, end = float(provenance["tick"]), float(provenance["time"])
        inside = (
            '<p class="again">from t = <input id="again-time" type="number" '
            f'data-tick="{tick!r}" min="0" max="{end:g}" step="any" value="0" '
            'aria-label="time in s"> s <a id="again-link" '
            f'href="{escape(page.name)}">open the page at this time</a></p>'
            "<p>The page repeats the run up to this time with the same bits. There you can change "
            "parameters, waypoints and faults, and let the run go on. A click on a plot or on the "
            "track sets the time.</p>"
        )
    else:
        inside = (
            f"<p><code>uuvsim report {escape(folder.name)} --page</code> writes {page.name} beside "
            "this report. On it the run goes on in a browser from any time, with other "
            "parameters.</p>"
        )
    return f'<div class="card" id="again"><h3>Run again from here</h3>{inside}</div>'
