"""Picture of an environment, for render_mode "rgb_array": plan view, depth strip, text."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.envs.pictures.canvas_font import text_width
from uuvsim_cosim.envs.pictures.depth_strip import DepthStrip
from uuvsim_cosim.envs.pictures.drawn import Arena, Cylinder, Goal, Target, Vehicle, View
from uuvsim_cosim.envs.pictures.palette import HULLS, INK, LINE, MUTED, PAGE
from uuvsim_cosim.envs.pictures.plan_view import Plan
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Arena", "Cylinder", "Goal", "Picture", "Target", "Vehicle", "View"]

LEAST_WIDTH, LEAST_HEIGHT = 240, 160  # [px]


class Picture:
    """Draws views of one simulation, one after the other, with a scale that does not jump.

    N is up and E right; a strip beside the plan shows the depth of each vehicle.  The scale is that
    of the arena, if the view has one.  The last `trail` positions of each vehicle are drawn too.
    They are cleared when time goes back, at the start of a new episode.
    """

    def __init__(self, width: int = 640, height: int = 480, *, trail: int = 400) -> None:
        if width < LEAST_WIDTH or height < LEAST_HEIGHT:
            raise InputInvalid(
                "picture", f"{width} x {height} pixels", f"at least {LEAST_WIDTH} x {LEAST_HEIGHT}"
            )
        if trail < 0:
            raise InputInvalid("picture, trail", trail, "0 or more positions")
        self.width, self.height, self.trail = width, height, trail
        self.size = float(np.clip(round(height / 44), 10, 20))  # of the text [px]
        self._side = int(np.clip(0.25 * width, 84, 260))
        gap = round(self.size)
        self._plan = Plan((gap, gap, width - self._side - 2 * gap, height - gap), self.size)
        self._strip = DepthStrip(self.size)
        self._trails: dict[str, list[tuple[float, ...]]] = {}  # N E D
        self._time = -np.inf

    def forget(self) -> None:
        """Start anew: no trails, and a scale that fits the next view."""
        self._trails.clear()
        self._plan.extent.forget()
        self._strip.extent.forget()
        self._time = -np.inf

    def draw(self, view: View) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3) of a view."""
        if view.time is not None:
            if view.time < self._time:
                self.forget()
            self._time = view.time
        self._remember(view.vehicles)
        colours = {v.name: v.colour or HULLS[i % len(HULLS)] for i, v in enumerate(view.vehicles)}
        canvas = Canvas(self.width, self.height, PAGE)
        trails = {name: np.array(t) for name, t in self._trails.items() if len(t) > 1}
        depths = np.concatenate([t[:, 2] for t in trails.values()]) if trails else np.zeros(0)
        self._plan.draw(canvas, view, colours, trails)
        left = self.width - self._side - round(self.size)
        top = self._write(canvas, view, left)
        right, bottom = self.width - round(self.size), self.height - round(self.size)
        self._strip.draw(canvas, view, colours, (left, top, right, bottom), depths)
        return canvas.pixels()

    def _remember(self, vehicles: Sequence[Vehicle]) -> None:
        for name in set(self._trails) - {v.name for v in vehicles}:
            del self._trails[name]
        for vehicle in vehicles:
            track = self._trails.setdefault(vehicle.name, [])
            here = tuple(vehicle.eta[:3])
            if np.isfinite(here).all() and (not track or track[-1] != here):
                track.append(here)
            del track[: max(len(track) - self.trail, 0)]

    def _write(self, canvas: Canvas, view: View, left: int) -> int:
        """Write title, time and lines; returns the y below them, where the strip begins."""
        size, top = self.size, round(self.size)
        leading = round(1.5 * size)
        if view.title:
            canvas.text((left, top), self._cut(view.title, size), INK, size)
            top += leading
        if view.time is not None:
            big = 1.3 * size
            canvas.text((left, top), self._cut(f"{view.time:.1f} s", big), INK, big)
            top += round(1.7 * size)
        lost = [v.name for v in view.vehicles if not np.isfinite(v.eta).all()]
        lines = [*view.lines, *(f"{name}: not finite" for name in lost)]
        room = max(int((0.55 * self.height - top) // leading), 0)
        if len(lines) > room:
            lines = [*lines[: max(room - 1, 0)], f"and {len(lines) - max(room - 1, 0)} more"]
        for line in lines:
            canvas.text((left, top), self._cut(line, size), MUTED, size)
            top += leading
        if top > round(size):
            canvas.rectangle(left, top, self.width - round(size), top + 1, LINE)
            top += round(0.8 * size)
        return top

    def _cut(self, text: str, size: float) -> str:
        """Cut a text to the side's width."""
        if text_width(text, size) <= self._side:
            return text
        while text and text_width(text + "..", size) > self._side:
            text = text[:-1]
        return text + ".."
