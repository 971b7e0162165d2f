"""How much of each pixel a shape covers: exact areas of polygons, distances to lines and discs.

Pixel (row i, column j) is the unit square from (x, y) = (j, i) to (j + 1, i + 1), y down.  A box is
(left, top, right, bottom) in whole pixels; what lies outside of it is never computed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["Box", "Floats", "dashes", "disc_coverage", "polygon_coverage", "segments_coverage"]

Floats = NDArray[np.float64]
Box = tuple[int, int, int, int]

PIECE = (
    8.0  # greatest length of the pieces that a line is cut into [px]; sets the work, not the result
)


def box_of(points: Floats, margin: float, box: Box) -> Box:
    """Return the whole-pixel box around the points, cut to `box`; empty if right <= left."""
    low, high = points.min(axis=0) - margin, points.max(axis=0) + margin
    left, top = np.clip(np.floor(low), box[:2], box[2:]).astype(int)
    right, bottom = np.clip(np.ceil(high), box[:2], box[2:]).astype(int)
    return int(left), int(top), int(right), int(bottom)


def polygon_coverage(points: Floats, box: Box) -> tuple[Box, Floats]:
    """Return the covered area of each pixel for a filled polygon (n, 2), convex or not.

    An edge's piece within one row covers, of each pixel, the part to its right; the sum over edges,
    signed by direction, is the area: no samples, so no steps on slanted edges.
    """
    left, top, right, bottom = inner = box_of(points, 0.0, box)
    cover = np.zeros((max(bottom - top, 0), max(right - left, 0)))
    if not cover.size:
        return inner, cover
    x0, y0 = points.T
    x1, y1 = np.roll(points, -1, axis=0).T
    row = np.arange(top, bottom)[:, None]
    y_a, y_b = np.clip(y0, row, row + 1), np.clip(y1, row, row + 1)
    i, edge = np.nonzero(y_a != y_b)
    if not i.size:
        return inner, cover
    y_a, y_b = y_a[i, edge], y_b[i, edge]
    slope = (x1 - x0)[edge] / (y1 - y0)[edge]
    right_ends = np.arange(left, right) + 1.0
    t_a = right_ends - (x0[edge] + (y_a - y0[edge]) * slope)[:, None]
    t_b = right_ends - (x0[edge] + (y_b - y0[edge]) * slope)[:, None]
    span = t_b - t_a
    upright = np.abs(span) < 1e-6
    mean = np.where(
        upright,
        np.clip(t_a, 0.0, 1.0),
        (_ramp_integral(t_b) - _ramp_integral(t_a)) / np.where(upright, 1.0, span),
    )
    rows, starts = np.unique(i, return_index=True)
    cover[rows] = np.add.reduceat((y_b - y_a)[:, None] * mean, starts, axis=0)
    return inner, np.minimum(np.abs(cover), 1.0)


def _ramp_integral(t: Floats) -> Floats:
    """Integrate clip(t, 0, 1) from minus infinity to t."""
    ramp: Floats = 0.5 * np.clip(t, 0.0, 1.0) ** 2 + np.maximum(t - 1.0, 0.0)
    return ramp


def disc_coverage(centre: Floats, radius: float, box: Box) -> tuple[Box, Floats]:
    """Return the coverage of each pixel for a disc, from the distance of its middle to the rim."""
    left, top, right, bottom = inner = box_of(centre[None, :], radius + 0.5, box)
    dx = np.arange(left, right) + 0.5 - centre[0]
    dy = np.arange(top, bottom) + 0.5 - centre[1]
    return inner, np.clip(radius + 0.5 - np.hypot(dx[None, :], dy[:, None]), 0.0, 1.0)


def segments_coverage(
    start: Floats, end: Floats, width: float, weight: Floats, box: Box
) -> tuple[NDArray[np.intp], NDArray[np.intp], Floats]:
    """Return (rows, columns, coverage) of round-ended segments; a pixel may come more than once.

    `weight` is one factor a segment.  Pieces of a segment cover together what the segment covers,
    so that all are cut into short ones of equal box and computed at once.
    """
    reach = 0.5 * max(width, 1.0) + 0.5
    start, end, weight = _cut_to_box(start, end, weight, reach, box)
    length = np.hypot(*(end - start).T)
    piece = min(max(PIECE, width), float(length.max(initial=0.0)) + 1e-6)
    count = np.maximum(np.ceil(length / piece), 1.0).astype(int)
    of = np.repeat(np.arange(len(count)), count)
    k = np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    along = (end - start)[of] / count[of, None]
    begin = start[of] + along * k[:, None]
    origin = np.floor(np.minimum(begin, begin + along) - reach)
    steps = np.arange(int(np.ceil(piece + 2.0 * reach)) + 1)
    dx = (origin[:, 0:1] + 0.5 - begin[:, 0:1] + steps)[:, None, :]
    dy = (origin[:, 1:2] + 0.5 - begin[:, 1:2] + steps)[:, :, None]
    ax, ay = along[:, 0, None, None], along[:, 1, None, None]
    t = np.clip((dx * ax + dy * ay) / np.maximum(ax * ax + ay * ay, 1e-12), 0.0, 1.0)
    cover = np.clip(reach - np.hypot(dx - t * ax, dy - t * ay), 0.0, 1.0)
    cover *= weight[of, None, None] * min(width, 1.0)
    piece_of, row, column = np.nonzero(cover)
    rows = origin[piece_of, 1].astype(np.intp) + row
    columns = origin[piece_of, 0].astype(np.intp) + column
    left, top, right, bottom = box
    seen = (columns >= left) & (columns < right) & (rows >= top) & (rows < bottom)
    return rows[seen], columns[seen], cover[piece_of, row, column][seen]


def _cut_to_box(
    start: Floats, end: Floats, weight: Floats, reach: float, box: Box
) -> tuple[Floats, Floats, Floats]:
    """Cut segments to the box widened by `reach` (Liang and Barsky); drop those outside or NaN."""
    finite = np.isfinite(start).all(axis=1) & np.isfinite(end).all(axis=1)
    start, end, weight = start[finite], end[finite], weight[finite]
    low, high = np.array(box[:2]) - reach, np.array(box[2:]) + reach
    along = end - start
    still = along == 0.0
    safe = np.where(still, 1.0, along)
    inside = (start >= low) & (start <= high)
    t_low = np.where(still, np.where(inside, 0.0, 2.0), (low - start) / safe)
    t_high = np.where(still, np.where(inside, 1.0, -1.0), (high - start) / safe)
    enter = np.maximum(np.minimum(t_low, t_high).max(axis=1), 0.0)
    leave = np.minimum(np.maximum(t_low, t_high).min(axis=1), 1.0)
    enter = np.where((still & ~inside).any(axis=1), 2.0, enter)
    kept = enter <= leave
    enter, leave = enter[kept, None], leave[kept, None]
    start, along = start[kept], along[kept]
    return start + along * enter, start + along * leave, weight[kept]


def dashes(points: Floats, on: float, off: float) -> tuple[Floats, Floats]:
    """Return starts and ends of the dashes along a polyline (n, 2), `on` and `off` long [px]."""
    points = points[np.isfinite(points).all(axis=1)]
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    period = on + off
    if len(points) < 2 or arc[-1] / period > 10_000:  # too far out of the picture to be seen dashed
        return points[:-1], points[1:]
    first = np.arange(0.0, arc[-1], period)
    cuts = np.unique(np.concatenate([arc, first, np.minimum(first + on, arc[-1])]))
    at = np.column_stack([np.interp(cuts, arc, points[:, i]) for i in (0, 1)])
    drawn = np.mod(0.5 * (cuts[:-1] + cuts[1:]), period) < on
    return at[:-1][drawn], at[1:][drawn]
