"""The depth strip: D down, a column for each vehicle and target, seen from the side."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from uuvsim_cosim.envs.pictures import palette
from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.envs.pictures.canvas_coverage import Box, Floats
from uuvsim_cosim.envs.pictures.canvas_font import text_width
from uuvsim_cosim.envs.pictures.drawn import View
from uuvsim_cosim.envs.pictures.hull_outline import from_the_side
from uuvsim_cosim.envs.pictures.scale import Extent, label, nice_step, ticks

__all__ = ["DepthStrip"]


class DepthStrip:
    """One panel of a picture; keeps the range of depths that it shows."""

    def __init__(self, size: float) -> None:
        self.size = size
        self.extent = Extent(least_span=2.0)

    def draw(
        self, canvas: Canvas, view: View, colours: Mapping[str, str], box: Box, past: Floats
    ) -> None:
        """Draw the panel into a box of the canvas; `past` are earlier depths, kept in sight."""
        size = self.size
        left, top, right, bottom = box
        canvas.text((left, top), "depth [m]", palette.MUTED, size)
        top += round(1.4 * size)
        low, high = self._range(view, past)
        if bottom - top < 4 * size:
            return
        per_metre = (bottom - top) / (high - low)
        step = nice_step(max(2.6 * size / per_metre, 1e-6))
        levels = ticks(low, high, step)
        texts = [label(d, step) for d in levels]
        small = max(size - 1.0, 10.0)
        left += max((text_width(t, small) for t in texts), default=0) + round(0.5 * size)
        canvas.shade(left, top, right, bottom, palette.SHALLOW, palette.DEEP)
        for depth, text in zip(levels, texts, strict=True):
            y = top + (depth - low) * per_metre
            at = float(np.clip(y, top + 0.35 * size, bottom - 0.35 * size))
            canvas.text((left - 0.4 * size, at), text, palette.MUTED, small, anchor=(1, 0.5))
            canvas.rectangle(left, np.floor(y), right, np.floor(y) + 1, palette.CARD, 0.6)
        with canvas.clipped(left, top, right, bottom):
            # The air above the surface, the floor, and the depths of the goals.
            surface = top - low * per_metre
            if surface > top:
                canvas.rectangle(left, top, right, surface, palette.PAGE)
                canvas.rectangle(left, surface - 1, right, surface + 1, palette.FLOW)
            if view.arena is not None and view.arena.floor is not None:
                floor = top + (view.arena.floor - low) * per_metre
                canvas.rectangle(left, floor, right, bottom, palette.FLOOR)
            for goal in view.goals:
                if len(goal.position) == 3 and np.isfinite(goal.position[2]):
                    y = top + (goal.position[2] - low) * per_metre
                    canvas.line([(left, y), (right, y)], palette.GOAL, 1.5, 0.9, dash=(5, 4))
            width = (right - left) / max(len(view.vehicles) + len(view.targets), 1)
            length = float(np.clip(0.72 * width, 0.8 * size, 3.2 * size))
            for i, vehicle in enumerate(view.vehicles):
                if not np.isfinite(vehicle.eta).all():
                    continue
                x, y = left + (i + 0.5) * width, top + (vehicle.eta[2] - low) * per_metre
                outline = from_the_side(length, 0.42 * length, vehicle.eta[4]) + np.array([x, y])
                canvas.line(outline, palette.CARD, 0.3 * size, 0.8, closed=True)
                canvas.polygon(outline, colours[vehicle.name])
                canvas.line(outline, palette.INK, 1.0, 0.55, closed=True)
                text = f"{vehicle.eta[2]:.2f}"
                if text_width(text, size) < width - 2:
                    where = (x, y + 0.42 * length + 0.3 * size)
                    canvas.text(where, text, palette.INK, size, anchor=(0.5, 0))
            for i, target in enumerate(view.targets, len(view.vehicles)):
                centre = (left + (i + 0.5) * width, top + (target.position[2] - low) * per_metre)
                canvas.disc(centre, 0.55 * size, palette.CARD, 0.8)
                canvas.circle(centre, 0.48 * size, palette.TARGET, 0.16 * size)
                canvas.disc(centre, 0.2 * size, palette.TARGET)

    def _range(self, view: View, past: Floats) -> tuple[float, float]:
        """Return the least and greatest depth shown: the pool's, or a slowly adapting one."""
        if view.arena is not None and view.arena.floor is not None:
            return -0.06 * view.arena.floor, 1.06 * view.arena.floor
        depths = [v.eta[2] for v in view.vehicles] + [t.position[2] for t in view.targets]
        depths += past.tolist()
        depths += [g.position[2] for g in view.goals if len(g.position) == 3]
        finite = [d for d in depths if np.isfinite(d)] or [0.0]
        if min(finite) < max(10.0, 3.0 * (max(finite) - min(finite))):
            finite.append(0.0)  # the surface is near enough to be shown
        low, high = self.extent.follow(np.array(finite)[:, None])
        return float(low[0]), float(high[0])
