"""Rays in a scene and depths in its seabed by brute force in numpy, as CasADi's evaluation uses.

Slow and plain: every triangle of the cells within a ray's bounding rectangle is tried, every solid,
and every triangle of a mesh. The C in fmus/runtime/worlds/uuv_cast.h and uuv_touch.h agrees to
rounding, and is independent of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.worlds.ground import Ground

__all__ = ["bed_depth", "first_hit"]

Array = NDArray[np.float64]
Hit = tuple[float, Array]  # range, outward unit normal
Row = NDArray[np.float64]  # of a solid: Ground.solids


def first_hit(g: Ground, moving: Array, o: Array, d: Array, far: float) -> tuple[int, Hit]:
    """Return the kind (uuv_hit_kind) of what a ray meets first, its range and its normal.

    `moving` holds rows of solids. Kind 0, and the range `far`, where nothing is met.
    """
    best: tuple[int, Hit] = (0, (far, np.zeros(3)))
    found = [*_seabed(g, o, d)]
    if d[2] != 0.0:
        found.append((3, (-o[2] / d[2], np.array([0.0, 0.0, np.sign(o[2]) or -1.0]))))
    n_meshes = len(g.surfaces.first) - 1
    for i, row in enumerate(g.solids):
        found += [(4 + i, hit) for hit in _solid(row, o, d)]
    for k, (t, n) in _crossed(g.surfaces.triangles, o, d):  # their normals are against the ray
        mesh = int(np.searchsorted(g.surfaces.first, k, side="right")) - 1
        found.append((4 + len(g.solids) + mesh, (t, -n if n @ d > 0.0 else n)))
    for i, row in enumerate(moving, len(g.solids) + n_meshes):
        found += [(4 + i, hit) for hit in _solid(row, o, d)]
    for kind, (t, n) in found:
        if 0.0 <= t < best[1][0]:
            best = (kind, (float(t), n))
    return best


def _triangles(g: Ground, low: Array, high: Array) -> Array:
    """Return the corners (n, 3, 3) of the triangles of the cells within a rectangle of N, E."""
    rows, columns = g.z.shape
    if rows < 2:
        return np.zeros((0, 3, 3))
    first = np.clip(np.floor((low - g.origin) / g.spacing), 0, [rows - 2, columns - 2]).astype(int)
    last = np.clip(np.floor((high - g.origin) / g.spacing), 0, [rows - 2, columns - 2]).astype(int)
    i, j = (a.ravel() for a in np.meshgrid(*map(np.arange, first, last + 1), indexing="ij"))

    def node(a: NDArray[np.int_], b: NDArray[np.int_]) -> Array:
        return np.stack(
            [g.origin[0] + a * g.spacing, g.origin[1] + b * g.spacing, g.z[a, b].astype(float)], 1
        )

    near, far = node(i, j), node(i + 1, j + 1)
    both = [np.stack([near, third, far], 1) for third in (node(i + 1, j), node(i, j + 1))]
    every = np.concatenate(both)
    return np.asarray(every[~np.isnan(every[:, :, 2]).any(axis=1)])


def _seabed(g: Ground, o: Array, d: Array) -> Iterator[tuple[int, Hit]]:
    if not g.z.size or not np.any(d):
        return
    reach = [0.0, 0.0]  # where the ray leaves the layer that holds the terrain
    span = (g.low - 1.0, g.high + 1.0)
    if d[2] != 0.0:
        reach = sorted(max(0.0, (z - o[2]) / d[2]) for z in span)
    elif span[0] <= o[2] <= span[1]:
        extent = g.spacing * max(g.z.shape) + np.hypot(*(o[:2] - g.origin))
        reach = [0.0, 2.0 * extent / np.hypot(*d[:2])]
    ends = np.array([o[:2] + t * d[:2] for t in reach])
    corners = _triangles(g, ends.min(axis=0), ends.max(axis=0))
    for _, (t, normal) in _crossed(corners, o, d):
        normal *= -np.sign(normal[2])  # up
        yield (1 if normal @ d < 0.0 else 2), (t, normal)


def _crossed(corners: Array, o: Array, d: Array) -> Iterator[tuple[int, Hit]]:
    """Yield the triangles (n, 3, 3) that a ray crosses, where, and their normals."""
    if not len(corners) or not np.any(d):
        return
    a, u, v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    n = np.cross(u, v)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ij,ij->i", n, a - o) / (n @ d)
        p = o + t[:, None] * d - a
        uu, uv, vv = (np.einsum("ij,ij->i", x, y) for x, y in ((u, u), (u, v), (v, v)))
        pu, pv = np.einsum("ij,ij->i", p, u), np.einsum("ij,ij->i", p, v)
        whole = uu * vv - uv * uv
        s, r = (vv * pu - uv * pv) / whole, (uu * pv - uv * pu) / whole
        on = (s >= -1e-12) & (r >= -1e-12) & (s + r <= 1.0 + 1e-12) & (t >= 0.0)
    for k in np.flatnonzero(on):
        yield int(k), (t[k], n[k] / np.linalg.norm(n[k]))


def _solid(row: Row, o: Array, d: Array) -> Iterator[Hit]:
    """Yield every place where a line crosses the surface of a solid."""
    kind, p, size = int(row[0]), o - row[1:4], row[4:9]
    if kind == 1:
        yield from _balls(p, d, size[0])
    elif kind == 2:
        e = size[:3]
        for end in (-1.0, 1.0):
            for t, n in _balls(p - end * e, d, size[3]):
                if end * (n @ e) >= 0.0:
                    yield t, n
        if e @ e > 0.0:
            axis = e / np.linalg.norm(e)
            q, v = p - (p @ axis) * axis, d - (d @ axis) * axis
            for t, n in _balls(q, v, size[3]):
                if abs((p + t * d) @ e) <= e @ e:
                    yield t, n
    elif kind == 3:
        flat = np.array([1.0, 1.0, 0.0])
        for t, n in _balls(p * flat, d * flat, size[0]):
            if abs(p[2] + t * d[2]) <= size[1]:
                yield t, n
        for side in (-1.0, 1.0):
            t = (side * size[1] - p[2]) / d[2] if d[2] else -1.0
            if np.hypot(*(p + t * d)[:2]) <= size[0]:
                yield t, np.array([0.0, 0.0, side])
    else:
        turn = np.array([[size[3], size[4], 0], [-size[4], size[3], 0], [0, 0, 1]])
        at, to = turn @ p, turn @ d
        for k in range(3):
            for side in (-1.0, 1.0):
                t = (side * size[k] - at[k]) / to[k] if to[k] else -1.0
                others = [m for m in range(3) if m != k]
                if all(abs((at + t * to)[m]) <= size[m] for m in others):
                    yield t, side * turn[k]


def _balls(p: Array, d: Array, radius: float) -> Iterator[Hit]:
    a, b, c = d @ d, p @ d, p @ p - radius * radius
    if a > 0.0 and b * b >= a * c:
        for side in (-1.0, 1.0):
            t = float(-b + side * np.sqrt(b * b - a * c)) / float(a)
            yield t, (p + t * d) / radius


def bed_depth(g: Ground, p: Array, reach: float) -> tuple[float, Array] | None:
    """Return the depth of p in the seabed and the normal outwards; None farther than `reach` off.

    Below the seabed, its nearest point is sought within the height above p, at most two cells.
    """
    below = [t for _, (t, _) in _seabed(g, np.array([*p[:2], g.low - 2.0]), np.array([0, 0, 1.0]))]
    if not below or not g.z.size:
        return None
    gap = p[2] - (g.low - 2.0 + min(below))
    most = min(gap, 2.0 * g.spacing) if gap > 0.0 else reach
    corners = _triangles(g, p[:2] - most, p[:2] + most)
    nearest = min((_nearest(p, c) for c in corners), key=lambda q: float(np.sum((p - q) ** 2)))
    d = np.copysign(np.linalg.norm(p - nearest), gap)
    return (float(d), (nearest - p) / d) if gap > 0.0 or -d < reach else None


def _nearest(p: Array, corners: Array) -> Array:
    a, u, v = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    s, t = np.linalg.lstsq(np.column_stack([u, v]), p - a, rcond=None)[0]
    if s >= 0.0 and t >= 0.0 and s + t <= 1.0:
        return np.asarray(a + s * u + t * v)
    ends = [(corners[k], corners[(k + 1) % 3]) for k in range(3)]
    on = [b + np.clip((p - b) @ (c - b) / ((c - b) @ (c - b)), 0.0, 1.0) * (c - b) for b, c in ends]
    return np.asarray(min(on, key=lambda q: float(np.sum((p - q) ** 2))))
