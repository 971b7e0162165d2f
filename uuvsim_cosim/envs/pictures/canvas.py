"""An antialiased RGB canvas in numpy: polygons, lines, discs, arrows, text, with alpha.

x is right and y down, in pixels; (0, 0) is the upper left corner.  Colours are "#rrggbb".
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.envs.pictures.canvas_coverage import (
    Box,
    Floats,
    dashes,
    disc_coverage,
    polygon_coverage,
    segments_coverage,
)
from uuvsim_cosim.envs.pictures.canvas_font import cap_height, text_mask, text_width
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Canvas", "rgb"]


@lru_cache(maxsize=256)
def rgb(colour: str) -> tuple[float, float, float]:
    """Return red, green, blue of "#rrggbb", 0 to 255."""
    if not isinstance(colour, str) or not re.fullmatch(r"#[0-9a-fA-F]{6}", colour):
        raise InputInvalid(f'colour: {colour!r}; expected "#rrggbb", such as "#1268b3"')
    return int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16)


class Canvas:
    """A picture to draw on; pixels outside of it, or of `clipped`, are not drawn."""

    def __init__(self, width: int, height: int, background: str = "#ffffff") -> None:
        if width < 1 or height < 1:
            raise InputInvalid("canvas", f"{width} x {height} pixels", "at least 1 x 1")
        self.width, self.height = width, height
        self._values = np.empty((height, width, 3), np.float32)
        self._values[:] = _row(background)
        self._cover = np.zeros(height * width)
        self._box: Box = (0, 0, width, height)

    def copy(self) -> Canvas:
        """Return a canvas with the same picture."""
        other = Canvas(self.width, self.height)
        other._values[:] = self._values
        return other

    def paste(self, other: Canvas) -> None:
        """Take over the picture of a canvas of the same size."""
        self._values[:] = other._values

    def place(self, left: int, top: int, picture: NDArray[np.uint8], alpha: float = 1.0) -> None:
        """Lay a picture (height, width, 3) over this one; the part outside is not drawn."""
        height, width = picture.shape[:2]
        x, y = max(left, 0), max(top, 0)
        under = self._values[y : max(top + height, 0), x : max(left + width, 0)]
        rows, columns = under.shape[:2]
        over = picture[y - top : y - top + rows, x - left : x - left + columns]
        under += np.float32(alpha) * (over - under)

    def pixels(self) -> NDArray[np.uint8]:
        """Return the picture (height, width, 3), a new array."""
        return (self._values + np.float32(0.5)).astype(np.uint8)

    @contextmanager
    def clipped(self, left: float, top: float, right: float, bottom: float) -> Iterator[None]:
        """Draw only inside a rectangle, rounded to whole pixels."""
        before = self._box
        corner = np.clip(np.round([left, top, right, bottom]), np.tile(before[:2], 2),
                         np.tile(before[2:], 2)).astype(int)  # fmt: skip
        self._box = (int(corner[0]), int(corner[1]), int(corner[2]), int(corner[3]))
        try:
            yield
        finally:
            self._box = before

    def polygon(self, points: ArrayLike, colour: str, alpha: float = 1.0) -> None:
        """Fill a polygon (n, 2), convex or not; nothing if a corner is not finite."""
        corners = np.asarray(points, float)
        if np.isfinite(corners).all():
            self._blend(*polygon_coverage(corners, self._box), colour, alpha)

    def rectangle(
        self, left: float, top: float, right: float, bottom: float, colour: str, alpha: float = 1.0
    ) -> None:
        """Fill a rectangle, its edges rounded to whole pixels; at least one pixel each way."""
        x, y = round(left), round(top)
        low_x, high_x = max(x, self._box[0]), min(max(round(right), x + 1), self._box[2])
        low_y, high_y = max(y, self._box[1]), min(max(round(bottom), y + 1), self._box[3])
        if low_x < high_x and low_y < high_y:
            under = self._values[low_y:high_y, low_x:high_x]
            under += np.float32(alpha) * (_row(colour) - under)

    def line(
        self,
        points: ArrayLike,
        colour: str,
        width: float = 1.0,
        alpha: float | Floats = 1.0,
        *,
        closed: bool = False,
        dash: tuple[float, float] | None = None,
    ) -> None:
        """Draw a polyline (n, 2) with round joints; it is broken where a point is not finite.

        `alpha` may be one for each segment, so that a trail fades; `dash` is on and off [px].
        """
        corners = np.asarray(points, float).reshape(-1, 2)
        if closed:
            corners = np.concatenate([corners, corners[:1]])
        start, end = (corners[:-1], corners[1:]) if dash is None else dashes(corners, *dash)
        if not len(start):
            return
        weight = np.broadcast_to(np.asarray(alpha, float), len(start))
        rows, columns, cover = segments_coverage(start, end, width, weight, self._box)
        index = rows * self.width + columns
        np.maximum.at(self._cover, index, cover)
        cover = self._cover[index]
        self._cover[index] = 0.0
        values = self._values.reshape(-1, 3)
        under = values[index]  # a pixel that comes twice is read before it is written: same value
        values[index] = under + cover[:, None].astype(np.float32) * (_row(colour) - under)

    def disc(self, centre: ArrayLike, radius: float, colour: str, alpha: float = 1.0) -> None:
        """Fill a disc."""
        middle = np.asarray(centre, float)
        if np.isfinite(middle).all() and np.isfinite(radius):
            self._blend(*disc_coverage(middle, radius, self._box), colour, alpha)

    def circle(
        self,
        centre: ArrayLike,
        radius: float,
        colour: str,
        width: float = 1.0,
        alpha: float = 1.0,
        *,
        dash: tuple[float, float] | None = None,
    ) -> None:
        """Draw the outline of a disc."""
        corners = int(np.clip(3.0 * np.sqrt(abs(radius)) + 8.0, 12, 180))
        angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)
        ring = np.asarray(centre, float) + radius * np.column_stack([np.cos(angle), np.sin(angle)])
        self.line(ring, colour, width, alpha, dash=dash)

    def arrow(
        self,
        start: ArrayLike,
        end: ArrayLike,
        colour: str,
        width: float = 1.5,
        alpha: float = 1.0,
        *,
        head: float | None = None,
    ) -> None:
        """Draw an arrow; its head is `head` long, never longer than the arrow."""
        tail, tip = np.asarray(start, float), np.asarray(end, float)
        length = float(np.hypot(*(tip - tail)))
        if not 0.0 < length < np.inf:
            return
        ahead = (tip - tail) / length
        aside = np.array([-ahead[1], ahead[0]])
        size = min(3.0 * width + 3.0 if head is None else head, length)
        neck = tip - size * ahead
        self.line([tail, neck], colour, width, alpha)
        self.polygon([tip, neck + 0.45 * size * aside, neck - 0.45 * size * aside], colour, alpha)

    def text(
        self,
        at: tuple[float, float],
        text: str,
        colour: str,
        size: float = 10.0,
        alpha: float = 1.0,
        *,
        anchor: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Write one line; `anchor` is the point of the text that is placed at `at`.

        (0, 0) is the upper left of its capitals, (1, 1) the right end of its baseline.
        """
        mask = text_mask(text, size)
        left = round(at[0] - anchor[0] * text_width(text, size))
        top = round(at[1] - anchor[1] * cap_height(size))
        box = (left, top, left + mask.shape[1], top + mask.shape[0])
        inner = (
            max(box[0], self._box[0]), max(box[1], self._box[1]),
            min(box[2], self._box[2]), min(box[3], self._box[3]),
        )  # fmt: skip
        if inner[0] < inner[2] and inner[1] < inner[3]:
            seen = mask[inner[1] - top : inner[3] - top, inner[0] - left : inner[2] - left]
            self._blend(inner, seen, colour, alpha)

    def shade(self, left: int, top: int, right: int, bottom: int, upper: str, lower: str) -> None:
        """Fill whole pixels with a colour that turns from `upper` into `lower`."""
        share = np.linspace(0.0, 1.0, max(bottom - top, 1), dtype=np.float32)[:, None, None]
        self._values[top:bottom, left:right] = _row(upper) * (1.0 - share) + _row(lower) * share

    def _blend(self, box: Box, cover: Floats, colour: str, alpha: float) -> None:
        if cover.size:
            under = self._values[box[1] : box[3], box[0] : box[2]]
            under += (alpha * cover).astype(np.float32)[:, :, None] * (_row(colour) - under)


def _row(colour: str) -> NDArray[np.float32]:
    return np.array(rgb(colour), np.float32)
