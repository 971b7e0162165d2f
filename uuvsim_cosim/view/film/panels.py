"""Inset panels of a film: signals as plots with a mark at the present, and images of sensors."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass, field
from pathlib import Path
from typing import final
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.element_names import split_element_name
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.scene.shared.ray_casting import Caster
from uuvsim_cosim.view.recorded.traces import Traces
from uuvsim_cosim.view.scene3d.scene import Body
from uuvsim_cosim.view.sonar.pictures import Levels, levels_of, pictures
from uuvsim_cosim.view.sonar.recorded import scans_of_run
from uuvsim_cosim.view.sonar.scans import SonarScans

__all__ = ["MOST", "Panel", "panels_of"]

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
MOST = 6  # panels of a film
POINTS = 600  # of a plot
PAPER, INK, FAINT, LINE = "#0d1b26", "#f2f6f9", "#8fa3b3", "#f2b632"


class Panel:
    """Something to draw in a box of the frame, at a time of the run."""

    aspect = 0.42  # height over width

    @abstractmethod
    def draw(self, canvas: Canvas, box: tuple[int, int, int, int], size: float, t: float) -> None:
        """Draw into left, top, width and height [px]; `size` is that of small text."""


@final
@dataclass(frozen=True, eq=False)
class _Plot(Panel):
    """A signal over the time of the film."""

    title: str
    time: Array  # s
    values: Array
    upward: bool = True  # False: a greater value is lower, as a depth

    def draw(self, canvas: Canvas, box: tuple[int, int, int, int], size: float, t: float) -> None:
        left, top, width, height = box
        canvas.rectangle(left, top, left + width, top + height, PAPER, 0.72)
        now = float(np.interp(t, self.time, self.values))
        canvas.text((left + 6, top + 6), self.title, FAINT, size)
        canvas.text((left + width - 6, top + 6), f"{now:.2f}", INK, size, anchor=(1.0, 0.0))
        low, high = float(np.nanmin(self.values)), float(np.nanmax(self.values))
        if high - low < 1e-3:
            low, high = low - 0.5, high + 0.5
        first, last = float(self.time[0]), float(self.time[-1])
        above = top + 14 + size

        def at(times: Array, values: Array) -> Array:
            x = left + 6 + (width - 12) * (times - first) / max(last - first, 1e-9)
            share = (values - low) / (high - low)
            share = 1.0 - share if self.upward else share
            return np.column_stack([x, above + (top + height - 7 - above) * share])

        canvas.line(at(self.time, self.values), FAINT, 1.0)
        past = self.time <= t
        done = at(np.append(self.time[past], t), np.append(self.values[past], now))
        canvas.line(done, LINE, 1.6)
        canvas.disc(done[-1], 3.0, LINE)


@final
@dataclass(frozen=True, eq=False)
class _Sonar(Panel):
    """The image of a sonar: the last ping at or before the time."""

    scans: SonarScans
    levels: Levels
    aspect: float = 0.8
    last: dict[tuple[float, int], Pixels] = field(default_factory=dict)  # the newest picture

    def draw(self, canvas: Canvas, box: tuple[int, int, int, int], size: float, t: float) -> None:
        left, top, width, height = box
        canvas.rectangle(left, top, left + width, top + height, PAPER, 0.72)
        if t < self.scans.time[0]:
            canvas.text((left + 6, top + 6), f"{self.scans.name}: no ping yet", FAINT, size)
            return
        kind = "waterfall" if self.scans.is_side_scan else "fan"
        shown = self.scans.at(t)
        if kind == "waterfall":
            last = int(np.searchsorted(self.scans.time, t, side="right"))
            shown = self.scans.between(0, last)
        key = float(shown.time[-1]), width
        if key not in self.last:  # a ping is shown in several frames
            self.last.clear()
            self.last[key] = next(pictures(shown, kind, self.levels, max(int(0.8 * width), 16)))
        _fit(canvas, self.last[key], box)


@final
@dataclass(frozen=True, eq=False)
class _Camera(Panel):
    """The image of a colour camera, in linear light: levels (T, rows, columns, 3) at times (T,)."""

    name: str
    time: Array
    levels: Pixels
    aspect: float = 0.75

    def draw(self, canvas: Canvas, box: tuple[int, int, int, int], size: float, t: float) -> None:
        left, top, width, height = box
        k = int(np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 1))
        image = np.asarray(255.0 * (self.levels[k] / 255.0) ** (1.0 / 2.2) + 0.5).astype(np.uint8)
        canvas.rectangle(left, top, left + width, top + height, PAPER, 0.72)
        _fit(canvas, image, box)
        canvas.text((left + 6, top + 6), self.name, INK, size)


def panels_of(
    names: list[str],
    run: Path,
    traces: Traces,
    body: Body,
    position: Array,
    caster: Caster,
    span: tuple[float, float],
) -> list[Panel]:
    """Return the panels of these names: depth, speed, altitude, a signal, a sonar or a camera.

    `position` (T, 3) is that of the vehicle at all samples; `span` is the first and the last time.
    Raises InputInvalid for a name that the run does not have.
    """  # fmt: skip
    if len(names) > MOST:
        raise InputInvalid("--panel", f"{len(names)} panels", f"at most {MOST}")
    found: list[Panel] = []
    for name in names:
        derived = _derived(name, traces, body, position, caster)
        if derived is not None:
            title, values = derived
            found.append(_plot(title, traces.time, values, span, upward=name != "depth"))
            continue
        if f"{name}.magnitude" in traces.values:
            scans = scans_of_run(run, name)
            found.append(_Sonar(scans, levels_of(scans)))
            continue
        if f"{name}.image" in traces.values:
            found.append(_camera(name, run, traces))
            continue
        samples = _signal(name, traces)
        if samples is None:
            have = ["depth", "speed", "altitude", *traces.values]
            have += [n.removesuffix(".magnitude") for n in have if n.endswith(".magnitude")]
            raise InputInvalid("--panel", f"{name!r} is not in {run}", expected_names(name, have))
        unit = traces.units.get(name, "")
        found.append(_plot(f"{name} [{unit}]" if unit else name, traces.time, samples, span))
    return found


def _derived(
    name: str, traces: Traces, body: Body, position: Array, caster: Caster
) -> tuple[str, Array] | None:
    if name == "depth":
        return "depth [m]", position[:, 2]
    if name == "altitude":
        height = caster.height(position[:, 0], position[:, 1]) - position[:, 2]
        if not np.isfinite(height).any():
            raise InputInvalid("--panel", "'altitude' without a seabed", "depth, speed or a signal")
        return "altitude [m]", height
    if name == "speed":
        nu = traces.values.get(f"{body.eta.rpartition('.')[0]}.nu")
        if nu is not None and nu.ndim == 2 and nu.shape[1] >= 3:
            return "speed [m/s]", np.linalg.norm(nu[:, :3], axis=1)
        if len(traces.time) < 2:
            return "speed [m/s]", np.zeros(len(traces.time))
        return "speed [m/s]", np.linalg.norm(np.gradient(position, traces.time, axis=0), axis=1)
    return None


def _signal(name: str, traces: Traces) -> Array | None:
    """Return a scalar signal, or an element such as hull.nu[1]; None if there is none."""
    whole, indices = split_element_name(name)
    if name in traces.values and traces.size(name) == 1:
        return np.asarray(traces.values[name], float).reshape(-1)
    if whole in traces.values and len(indices) == 1 and 1 <= indices[0] <= traces.size(whole):
        return np.asarray(traces.values[whole][:, indices[0] - 1], float)
    return None


def _plot(
    title: str, time: Array, values: Array, span: tuple[float, float], *, upward: bool = True
) -> _Plot:
    """Return a plot over the span: at most `POINTS` points, all of them finite."""
    inside = np.flatnonzero((time >= span[0]) & (time <= span[1]) & np.isfinite(values))
    if not len(inside):
        raise InputInvalid("--panel", f"{title}: no finite sample in the film", "a longer film")
    picks = inside[np.unique(np.linspace(0, len(inside) - 1, POINTS).astype(int))]
    return _Plot(title, time[picks], values[picks], upward)


def _camera(name: str, run: Path, traces: Traces) -> _Camera:
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.orchestrator.running.library import load

    system = run / "system.ssd"
    known = flatten(load(system), loops="delay").components if system.is_file() else ()
    source = next((c.source for c in known if c.path == name), "")
    options = dict(parse_qsl(source.partition("?")[2]))
    columns, rows = int(options.get("columns", 32)), int(options.get("rows", 24))
    size = traces.size(f"{name}.image")
    if "color_camera" not in source or size != 3 * rows * columns:
        raise InputInvalid("--panel", f"{name}: an image of {size} numbers", "a colour camera's")
    sample = traces.values.get(f"{name}.t_sample", traces.time)
    time, first = np.unique(np.asarray(sample, float), return_index=True)
    levels = np.clip(traces.values[f"{name}.image"][first], 0, 255).astype(np.uint8)
    return _Camera(name, time, levels.reshape(-1, rows, columns, 3), rows / columns)


def _fit(canvas: Canvas, image: Pixels, box: tuple[int, int, int, int]) -> None:
    """Place an image in the middle of a box, nearest pixels shown."""
    left, top, width, height = box
    scale = min(width / image.shape[1], height / image.shape[0])
    rows, columns = max(1, int(image.shape[0] * scale)), max(1, int(image.shape[1] * scale))
    i = np.minimum(((np.arange(rows) + 0.5) / scale).astype(int), image.shape[0] - 1)
    j = np.minimum(((np.arange(columns) + 0.5) / scale).astype(int), image.shape[1] - 1)
    canvas.place(left + (width - columns) // 2, top + (height - rows) // 2, image[np.ix_(i, j)])
