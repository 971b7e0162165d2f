"""Frames of a sensor component of the system, from the recording of its run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.sensors.multibeam_and_camera import PRESETS
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.scene.mapping.scans import Sonde, Taken, rotation, sonde

__all__ = ["recorded_sonde"]

OUTPUTS = {"multibeam": "range", "depth_camera": "image"}


def recorded_sonde(run: Path, component: str, signals: Signals) -> Sonde:
    """Return a multibeam or depth camera of a run's system, with its recorded frames.

    The directions of its beams follow from its source and its mounting in the run's `system.ssd`.
    Raises InputInvalid if there is no such instrument, or its readings were not recorded.
    """
    planned = _planned(run, component)
    name, _, query = planned.source.removeprefix("model:").partition("?")
    kind, _, preset = name.partition("@")
    options = dict(parse_qsl(query))
    if kind not in OUTPUTS:
        raise InputInvalid(
            run, f"{component} is {planned.source}", f"model:{' or model:'.join(OUTPUTS)}"
        )
    size = {k: options[k] for k in ("beams", "columns", "rows") if k in options}
    found = sonde(kind, preset or options.get("id", PRESETS[kind]), 1.0, **size)
    if "r_s" in planned.start:
        found = replace(found, r_s=np.array(planned.start["r_s"], float))
    if "Theta_s" in planned.start:
        found = replace(found, R_bs=rotation(*np.array(planned.start["Theta_s"], float)))
    reading, sample = f"{component}.{OUTPUTS[kind]}", f"{component}.t_sample"
    if reading not in signals or sample not in signals:
        raise InputInvalid(run, f"{reading} was not recorded", "a run of this system")
    t, first = np.unique(signals[sample], return_index=True)
    first, t = first[t >= 0], t[t >= 0]  # before the first sample it is -1
    ranges = np.asarray(signals[reading], float)[first]
    ranges = np.where(ranges > 0, ranges, np.nan)  # NaN without an echo
    if kind == "depth_camera" and options.get("reading", "depth") == "depth":
        ranges = ranges / found.directions[:, 2]
    period = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    return replace(found, name=f"{component}, in the loop", period=period, taken=Taken(t, ranges))


def _planned(run: Path, component: str) -> PlannedComponent:
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    plan = flatten(load(run / "system.ssd"), loops="delay")
    for planned in plan.components:
        if planned.path == component:
            return planned
    known = ", ".join(c.path for c in plan.components)
    raise InputInvalid(run, f"its system has no component {component!r}", f"one of {known}")
