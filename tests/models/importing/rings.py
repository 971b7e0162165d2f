"""Added mass across the axis of a body of revolution, by rings of sources: another method.

A body of revolution about x that moves along y in an ideal fluid has sources sigma(s) cos(phi) on
its meridian s. The potential of a ring of radius a at x = b, at radius r and axial place x, is

    G cos(phi),   G = 2 / sqrt(r a) Q(chi),   chi = 1 + ((r - a)² + (x - b)²) / (2 r a),

with Legendre's function Q of the second kind and degree 1/2, which is a sum of complete elliptic
integrals. Collocation of  -2 pi sigma + integral of dG/dn a sigma ds = n_r  on straight segments,
which are shorter towards edges, gives sigma, and the added mass is  -pi integral of G sigma n_r r.
No mesh, symmetry or library is shared with the panel method.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import ellipe, ellipkm1

__all__ = ["across", "graded_meridian"]

Array = NDArray[np.float64]
NODES, WEIGHTS = leggauss(12)


def across(meridian: Array) -> float:
    """Return the added mass across the axis, for density 1, of a `meridian` (n + 1, 2) of (x, r).

    x rises along the meridian, or r where x stays, and both ends are on the axis.
    """
    start, step = meridian[:-1], np.diff(meridian, axis=0)
    length = np.hypot(*step.T)
    tangent = step / length[:, None]
    normal = np.stack([-tangent[:, 1], tangent[:, 0]], axis=1)  # outwards
    middle = start + 0.5 * step
    n = len(length)
    potential, slope = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n):
        nearest = np.clip(np.sum((middle[i] - start) * tangent, axis=1), 0.0, length)
        away = np.hypot(*(middle[i] - start - nearest[:, None] * tangent).T)
        for j in range(n):
            s, w = _nodes(length[j], nearest[j], away[j])
            ring = start[j] + s[:, None] * tangent[j]
            G, dG = _ring(middle[i], normal[i], ring, i == j)
            potential[i, j] = np.sum(w * ring[:, 1] * G)
            slope[i, j] = np.sum(w * ring[:, 1] * dG)
    sources = np.linalg.solve(slope - 2.0 * np.pi * np.eye(n), normal[:, 1])
    return float(-np.pi * np.sum(potential @ sources * normal[:, 1] * middle[:, 1] * length))


def graded_meridian(corners: Sequence[tuple[float, float]], cuts: int, largest: float) -> Array:
    """Return a meridian through corners (x, r) whose segments halve `cuts` times towards each.

    No segment is longer than `largest`.
    """
    half = 0.5 * np.concatenate([[0.0], 0.5 ** np.arange(cuts, -1.0, -1.0)])
    shares = np.concatenate([half, 1.0 - half[-2::-1]])
    points = [np.array(corners[0])]
    for a, b in pairwise(map(np.array, corners)):
        for first, last in pairwise(shares):
            parts = int(np.ceil((last - first) * np.hypot(*(b - a)) / largest))
            places = first + (last - first) * np.arange(1, parts + 1) / parts
            points += [a + place * (b - a) for place in places]
    return np.array(points)


def _nodes(length: float, nearest: float, away: float) -> tuple[Array, Array]:
    """Return Gauss' nodes and weights on a segment, in parts that halve towards `nearest`."""
    cuts = {0.0, length, nearest}
    part = 0.5 * length
    while part > max(0.5 * away, 1e-9 * length):
        cuts |= {c for c in (nearest - part, nearest + part) if 0.0 < c < length}
        part *= 0.5
    ends = np.array(sorted(cuts))
    width = np.diff(ends)[:, None]
    return (ends[:-1, None] + 0.5 * width * (NODES + 1.0)).ravel(), (0.5 * width * WEIGHTS).ravel()


def _ring(at: Array, normal: Array, ring: Array, own: bool) -> tuple[Array, Array]:
    """Return G and dG/dn at a point (x, r) of rings (m, 2); `own`: they are on its segment."""
    r, a, apart = at[1], ring[:, 1], at - ring
    e = np.sum(apart**2, axis=1) / (2.0 * r * a)  # chi - 1, without loss of digits
    k = np.sqrt(2.0 / (2.0 + e))
    K, E = ellipkm1(e / (2.0 + e)), ellipe(k * k)
    root = np.sqrt(2.0 * (2.0 + e)) * E
    Q, dQ = (1.0 + e) * k * K - root, 0.5 * (k * K - (1.0 + e) * root / (e * (2.0 + e)))
    far = e > 1e3  # the terms above cancel there
    chi = np.where(far, 1.0 + e, 1.0)
    Q = np.where(far, 0.5 * np.pi * (2.0 * chi) ** -1.5, Q)
    dQ = np.where(far, -1.5 * Q / chi, dQ)
    f = 2.0 / np.sqrt(r * a)
    along = np.zeros(len(a)) if own else apart @ normal
    return f * Q, f * dQ * (along / (r * a) - normal[1] * e / r) - 0.5 * f * Q * normal[1] / r
