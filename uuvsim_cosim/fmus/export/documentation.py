"""Documentation in an exported component: its table of variables, and CSV of a run."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from uuvsim_cosim.fmus.description import Description, Variable

__all__ = ["Row", "csv_text", "index_html", "variables_markdown"]

Row = Mapping[str, float | np.ndarray]  # values by name; `time` is the time [s]
_COLUMNS = ("name", "type", "causality", "variability", "unit", "start", "min", "max", "meaning")


def csv_text(variables: Sequence[Variable], rows: Iterable[Row]) -> str:
    """Return CSV with a column for the time and one for each element, with all digits."""
    names = ["time", *(name for v in variables for name in v.element_names)]
    lines = [",".join(f'"{n}"' if "," in n else n for n in names)]
    for row in rows:
        values = [row["time"], *(x for v in variables for x in np.ravel(row[v.name]).tolist())]
        lines.append(",".join(repr(v + 0) for v in values))
    return "\n".join(lines) + "\n"


def variables_markdown(description: Description) -> str:
    """Return the table of variables as Markdown."""
    lines = [f"# {description.name}", ""]
    if description.description:
        lines += [" ".join(description.description.split()), ""]
    lines += ["| " + " | ".join(_COLUMNS) + " |", "|" + " --- |" * len(_COLUMNS)]
    for v in description.variables.values():
        cells = [c.replace("|", "\\|") for c in _cells(v)]
        lines.append("| " + " | ".join([f"`{cells[0]}`", *cells[1:]]) + " |")
    return "\n".join(lines) + "\n"


def index_html(description: Description) -> str:
    """Return the page that FMI tools show as a component's documentation."""
    head = "".join(f"<th>{c}</th>" for c in _COLUMNS)
    rows = "\n".join(
        "<tr>" + "".join(f"<td>{html.escape(c)}</td>" for c in _cells(v)) + "</tr>"
        for v in description.variables.values()
    )
    name = html.escape(description.name)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{name}</title>
<style>
body {{ font: 15px/1.5 sans-serif; max-width: 70em; margin: 2em auto; padding: 0 1em }}
td, th {{ text-align: left; padding: .2em .6em; border-bottom: 1px solid #ddd }}
pre {{ white-space: pre-wrap }}
</style>
</head>
<body>
<h1>{name}</h1>
<pre>{html.escape(description.description.strip())}</pre>
<p>Over one communication step the inputs are held; continuous states follow their equations by
the classical Runge-Kutta method in equal sub-steps, cut at the sample instants of the clocks;
outputs hold at the end of the step. Random numbers depend on the parameter <code>seed</code> and
on the sample's number alone.</p>
<table>
<tr>{head}</tr>
{rows}
</table>
<p><a href="input.csv">input.csv</a> holds the inputs of the default experiment, one row for each
communication step, and <a href="reference.csv">reference.csv</a> the outputs that result.
Licences: <a href="licenses/license.txt">of the component</a>,
<a href="licenses/fmi_headers.txt">of FMI's headers</a>.</p>
</body>
</html>
"""


def _cells(v: Variable) -> list[str]:
    """Return a variable's cells of the table; a start with equal elements is one number."""
    shape = f"[{', '.join(map(str, v.shape))}]" if v.shape else ""
    flat = [] if v.start is None else np.ravel(v.start).tolist()
    if len(set(flat)) == 1:
        start = f"{flat[0]:g}" if not isinstance(flat[0], bool) else str(flat[0]).lower()
    else:
        start = ", ".join(f"{x:g}" for x in flat)
    return [
        v.name + shape,
        v.type,
        v.causality,
        v.variability,
        ", ".join(unit or "1" for unit in v.element_units) or v.unit or "",
        start,
        "" if v.min is None else f"{v.min:g}",
        "" if v.max is None else f"{v.max:g}",
        " ".join(v.description.split()),
    ]
