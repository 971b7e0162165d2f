"""Pictures of a system's sonars in the panel of replay and live view, beside the 3-D scene."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.models.sensors.sonar_axes import SonarAxes
from uuvsim_cosim.orchestrator.recording.samples import at_rows
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.sonar.pictures import Levels, levels_of, pictures
from uuvsim_cosim.view.sonar.recorded import whole_scans
from uuvsim_cosim.view.sonar.scans import SonarScans

if TYPE_CHECKING:
    from viser import GuiImageHandle, ViserServer

__all__ = ["SonarPictures", "pings_of"]

SIZE = 260  # pixels of an image
PINGS = 200  # of a waterfall


def pings_of(path: str, axes: SonarAxes, traces: Traces) -> SonarScans | None:
    """Return the pings in the rows of a run; None before the first, and where none are recorded."""
    beams, bins = 1 if axes.scans else len(axes.bearings), len(axes.ranges)
    image, sample, bearing = (f"{path}.{name}" for name in ("magnitude", "t_sample", "bearing"))
    needed = {image, sample} | ({bearing} if axes.scans else set())
    if not needed <= set(traces.values) or traces.size(image) != beams * bins:
        return None
    time, rows = np.unique(np.asarray(traces.values[sample], float), return_index=True)
    rows, time = rows[time >= 0], time[time >= 0]  # before the first sample it is -1
    if not len(rows):
        return None
    magnitude = at_rows(traces.values, image, rows).astype(np.float32)
    return SonarScans(
        path, time, np.zeros(1) if axes.scans else axes.bearings, axes.ranges,
        magnitude.reshape(-1, beams, bins), downward=axes.kind == "multibeam_sonar",
        detections=np.asarray(traces.values[bearing], float)[rows, None] if axes.scans else None,
    )  # fmt: skip


class SonarPictures:
    """The newest picture of each sonar, or its waterfall; white is the greatest level so far."""

    def __init__(self, server: ViserServer, sonars: Mapping[str, SonarAxes]) -> None:
        self._server, self._sonars = server, sonars
        self._traces: Traces | None = None
        self._pings: dict[str, SonarScans] = {}
        self._white: dict[str, float] = {}  # Pa
        self._drawn: dict[str, float] = {}  # s, time of the ping that is shown
        self.places: dict[str, GuiImageHandle] = {}

    def show(self, traces: Traces, t: float | None = None) -> None:
        """Show the last ping at or before a time [s], by default the newest."""
        if traces is not self._traces:
            found = {path: pings_of(path, axes, traces) for path, axes in self._sonars.items()}
            self._pings = {path: pings for path, pings in found.items() if pings is not None}
            self._traces = traces
            for path, pings in self._pings.items():
                white = levels_of(pings).reference
                self._white[path] = max(self._white.get(path, 0.0), white)
        for path, pings in self._pings.items():
            end = len(pings) if t is None else int(np.searchsorted(pings.time, t, side="right"))
            if not end or self._drawn.get(path) == pings.time[end - 1]:
                continue
            self._drawn[path] = float(pings.time[end - 1])
            self._show(path, _newest(pings, self._sonars[path], end))

    def _show(self, path: str, scans: SonarScans) -> None:
        kind = "waterfall" if scans.is_side_scan else "fan"
        drawn = next(pictures(scans, kind, Levels(self._white[path]), SIZE))
        if path in self.places:
            self.places[path].image = drawn
        else:
            self.places[path] = self._server.gui.add_image(drawn, label=path, format="png")


def _newest(pings: SonarScans, axes: SonarAxes, end: int) -> SonarScans:
    """Return what is shown of the pings before `end`: the last one, a scan, or a waterfall."""
    if axes.scans:
        part = pings.between(max(0, end - len(axes.bearings)), end)
        assert part.detections is not None
        scans = whole_scans(part, axes, part.detections[:, 0])
        newest = scans.magnitude[-1]
        if len(scans) > 1:  # where the scan has not come yet, the one before it
            newest = np.where(newest.any(axis=1, keepdims=True), newest, scans.magnitude[-2])
        last = scans.at(float(scans.time[-1]))
        return SonarScans(last.name, last.time, last.bearings, last.ranges, newest[None])
    if pings.is_side_scan:
        return pings.between(max(0, end - PINGS), end)
    return pings.between(end - 1, end)
