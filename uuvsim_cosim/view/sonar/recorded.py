"""Images of the sonars of a recorded run, with axes that follow from the run's `system.ssd`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.sensors.sonar_axes import SonarAxes, sonar_axes
from uuvsim_cosim.models.worlds.ground import ground_named
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan, PlannedComponent
from uuvsim_cosim.orchestrator.recording.recording_reader import read_signals
from uuvsim_cosim.orchestrator.recording.samples import at_rows
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.running.library import load
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = ["all_scans", "scans_of_run", "sonars_of", "whole_scans"]


def sonars_of(plan: Plan) -> dict[str, PlannedComponent]:
    """Return the components of a system that are sonars with images, by their path."""
    return {c.path: c for c in plan.components if sonar_axes(c.source) is not None}


def scans_of_run(run: str | Path, component: str = "") -> SonarScans:
    """Return the pings that a sonar of a run recorded; `component` is needed if there are several.

    Raises `InputInvalid` if the run has no such sonar, or if its image was not recorded.
    """
    folder = Path(run).expanduser()
    system = folder / "system.ssd"
    if not system.is_file():
        raise InputInvalid(
            folder, "there is no system.ssd beside the recording", "the folder of a run"
        )
    plan = flatten(load(system), loops="delay")
    sonars = sonars_of(plan)
    if not sonars:
        raise InputInvalid(
            folder,
            "its system has no sonar with images",
            "a component such as imaging_sonar or side_scan_sonar",
        )
    if component and component not in sonars:
        raise InputInvalid(folder, f"no sonar {component!r}", f"one of {', '.join(sonars)}")
    if not component and len(sonars) > 1:
        raise InputInvalid(folder, f"{len(sonars)} sonars", f"--sonar {' or '.join(sonars)}")
    found = sonars[component or next(iter(sonars))]
    return _scans(folder, plan, found, read_signals(folder))


def all_scans(run: str | Path) -> list[SonarScans]:
    """Return the pings of each sonar of a run whose image was recorded; none without system.ssd."""
    folder = Path(run).expanduser()
    if not (folder / "system.ssd").is_file():
        return []
    plan, signals = flatten(load(folder / "system.ssd"), loops="delay"), read_signals(folder)
    return [
        _scans(folder, plan, c, signals)
        for path, c in sonars_of(plan).items()
        if f"{path}.magnitude" in signals and np.max(signals[f"{path}.t_sample"], initial=-1) >= 0
    ]


def _scans(folder: Path, plan: Plan, c: PlannedComponent, signals: Signals) -> SonarScans:
    axes = sonar_axes(c.source)
    assert axes is not None
    beams, bins = 1 if axes.scans else len(axes.bearings), len(axes.ranges)
    image, sample = f"{c.path}.magnitude", f"{c.path}.t_sample"
    if image not in signals or sample not in signals:
        raise InputInvalid(folder, f"{image} was not recorded", "a run that records it")
    time, rows = np.unique(np.asarray(signals[sample], float), return_index=True)
    rows, time = rows[time >= 0], time[time >= 0]  # before the first sample it is -1
    if not len(rows):
        raise InputInvalid(folder, f"{c.path} had no ping", "a run that is longer than its period")
    recorded = signals.values_by_name
    magnitude = at_rows(recorded, image, rows).reshape(len(rows), -1)
    size = magnitude.shape[1]
    if size != beams * bins:
        raise InputInvalid(
            f"{folder}: {image}", f"{size} numbers", f"{beams} beams of {bins} bins, as {c.source}"
        )

    def plane(name: str) -> np.ndarray | None:
        signal = f"{c.path}.{name}"
        if signal not in signals:
            return None
        return _planes(at_rows(recorded, signal, rows), beams, bins)

    bearing = f"{c.path}.bearing"
    if axes.scans and bearing not in signals:
        raise InputInvalid(folder, f"{bearing} was not recorded", "a run that records it")
    real, imaginary, label = map(plane, ("real", "imaginary", "label"))
    pressure = None if real is None or imaginary is None else (real + 1j * imaginary)
    strongest = f"{c.path}.range"
    detections = None
    if strongest in signals:
        detections = np.asarray(signals[strongest], float)[rows].reshape(len(rows), beams)
    frequency, speed = (
        float(np.asarray(c.start.get(name, c.description.variables[name].start)))
        for name in ("frequency", "sound_speed")
    )
    found = SonarScans(
        c.path, time, np.zeros(1) if axes.scans else axes.bearings, axes.ranges,
        _planes(magnitude, beams, bins),
        pressure=None if pressure is None else pressure.astype(np.complex64),
        detections=detections,
        labels=None if label is None else label.astype(np.uint16),
        shown=() if label is None else _shown(axes),
        eta=_pose(plan, c.path, signals, rows), frequency=frequency, sound_speed=speed,
        downward=axes.kind == "multibeam_sonar",
    )  # fmt: skip
    return (
        whole_scans(found, axes, np.asarray(signals[bearing], float)[rows]) if axes.scans else found
    )


def _planes(values: np.ndarray, beams: int, bins: int) -> np.ndarray:
    return np.asarray(values, np.float32).reshape(-1, beams, bins)


def whole_scans(pings: SonarScans, axes: SonarAxes, bearing: np.ndarray) -> SonarScans:
    """Return the scans of a scanning sonar: each an image of the pings from port to starboard.

    A scan has the time and the pose of its last ping. Beams that it has not reached are 0.
    """
    number = np.abs(bearing[:, None] - axes.bearings).argmin(axis=1)
    scan = np.cumsum(np.concatenate([[0], np.diff(number) < 0]))
    n, last = int(scan[-1]) + 1, np.flatnonzero(np.diff(scan, append=scan[-1] + 1))
    shape = (n, len(axes.bearings))

    def placed(values: np.ndarray | None) -> np.ndarray | None:
        if values is None:
            return None
        image = np.zeros((*shape, *values.shape[2:]), values.dtype)
        image[scan, number] = values[:, 0]
        return image

    magnitude = placed(pings.magnitude)
    assert magnitude is not None
    return replace(
        pings, time=pings.time[last], bearings=axes.bearings, magnitude=magnitude,
        pressure=placed(pings.pressure), detections=placed(pings.detections),
        labels=placed(pings.labels), eta=None if pings.eta is None else pings.eta[last],
    )  # fmt: skip


def _pose(plan: Plan, path: str, signals: Signals, rows: np.ndarray) -> np.ndarray | None:
    """Return the pose of the hull to which the sonar's `eta` is connected; None if unknown."""
    for t in plan.transfers:
        if plan.components[t.target].path == path and t.target_variable.name == "eta":
            name = f"{plan.components[t.source].path}.{t.source_variable.name}"
            return np.asarray(signals[name], float)[rows] if name in signals else None
    return None


def _shown(axes: SonarAxes) -> tuple[str, ...]:
    names = ground_named(axes.scene).names
    return ("no echo", "seabed", *(name or f"solid {i + 1}" for i, name in enumerate(names)))
