"""What a notebook shows for a system, a run and a model.

`System`, `Run` and `Model` call these functions by name, as they are in lower packages.
"""

from __future__ import annotations

from html import escape

import numpy as np

from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.model import Declared, Model
from uuvsim_cosim.models.declaration.parameter_files import vehicle_ids, vehicle_sets
from uuvsim_cosim.orchestrator.running.run import Run
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.view.diagram.diagram import diagram
from uuvsim_cosim.view.reports.run_report import write_report

__all__ = ["model_html", "run_html", "system_svg"]

HEIGHT = 620  # pixels of an embedded report
MOST = 12  # elements of a start value that are shown


def system_svg(system: System) -> str:
    """Return the block diagram of a system."""
    return diagram(system)


def run_html(run: Run) -> str:
    """Return the report of a run in a frame of its own; the report is written if it is missing."""
    report = run.folder / "report.html"
    if not report.is_file():
        write_report(run.folder)
    page = escape(report.read_text(encoding="utf-8"), quote=True)
    return (
        f'<iframe srcdoc="{page}" title="report of {escape(run.system)}" '
        f'style="width:100%;height:{HEIGHT}px;border:1px solid #ccc"></iframe>'
    )


def model_html(model: Model) -> str:
    """Return a table of a component's variables; of a vehicle also what its numbers amount to."""
    rows = "".join(_row(v) for v in model.variables.values() if v.kind != "derived")
    head = "".join(f"<th>{c}</th>" for c in ("name", "kind", "unit", "start", "meaning"))
    address = _address(model)
    figures = _vehicle_html(address) if address else ""
    return (
        f"<b>{escape(model.name)}</b>: {escape(model.description)}{figures}"
        f"<table><tr>{head}</tr>{rows}</table>"
    )


def _row(v: Declared) -> str:
    shape = f"[{', '.join(map(str, v.shape))}]" if v.shape else ""
    start = ""
    if isinstance(v.start, np.ndarray):
        flat = np.unique(v.start) if len(np.unique(v.start)) == 1 else v.start.ravel()
        start = ", ".join(f"{x:g}" for x in flat[:MOST]) + (", …" if len(flat) > MOST else "")
    unit = v.unit or ", ".join(v.units)
    cells = (f"<code>{v.name}{shape}</code>", v.kind, escape(unit), start, escape(v.description))
    return "<tr>" + "".join(f"<td>{c}</td>" for c in cells) + "</tr>"


def _address(model: Model) -> str | None:
    """Return the shipped parameter set, ``id@set``, whose numbers a model has; None if none has.

    A name alone does not decide: a vehicle of one's own may have the name of a shipped one.
    """
    for id in vehicle_ids():
        for published in vehicle_sets(id):
            if model.name in (id, f"{id}_{published}"):
                shipped = declare(f"{id}@{published}").starts()
                own = model.starts()
                if all(np.array_equal(own[n], shipped[n]) for n in own.keys() & shipped.keys()):
                    return f"{id}@{published}"
    return None


def _vehicle_html(address: str) -> str:
    """Return the balance of a vehicle's parameter set."""
    from uuvsim_cosim.models.vehicles.vehicle_figures import vehicle_figures

    f = vehicle_figures(address, 0.5)  # [m/s]; no figure below depends on it
    rows = (
        ("mass", f"{f.mass:.4g} kg"),
        ("weight", f"{f.weight:.5g} N"),
        ("buoyancy", f"{f.buoyancy:.5g} N"),
        ("centre of gravity about CO", ", ".join(f"{x:.4g}" for x in f.r_g) + " m"),
        ("centre of buoyancy about CO", ", ".join(f"{x:.4g}" for x in f.r_b) + " m"),
    )
    cells = "".join(f"<tr><td>{label}</td><td>{value}</td></tr>" for label, value in rows)
    return f"<table>{cells}</table>"
