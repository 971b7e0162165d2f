"""Volume, centre, second moments, areas and strips of a closed surface of triangles.

Integrals over the solid become sums over tetrahedra between the origin and each triangle, exact
for the mesh (Eberly 2002, Polyhedral Mass Properties, gives the same sums as polynomials).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.shapes.mesh import Mesh

__all__ = ["Solid", "silhouette", "solid_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Solid:
    """Volume [m3], centre [m], second moments about it (3, 3) [m5], box, areas seen [m2]."""

    volume: float
    centre: Array
    second: Array  # ∫ x x' dV about the centre
    low: Array
    high: Array
    areas: Array  # projected along x, y and z
    surface: float

    @property
    def extent(self) -> Array:
        """Return length, breadth and height [m]."""
        return self.high - self.low

    def inertia(self, m: float) -> Array:
        """Return the inertia (3, 3) [kg.m2] about the centre of mass m [kg], spread evenly."""
        spread = self.second * (m / self.volume)
        inertia: Array = np.trace(spread) * np.eye(3) - spread
        return inertia


def solid_of(mesh: Mesh) -> Solid:
    """Integrate over the solid within a mesh."""
    t = mesh.triangles
    low, high = t.reshape(-1, 3).min(axis=0), t.reshape(-1, 3).max(axis=0)
    middle = 0.5 * (low + high)
    s = t - middle
    six = np.einsum("ni,ni->n", s[:, 0], np.cross(s[:, 1], s[:, 2]))
    volume = float(six.sum() / 6.0)
    centre = np.einsum("n,nki->i", six, s) / 24.0 / volume
    total = s.sum(axis=1)
    second = (
        np.einsum("n,nki,nkj->ij", six, s, s) + np.einsum("n,ni,nj->ij", six, total, total)
    ) / 120.0
    second -= volume * np.outer(centre, centre)
    areas = []
    for axis in range(3):
        along, across = (a for a in range(3) if a != axis)
        at, widths = silhouette(t, along, across)
        areas.append(float(widths.sum() * (at[1] - at[0])))
    normals = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    return Solid(
        volume,
        centre + middle,
        second,
        low,
        high,
        np.array(areas),
        float(0.5 * np.linalg.norm(normals, axis=1).sum()),
    )


def silhouette(triangles: Array, along: int, across: int, n: int = 400) -> tuple[Array, Array]:
    """Return n places along an axis and what the shadow covers there across the other, [m] both.

    The shadow is that of light along the third axis; overlapping parts count once.
    """
    a, b = triangles[:, :, along], triangles[:, :, across]
    low, high = float(a.min()), float(a.max())
    at = low + (np.arange(n) + 0.5) * (high - low) / n
    first, last = a.min(axis=1), a.max(axis=1)
    widths = np.zeros(n)
    for k, place in enumerate(at):
        cut = (first <= place) & (last > place)
        x, y = a[cut], b[cut]
        lows, highs = np.full(len(x), np.inf), np.full(len(x), -np.inf)
        for i, j in ((0, 1), (1, 2), (2, 0)):
            crosses = (x[:, i] <= place) != (x[:, j] <= place)
            step = np.where(crosses, x[:, j] - x[:, i], 1.0)
            value = y[:, i] + (place - x[:, i]) / step * (y[:, j] - y[:, i])
            lows = np.where(crosses, np.minimum(lows, value), lows)
            highs = np.where(crosses, np.maximum(highs, value), highs)
        if len(lows):  # the length of the union of the intervals
            order = np.argsort(lows)
            lows, highs = lows[order], highs[order]
            reached = np.maximum.accumulate(highs)
            gaps = np.maximum(lows[1:] - reached[:-1], 0.0)
            widths[k] = reached[-1] - lows[0] - gaps.sum()
    return at, widths
