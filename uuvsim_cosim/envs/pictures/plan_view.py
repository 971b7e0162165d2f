"""The plan view, as on a chart: N up, E right, with grid, scale bar and north arrow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.envs.pictures import palette
from uuvsim_cosim.envs.pictures.canvas import Canvas
from uuvsim_cosim.envs.pictures.canvas_coverage import Box, Floats
from uuvsim_cosim.envs.pictures.canvas_font import cap_height, text_width
from uuvsim_cosim.envs.pictures.drawn import View
from uuvsim_cosim.envs.pictures.hull_outline import from_above, shown_size
from uuvsim_cosim.envs.pictures.scale import Extent, label, nice_step, ticks

__all__ = ["Plan"]


class Plan:
    """One panel of a picture; keeps the part of the world that it shows, and its still layer."""

    def __init__(self, box: Box, size: float) -> None:
        self.size = size
        left, top, right, bottom = box
        self.box = (left + round(2.6 * size), top, right, bottom - round(1.6 * size))
        self.extent = Extent(least_span=2.0)
        self._still: tuple[bytes, Canvas] | None = None
        self.scale = 1.0  # [px/m]
        self.middle = np.zeros(2)  # N and E in the middle of the panel [m]

    def draw(
        self, canvas: Canvas, view: View, colours: Mapping[str, str], trails: Mapping[str, Floats]
    ) -> None:
        """Draw the panel onto the canvas."""
        self._aim(view, trails)
        self._lay_still(canvas, view)
        with canvas.clipped(*self.box):
            for track in view.trails:
                canvas.line(self.at(track), palette.MUTED, 1.5, 0.5)
            for name, track in trails.items():
                fade = np.linspace(0.08, 0.75, len(track) - 1)
                canvas.line(self.at(track), colours[name], 0.16 * self.size, fade)
            self._goals(canvas, view)
            self._targets(canvas, view)
            self._vehicles(canvas, view, colours)
            self._compass(canvas, view)

    def at(self, north_east: ArrayLike) -> Floats:
        """Return x and y on the canvas [px] of N and E [m], (n, 2) or (2)."""
        off = (np.asarray(north_east, float)[..., :2] - self.middle) * self.scale
        left, top, right, bottom = self.box
        x, y = 0.5 * (left + right) + off[..., 1], 0.5 * (top + bottom) - off[..., 0]
        return np.stack([x, y], axis=-1)

    def _aim(self, view: View, trails: Mapping[str, Floats]) -> None:
        """Choose scale and middle: the arena's, or those of a slowly adapting extent."""
        left, top, right, bottom = self.box
        if view.arena is not None:
            edges = np.array([view.arena.north, view.arena.east], float).T
            low, high = edges
            margin = 0.05 * (high - low).max()
            low, high = low - margin, high + margin
        else:
            # N and E of all objects, with a margin of a length around vehicles.
            around = np.array([(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)])
            things = [np.zeros((0, 2)), *(track[:, :2] for track in trails.values())]
            things += [np.array(v.eta[:2]) + 1.5 * v.length * around for v in view.vehicles]
            things += [np.array([t.position[:2]]) for t in view.targets]
            things += [np.array([g.position[:2]]) for g in view.goals]
            things += [np.array((o.x, o.y)) + o.r * around for o in view.obstacles]
            things += [] if view.path is None else [np.asarray(view.path, float)]
            points = np.concatenate(things)
            points = points[np.isfinite(points).all(axis=1)]
            low, high = self.extent.follow(points if len(points) else np.zeros((1, 2)))
        self.middle = 0.5 * (low + high)
        span = np.maximum(high - low, 1e-9)
        self.scale = float(min((bottom - top) / span[0], (right - left) / span[1]))

    def _lay_still(self, canvas: Canvas, view: View) -> None:
        """Draw the still layer; it is kept until scale, walls, obstacles or path change."""
        parts = [self.scale, *self.middle]
        if view.arena is not None:
            parts += [*view.arena.north, *view.arena.east]
        parts += [value for o in view.obstacles for value in (o.x, o.y, o.r)]
        key = np.array(parts).tobytes() + bytes([view.arena is not None])
        key += b"" if view.path is None else np.asarray(view.path).tobytes()
        if self._still is None or self._still[0] != key:
            still = canvas.copy()
            self._ground(still)
            with still.clipped(*self.box):
                self._walls_and_obstacles(still, view)
            self._scale_bar(still)
            self._still = (key, still)
        canvas.paste(self._still[1])

    def _ground(self, canvas: Canvas) -> None:
        left, top, right, bottom = self.box
        canvas.rectangle(left, top, right, bottom, palette.WATER)
        step = nice_step(4.5 * self.size / self.scale)
        span = 0.5 * np.array([bottom - top, right - left]) / self.scale
        small = max(self.size - 1.0, 10.0)
        for east in ticks(self.middle[1] - span[1], self.middle[1] + span[1], step):
            x = float(np.floor(self.at([0.0, east])[0]))
            canvas.rectangle(x, top, x + 1, bottom, palette.GRID)
            text = label(east, step)
            at = float(np.clip(x, left, right - 0.5 * text_width(text, small)))
            canvas.text((at, bottom + 0.5 * self.size), text, palette.MUTED, small, anchor=(0.5, 0))
        for north in ticks(self.middle[0] - span[0], self.middle[0] + span[0], step):
            y = float(np.floor(self.at([north, 0.0])[1]))
            canvas.rectangle(left, y, right, y + 1, palette.GRID)
            at = float(np.clip(y, top + 0.35 * self.size, bottom))
            where = (left - 0.4 * self.size, at)
            canvas.text(where, label(north, step), palette.MUTED, small, anchor=(1, 0.5))
        for x in (left, right - 1):
            canvas.rectangle(x, top, x + 1, bottom, palette.LINE)
        for y in (top, bottom - 1):
            canvas.rectangle(left, y, right, y + 1, palette.LINE)

    def _walls_and_obstacles(self, canvas: Canvas, view: View) -> None:
        if view.arena is not None:
            (south, north), (west, east) = view.arena.north, view.arena.east
            corners = self.at([(north, west), (north, east), (south, east), (south, west)])
            canvas.line(np.round(corners), palette.WALL, 0.25 * self.size, closed=True)
        if view.path is not None:
            dash = (0.6 * self.size, 0.5 * self.size)
            canvas.line(self.at(view.path), palette.PATH, 0.12 * self.size, dash=dash)
        for obstacle in view.obstacles:
            centre, radius = self.at((obstacle.x, obstacle.y)), obstacle.r * self.scale
            canvas.disc(centre, radius, palette.STONE)
            canvas.circle(centre, radius, palette.STONE_RIM, 0.13 * self.size)

    def _scale_bar(self, canvas: Canvas) -> None:
        left, _, _, bottom = self.box
        length = nice_step(4.0 * self.size / self.scale)
        text = f"{length:g} m" if length < 1e4 else f"{length / 1e3:g} km"
        x, y = left + self.size, bottom - self.size
        end, tick = x + length * self.scale, 0.35 * self.size
        back = (x - 5, y - 1.7 * self.size, end + 5, y + 5)
        canvas.rectangle(*back, palette.WATER, 0.85)
        line = [(x, y - tick), (x, y), (end, y), (end, y - tick)]
        canvas.line(np.floor(line) + 0.5, palette.INK, 1.2)
        where = (0.5 * (x + end), y - 0.5 * self.size)
        canvas.text(where, text, palette.INK, self.size, anchor=(0.5, 1))

    def _goals(self, canvas: Canvas, view: View) -> None:
        arm = 0.9 * self.size
        for goal in view.goals:
            x, y = centre = self.at(goal.position)
            canvas.circle(centre, 0.6 * self.size, palette.GOAL, 0.16 * self.size)
            canvas.line([(x - arm, y), (x + arm, y)], palette.GOAL, 1.2)
            canvas.line([(x, y - arm), (x, y + arm)], palette.GOAL, 1.2)
            if goal.psi is not None:
                ahead = np.array([np.sin(goal.psi), -np.cos(goal.psi)])
                tip = centre + 2.4 * self.size * ahead
                canvas.arrow(centre + 0.6 * self.size * ahead, tip, palette.GOAL, 1.5)

    def _targets(self, canvas: Canvas, view: View) -> None:
        for target in view.targets:
            centre = self.at(target.position)
            if target.reach is not None:
                radius = target.reach * self.scale
                canvas.disc(centre, radius, palette.TARGET, 0.05)
                canvas.circle(centre, radius, palette.TARGET, 1.2, 0.6, dash=(4, 4))
            if target.psi is not None:
                ahead = np.array([np.sin(target.psi), -np.cos(target.psi)])
                canvas.arrow(centre, centre + 1.9 * self.size * ahead, palette.TARGET, 1.5)
            canvas.disc(centre, 0.68 * self.size, palette.WATER)
            canvas.circle(centre, 0.58 * self.size, palette.TARGET, 0.18 * self.size)
            canvas.disc(centre, 0.26 * self.size, palette.TARGET)

    def _vehicles(self, canvas: Canvas, view: View, colours: Mapping[str, str]) -> None:
        seen = [v for v in view.vehicles if np.isfinite(v.eta).all()]
        occupied = [self.at(v.eta) for v in seen] + [self.at(t.position) for t in view.targets]
        reach = []
        for vehicle in seen:
            length, breadth = shown_size(vehicle, self.scale, self.size)
            outline = from_above(length, breadth, vehicle.eta[5]) + self.at(vehicle.eta)
            canvas.line(outline, palette.WATER, 0.4 * self.size, 0.9, closed=True)
            canvas.polygon(outline, colours[vehicle.name])
            canvas.line(outline, palette.INK, 1.0, 0.55, closed=True)
            reach.append(0.5 * max(length, breadth) + 0.35 * self.size)
        for vehicle, away in zip(seen, reach, strict=True):
            self._name(canvas, vehicle.name, self.at(vehicle.eta), away, occupied)

    def _name(
        self, canvas: Canvas, name: str, centre: Floats, away: float, occupied: list[Floats]
    ) -> None:
        """Write a name below its vehicle, or above, right, left, where it covers least."""
        wide, high = 0.5 * text_width(name, self.size), 0.5 * cap_height(self.size)
        left, top, right, bottom = self.box
        best: tuple[float, Floats] | None = None
        for dx, dy in ((0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)):
            middle = centre + np.array([dx * (away + wide), dy * (away + high)])
            covered = sum(
                bool(np.all(np.abs(other - middle) < (wide + self.size, high + self.size)))
                for other in occupied
                if other is not centre and np.hypot(*(other - centre)) > 1e-9
            )
            outside = not (
                left < middle[0] - wide and middle[0] + wide < right
                and top < middle[1] - high and middle[1] + high < bottom
            )  # fmt: skip
            cost = covered + 2.0 * outside
            if best is None or cost < best[0]:
                best = (cost, middle)
        if best is not None:
            occupied.append(best[1])
            where = (float(best[1][0]), float(best[1][1]))
            canvas.text(where, name, palette.INK, self.size, anchor=(0.5, 0.5))

    def _compass(self, canvas: Canvas, view: View) -> None:
        """Draw the north arrow and, beside it, where the current flows."""
        s = self.size
        _, top, right, _ = self.box
        x = right - 1.5 * s
        canvas.rectangle(x - 1.1 * s, top + 1, right - 1, top + 3.9 * s, palette.WATER, 0.8)
        canvas.text((x, top + 0.7 * s), "N", palette.INK, s, anchor=(0.5, 0))
        canvas.arrow((x, top + 3.5 * s), (x, top + 1.7 * s), palette.INK, 1.3, head=0.8 * s)
        if view.current is None or not np.isfinite(view.current).all():
            return
        north, east = view.current[:2]
        speed = float(np.hypot(north, east))
        middle = np.array([x - 3.4 * s, top + 1.7 * s])
        text = f"{speed:.2f} m/s"
        wide = 0.5 * text_width(text, s) + 4
        canvas.rectangle(
            middle[0] - wide, top + 1, middle[0] + wide, top + 3.9 * s, palette.WATER, 0.8
        )
        if speed > 1e-6:
            half = 1.15 * s * np.array([east, -north]) / speed
            canvas.arrow(middle - half, middle + half, palette.FLOW, 2.0, head=0.85 * s)
        where = (float(middle[0]), top + 3.5 * s)
        canvas.text(where, text, palette.MUTED, s, anchor=(0.5, 1))
