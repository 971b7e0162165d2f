"""The scene of a recording: by the system in its folder, else by the names of its signals."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.view.recorded.traces import Traces, provenance_of, traces_of
from uuvsim_cosim.view.scene3d.motion import Motion, motion_of
from uuvsim_cosim.view.scene3d.scene import Body, Line, Marker, Scene3D

__all__ = ["newest_run", "placed", "scene3d_of_run", "scene3d_of_signals"]

RECORDINGS = ("signals.parquet", "signals.arrows")


def newest_run(runs: str | Path = "runs") -> Path:
    """Return the folder of the newest recording below `runs`, or of the current folder itself."""
    found = [p for name in RECORDINGS for p in Path(runs).glob(f"*/{name}") if p.stat().st_size]
    if not found:
        raise InputInvalid(
            runs,
            "it contains no run",
            "the path of a run's folder, or a current folder in which `uuvsim run` has written one",
        )
    return max(found, key=lambda p: p.stat().st_mtime).parent


def scene3d_of_run(run: str | Path, traces: Traces) -> Scene3D:
    """Return the scene of a run's folder or recording, whose signals are these."""
    path = Path(run)
    folder = path if path.is_dir() else path.parent
    name = path.resolve().name if path.is_dir() else path.stem
    scene3d = None
    if (folder / "system.ssd").is_file():
        from uuvsim_cosim.orchestrator.plan.flatten import flatten
        from uuvsim_cosim.orchestrator.running.library import load
        from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan

        try:
            scene3d = scene3d_of_plan(flatten(load(folder / "system.ssd"), loops="delay"), name)
        except (UuvsimError, OSError) as error:
            reason = f"system.ssd: cannot be read ({error}); hulls are drawn as boxes"
            scene3d = scene3d_of_signals(traces, name, (reason,))
        if not any(s in traces.values for s in scene3d.signals):
            scene3d = None  # the folder holds the recording of another system
    if scene3d is not None:
        return scene3d
    scene3d = scene3d_of_signals(traces, name)
    given = provenance_of(folder).get("waypoints")
    points = np.zeros(0) if given is None else np.asarray(given, float)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        return scene3d
    return scene3d.with_lines(Line("waypoints", points))


def placed(
    run: str | Path, moments: Callable[[Traces], int | None] = lambda traces: None
) -> tuple[Scene3D, Motion, Traces]:
    """Read a run: its scene, its motion, its signals; raises InputInvalid without a position.

    The motion is thinned to at most ``moments(traces)`` moments, if that is a number.
    """
    traces = traces_of(run)
    if not len(traces.time):
        raise InputInvalid(run, "nothing was recorded", "one sample or more")
    scene3d = scene3d_of_run(run, traces)
    motion = motion_of(scene3d, traces, moments(traces))
    if not motion.positions:
        some = ", ".join(list(traces.values)[:4]) or "none"
        raise InputInvalid(
            run,
            "no position was recorded",
            (
                f"a signal eta of 6 elements, such as hull.eta, and found {some}; "
                "`uuvsim report` plots any signal"
            ),
        )
    return scene3d, motion, traces


def scene3d_of_signals(traces: Traces, name: str, notes: tuple[str, ...] = ()) -> Scene3D:
    """Return a scene by signal names: X.eta is a hull, X.position with X.velocity a marker.

    A hull's thrusters cannot be placed, and its size is not known: it is drawn as a box.
    """
    from uuvsim_cosim.view.scene3d.scene_of_plan import ANYTHING

    hulls = [
        key.removesuffix(".eta")
        for key, value in traces.values.items()
        if key.endswith(".eta") and value.ndim == 2 and value.shape[1] == 6
        and f"{key.removesuffix('.eta')}.nu_dot" in traces.values
    ]  # fmt: skip
    hulls = hulls or [
        key.removesuffix(".eta")
        for key, value in traces.values.items()
        if key.endswith(".eta") and value.ndim == 2 and value.shape[1] == 6
        and f"{key.removesuffix('.eta')}.sigma" not in traces.values
    ]  # fmt: skip
    bodies = []
    for hull in hulls:
        prefix = f"{hull.rpartition('.')[0]}.".removeprefix(".")
        q, estimate = (
            name if name in traces.values else ""
            for name in (f"{hull}.q", f"{prefix}navigation.eta")
        )
        bodies.append(Body(hull, ANYTHING, f"{hull}.eta", q, estimate=estimate))
    markers = tuple(
        Marker(key.removesuffix(".position"), key)
        for key, value in traces.values.items()
        if key.endswith(".position") and value.ndim == 2 and value.shape[1] == 3
        and f"{key.removesuffix('.position')}.velocity" in traces.values
    )  # fmt: skip
    return Scene3D(name, tuple(bodies), markers, notes=notes)
