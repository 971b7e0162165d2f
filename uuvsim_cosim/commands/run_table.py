"""The table at the end of a run: figures of merit, what was assumed, what was written where."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.commands.terminal import line, size_of, table, tilde

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.run import Run
    from uuvsim_cosim.scene.mapping import SeabedMap

__all__ = ["show_run"]

MOST_NOTES = 12


def show_run(run: Run, report: Path | None, surveyed: SeabedMap | None = None) -> None:
    """Print the table of a run, with the figures of the map that it made."""
    import numpy as np

    from uuvsim_cosim.scene.left import left_terrain
    from uuvsim_cosim.view.metrics import figures
    from uuvsim_cosim.view.run_report import traces_of

    path = None if run.waypoints is None else np.asarray(run.waypoints)
    traces = traces_of(run.folder)
    found = figures(traces, path)
    left = left_terrain(run.folder / "system.ssd", traces.time, traces.values)
    if surveyed is not None:
        from uuvsim_cosim.view.survey_map import map_figures

        found += map_figures(surveyed)
    rows = [(f.label, f"{f.value:{f.form}}", f.unit, f.note) for f in found]
    rows.append(("simulated", f"{run.time:g}", "s", f"{run.steps} steps of {run.tick:g} s"))
    rows.append(("real-time factor", f"{run.real_time_factor:.1f}", "", f"{run.wall_time:.2f} s"))
    if run.punctuality is not None:
        p = run.punctuality
        late = f"median; 99 %: {1e3 * p.p99:.3f} ms, worst: {1e3 * p.worst:.3f} ms"
        rows.append((f"steps late, at {p.factor:g} times real time", f"{1e3 * p.median:.3f}",
                     "ms", late))  # fmt: skip
        rows.append(("overruns", str(p.overruns), "", f"of {p.steps}"))
    if run.loop_delay is not None:
        rows.append(("slowest control loop's delay", f"{1e3 * run.loop_delay:g}", "ms",
                     run.loop_path))  # fmt: skip
    line()
    line(f"{run.system}, seed {run.seed}")
    table(("", "", "", ""), rows)
    for title, items in (("assumed", run.notes), ("warning", (*run.warnings, *left))):
        for note in items[:MOST_NOTES]:
            line(f"{title}: {note}")
        if len(items) > MOST_NOTES:
            line(f"{title}: and {len(items) - MOST_NOTES} more, in run.json")
    line()
    if run.asked is not None:
        line(f"{tilde(run.asked)} has something in it already, so this run went beside it")
    files = [run.recording, *([report] if report else []), run.folder / "run.json",
             run.folder / "system.ssd", run.folder / "map.npz"]  # fmt: skip
    table(("written", "size"), [(tilde(f), size_of(f)) for f in files if f.is_file()])
