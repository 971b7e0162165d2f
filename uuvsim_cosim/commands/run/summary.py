"""Summary at the end of a run: figures of merit, assumptions and written files."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from uuvsim_cosim.commands.shared.answer import answer
from uuvsim_cosim.commands.shared.terminal import file_table, line, put, remark, table, tilde

if TYPE_CHECKING:
    from uuvsim_cosim.orchestrator.running.run import Run
    from uuvsim_cosim.scene.mapping.mapping import SeabedMap
    from uuvsim_cosim.view.recorded.metrics import Figure

__all__ = ["figure_table", "show_run", "summary"]

MOST_NOTES = 12


def summary(run: Run, surveyed: SeabedMap | None = None) -> tuple[list[Figure], list[str]]:
    """Return the figures of a run and its map, and warnings on terrain and contact."""
    import numpy as np

    from uuvsim_cosim.scene.run_warnings import contact_warnings, sonar_warnings, terrain_warnings
    from uuvsim_cosim.view.recorded.metrics import Figure, figures
    from uuvsim_cosim.view.recorded.traces import traces_of

    path = None if run.waypoints is None else np.asarray(run.waypoints)
    traces = traces_of(run.folder)
    found = figures(traces, path)
    ssd = run.folder / "system.ssd"
    warnings = terrain_warnings(ssd, traces.time, traces.values)
    warnings += sonar_warnings(ssd, traces.time, traces.values)
    warnings += contact_warnings(ssd, run.tick, traces.values)
    if surveyed is not None:
        from uuvsim_cosim.view.reports.survey_map import map_figures

        found += map_figures(surveyed)
    begun = f", from {run.start:g} s" if run.start else ""
    steps = f"{run.steps} steps of {run.tick:g} s{begun}"
    if run.variable_step is not None:
        v = run.variable_step
        steps = f"{v.steps} steps of {v.shortest:g} to {v.longest:g} s{begun}"
    factor, wall = run.real_time_factor, f"{run.wall_time:.2f} s"
    found.append(Figure("simulated", "simulated", run.time, "s", "g", steps))
    found.append(Figure("real_time_factor", "real-time factor", factor, "", ".1f", wall))
    if run.punctuality is not None:
        p = run.punctuality
        late = f"median; 99 %: {1e3 * p.p99:.3f} ms, worst: {1e3 * p.worst:.3f} ms"
        label = f"steps late, at {p.factor:g} times real time"
        found.append(Figure("late_median", label, 1e3 * p.median, "ms", ".3f", late))
        found.append(Figure("overruns", "overruns", p.overruns, "", "d", f"of {p.steps}"))
    if run.variable_step is not None:
        repeated = run.variable_step.rejected
        found.append(Figure("repeated_steps", "steps repeated", repeated, "", "d", "shorter"))
    if run.loop_delay is not None:
        label, delay = "slowest control loop's delay", 1e3 * run.loop_delay
        found.append(Figure("loop_delay", label, delay, "ms", "g", run.loop_path))
    if run.residual is not None:
        r = run.residual
        unit = "" if r.unit == "1" else r.unit
        where = f"{r.source} -> {r.target}, t = {r.time:.6g} s"
        label = "largest coupling residual"
        found.append(Figure("coupling_residual", label, r.residual, unit, ".3g", where))
    return found, list(warnings)


def figure_table(figures: Iterable[Figure]) -> None:
    """Print figures of merit, one a line; in JSON, the field `metrics`."""
    from uuvsim_cosim.view.recorded.metrics import metrics_of

    found = list(figures)
    put("metrics", metrics_of(found))
    if answer().mode == "json":
        return
    rows = [(f.label, f"{f.value:{f.form}}", f.unit, f.note) for f in found]
    table(("", "", "", ""), rows)


def show_run(run: Run, report: Path | None, figures: list[Figure], warnings: list[str]) -> None:
    """Print the summary of a run: figures, assumptions and written files."""
    line()
    line(f"{run.system}, seed {run.seed}")
    put("system", run.system)
    put("seed", run.seed)
    put("folder", str(run.folder))
    put("interrupted", run.interrupted)
    figure_table(figures)
    remarks("assumed", run.notes)
    remarks("warning", (*run.warnings, *warnings))
    for hops in run.iterated:
        remark("note", f"iterated loop: {hops}")
    line()
    if run.asked is not None:
        put("asked", str(run.asked))
        line(f"{tilde(run.asked)} is not empty, so this run was written beside it")
    files = [run.recording, *([report] if report else []), run.folder / "run.json",
             run.folder / "system.ssd", run.folder / "map.npz"]  # fmt: skip
    file_table(f for f in files if f.is_file())


def remarks(kind: Literal["assumed", "warning"], texts: Sequence[str]) -> None:
    """Print remarks; only the first ones as text if there are many."""
    most = MOST_NOTES if answer().mode == "text" else len(texts)
    for text in texts[:most]:
        remark(kind, text)
    if len(texts) > most:
        remark(kind, f"and {len(texts) - most} more, in run.json")
