"""Closed surfaces of the parts that hulls are made of: bodies of revolution, boxes, plates, blades.

Each function returns a shell: vertices (n, 3) [m] in the axes of the body (FRD) and triangles
(m, 3), anticlockwise seen from outside. A shell is closed: each edge belongs to two triangles,
which run along it in opposite directions. All are deterministic; nothing is drawn at random.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import acos, atan, cos, pi, radians, sin, sqrt, tan

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Shell",
    "box",
    "ellipsoid",
    "enclosed_volume",
    "fin",
    "joined",
    "myring",
    "myring_profile",
    "plate",
    "propeller",
    "thruster",
    "tube",
    "turned",
]

Array = NDArray[np.float64]
Shell = tuple[Array, NDArray[np.int64]]
Points = Sequence[Sequence[float]]
Vector = Sequence[float] | Array
AROUND = 24  # corners of a round section


def _shell(vertices: Array, faces: NDArray[np.int64] | list[list[int]]) -> Shell:
    """Return a shell whose enclosed volume is positive: one that is inside out is turned."""
    f = np.asarray(faces, np.int64).reshape(-1, 3)
    v = np.asarray(vertices, float)
    t = v[f] - v.mean(axis=0)
    six = float(np.einsum("ni,ni->", t[:, 0], np.cross(t[:, 1], t[:, 2])))
    return v, f if six > 0 else f[:, ::-1].copy()


def joined(shells: Sequence[Shell]) -> Shell:
    """Return several shells as one list of vertices and triangles."""
    first = np.cumsum([0, *(len(v) for v, _ in shells)])
    return (
        np.concatenate([v for v, _ in shells]),
        np.concatenate([f + k for (_, f), k in zip(shells, first, strict=False)]),
    )


def _across(e: Array) -> tuple[Array, Array]:
    """Return unit vectors u, v with u x v = e."""
    u = np.cross(e, np.eye(3)[int(np.argmin(np.abs(e)))])
    u /= np.linalg.norm(u)
    return u, np.cross(e, u)


def _lofted(rings: Array) -> Shell:
    """Return the body through k rings of n corners (k, n, 3), its first and last one capped."""
    k, n, _ = rings.shape
    i, j = (a.ravel() for a in np.meshgrid(np.arange(k - 1), np.arange(n), indexing="ij"))
    a, b = i * n + j, i * n + (j + 1) % n
    sides = np.concatenate([np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)])
    fan = np.arange(1, n - 1)
    low = np.stack([np.zeros_like(fan), fan + 1, fan], 1)
    high = np.stack([np.zeros_like(fan), fan, fan + 1], 1) + (k - 1) * n
    return _shell(rings.reshape(-1, 3), np.concatenate([sides, low, high]))


def turned(
    profile: Points, at: Vector = (0, 0, 0), axis: Vector = (1, 0, 0),
    around: int = AROUND, *, ring: bool = False,
) -> Shell:  # fmt: skip
    """Turn a profile of (place along the axis, radius) about `axis` through `at`.

    Its ends are closed by flat discs where their radius is not 0. With `ring`, the profile is a
    closed loop beside the axis, as the section of a duct is.
    """
    e = np.asarray(axis, float) / np.linalg.norm(axis)
    u, v = _across(e)
    angle = np.arange(around) * (2.0 * pi / around)
    circle = np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v
    rows: list[Array] = []
    for x, r in profile:
        rows.append((np.zeros((1, 3)) if r <= 0.0 else r * circle) + x * e)
    if not ring:  # discs
        if len(rows[0]) > 1:
            rows.insert(0, np.array([profile[0][0] * e]))
        if len(rows[-1]) > 1:
            rows.append(np.array([profile[-1][0] * e]))
    first = np.cumsum([0, *(len(row) for row in rows)])
    faces: list[list[int]] = []
    pairs = list(zip(range(len(rows)), range(1, len(rows)), strict=False))
    for i, k in [*pairs, *([(len(rows) - 1, 0)] if ring else [])]:
        for j in range(around):
            at_i = [first[i] + (m % around if len(rows[i]) > 1 else 0) for m in (j, j + 1)]
            at_k = [first[k] + (m % around if len(rows[k]) > 1 else 0) for m in (j, j + 1)]
            if at_i[0] != at_i[1]:
                faces.append([at_i[0], at_i[1], at_k[1]])
            if at_k[0] != at_k[1]:
                faces.append([at_i[0], at_k[1], at_k[0]])
    return _shell(np.concatenate(rows) + np.asarray(at, float), faces)


def tube(
    start: Sequence[float], end: Sequence[float], radius: float, dome: Sequence[float] = (0, 0),
    around: int = AROUND,
) -> Shell:  # fmt: skip
    """Return a cylinder between two points whose ends have domes of heights `dome` [m].

    A dome of the cylinder's radius is a half ball; of height 0 the end is flat. Domes lie between
    the two points, so that the body is exactly as long as these are apart.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(b - a))
    angle = np.linspace(0.0, pi / 2, max(4, around // 4 + 1))
    low, high = float(dome[0]), float(dome[1])
    first = [(low * (1 - cos(s)), radius * sin(s)) for s in angle] if low > 0 else [(0.0, radius)]
    last = (
        [(length - high * (1 - sin(s)), radius * cos(s)) for s in angle]
        if high > 0
        else [(length, radius)]
    )
    last[-1] = (last[-1][0], 0.0 if high > 0 else radius)
    return turned([*first, *last], a, b - a, around)


def ellipsoid(at: Sequence[float], half: Sequence[float], around: int = 40) -> Shell:
    """Return an ellipsoid around `at` with the half axes `half` [m], its corners on its surface."""
    angle = np.linspace(0.0, pi, around // 2 + 1)
    unit = [(-cos(s), max(0.0, sin(s)) if 0 < k < len(angle) - 1 else 0.0)
            for k, s in enumerate(angle)]  # fmt: skip
    vertices, faces = turned(unit, around=around)
    return vertices * np.asarray(half, float) + np.asarray(at, float), faces


def myring_profile(
    a: float, b: float, c: float, d: float, n: float, theta: float,
    a_offset: float = 0.0, c_offset: float = 0.0, points: int = 17,
) -> list[tuple[float, float]]:  # fmt: skip
    """Return (x from the nose, radius) of a hull by Myring's equations [m], nose first.

    Nose:  r = d/2 (1 - ((x + a_offset - a) / a)²)^(1/n).  Tail, with s = x - (a - a_offset) - b:
    r = d/2 - (3 d / 2 c² - tan theta / c) s² + (d / c³ - tan theta / c²) s³.  `theta` [deg] is the
    angle of the full tail at its tip; offsets [m] are cut off nose and tail.

    Source: Myring (1976), as in Prestero (2001), equations 2.1 and 2.2.
    """
    slope = tan(radians(theta))
    nose = a - a_offset
    profile = []
    for s in np.linspace(0.0, pi / 2, points):
        x = nose * (1.0 - cos(s))
        profile.append((x, d / 2 * max(0.0, 1.0 - ((x + a_offset - a) / a) ** 2) ** (1.0 / n)))
    for s in np.linspace(0.0, c - c_offset, points):
        r = d / 2 - (3 * d / (2 * c * c) - slope / c) * s**2 + (d / c**3 - slope / c**2) * s**3
        profile.append((nose + b + float(s), max(0.0, float(r))))
    return profile


def myring(
    nose: Sequence[float], a: float, b: float, c: float, d: float, n: float = 2.0,
    theta: float = 25.0, a_offset: float = 0.0, c_offset: float = 0.0, around: int = 28,
) -> Shell:  # fmt: skip
    """Return a hull by Myring's equations (`myring_profile`) behind `nose` [m], along -x."""
    profile = myring_profile(a, b, c, d, n, theta, a_offset, c_offset)
    return turned(profile, nose, (-1, 0, 0), around)


def box(
    at: Sequence[float], size: Sequence[float], edge: float = 0.0, turn: Sequence[float] = (0, 0, 0)
) -> Shell:
    """Return a box around `at`, turned by phi theta psi [deg].

    Its edges are cut off at 45 degrees, tangent to a rounding of the radius `edge` [m].
    """
    half = 0.5 * np.asarray(size, float)
    if edge > half.min():
        raise ValueError(f"edge {edge:g} is more than half of the least side")
    x, y, z = half
    # An edge is cut off at 45 degrees, so that the cut is tangent to its rounding.
    cut = edge * (2.0 - sqrt(2.0))
    levels = (
        [(-z, cut), (-z + cut, 0.0), (z - cut, 0.0), (z, cut)] if cut > 0 else [(-z, 0.0), (z, 0.0)]
    )
    rings = []
    for level, inset in levels:
        a, b, c = x - inset, y - inset, cut
        if cut > 0:
            ring = [(a, b - c), (a - c, b), (c - a, b), (-a, b - c),
                    (-a, c - b), (c - a, -b), (a - c, -b), (a, c - b)]  # fmt: skip
        else:
            ring = [(a, b), (-a, b), (-a, -b), (a, -b)]
        rings.append([(*corner, level) for corner in ring])
    vertices, faces = _lofted(np.array(rings))
    return _shell(vertices @ _rotation(turn).T + np.asarray(at, float), faces)


def _rotation(turn: Sequence[float]) -> Array:
    """Return R(phi, theta, psi) of angles in degrees, zyx."""
    (cf, sf), (ct, st), (cp, sp) = ((cos(radians(a)), sin(radians(a))) for a in turn)
    return np.array(
        [
            [cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
            [-st, ct * sf, ct * cf],
        ]
    )


def plate(
    at: Sequence[float],
    normal: str,
    thickness: float,
    outline: Points,
    holes: Sequence[Points] = (),
) -> Shell:
    """Return a plate across an axis ("x", "y" or "z") with this outline and these holes.

    Corners are given in the other two axes, in their order; `at` is the middle of the thickness at
    the outline's origin.
    """
    axis = "xyz".index(normal)
    others = [k for k in range(3) if k != axis]
    loops = [_sense(np.asarray(outline, float), 1.0)]
    loops += [_sense(np.asarray(hole, float), -1.0) for hole in holes]
    flat = np.concatenate(loops)
    triangles = _ears(flat, loops)
    n = len(flat)
    vertices = np.zeros((2 * n, 3))
    vertices[:, others] = np.concatenate([flat, flat])
    vertices[:n, axis], vertices[n:, axis] = thickness / 2, -thickness / 2
    faces = [*triangles, *([a + n, c + n, b + n] for a, b, c in triangles)]
    first = 0
    for loop in loops:
        for i in range(len(loop)):
            p, q = first + i, first + (i + 1) % len(loop)
            faces += [[p, p + n, q + n], [p, q + n, q]]
        first += len(loop)
    return _shell(vertices + np.asarray(at, float), faces)


def _area(loop: Array) -> float:
    x, y = loop.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def _sense(loop: Array, sign: float) -> Array:
    return loop if sign * _area(loop) > 0 else loop[::-1]


def _ears(flat: Array, loops: list[Array]) -> list[list[int]]:
    """Cut a polygon with holes into triangles, by ear clipping (Meisters 1975)."""
    left = list(range(len(loops[0])))
    first = len(loops[0])
    holes = []
    for loop in loops[1:]:
        holes.append(list(range(first, first + len(loop))))
        first += len(loop)
    # Each hole becomes a part of the outline by a bridge from its rightmost corner.
    for hole in sorted(holes, key=lambda h: -float(flat[h][:, 0].max())):
        k = max(range(len(hole)), key=lambda m: float(flat[hole[m], 0]))
        turned_hole = hole[k:] + hole[:k]
        own = flat[turned_hole[0]]
        order = sorted(range(len(left)), key=lambda m: float(np.sum((flat[left[m]] - own) ** 2)))
        edges = [(left[m], left[(m + 1) % len(left)]) for m in range(len(left))]
        for h in holes:
            edges += [(h[m], h[(m + 1) % len(h)]) for m in range(len(h))]
        at = next(
            m for m in order if not any(_cross(flat, left[m], turned_hole[0], e) for e in edges)
        )
        left = [*left[: at + 1], *turned_hole, turned_hole[0], *left[at:]]
    found = []
    while len(left) > 3:
        for m in range(len(left)):
            a, b, c = left[m - 1], left[m], left[(m + 1) % len(left)]
            if _turn(flat[a], flat[b], flat[c]) <= 1e-15:
                continue
            inside = (
                p for p in left
                if p not in (a, b, c)
                and not any(np.array_equal(flat[p], flat[q]) for q in (a, b, c))
                and all(_turn(*two, flat[p]) >= 0 for two in (
                    (flat[a], flat[b]), (flat[b], flat[c]), (flat[c], flat[a])))
            )  # fmt: skip
            if next(inside, None) is None:
                found.append([a, b, c])
                del left[m]
                break
        else:
            raise ValueError("the outline crosses itself")
    return [*found, left]


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _cross(flat: Array, i: int, j: int, edge: tuple[int, int]) -> bool:
    """Return whether the segment from corner i to corner j crosses an edge within both."""
    if i in edge or j in edge:
        return False
    p, q, a, b = flat[i], flat[j], flat[edge[0]], flat[edge[1]]
    return _turn(p, q, a) * _turn(p, q, b) < 0 and _turn(a, b, p) * _turn(a, b, q) < 0


def _blades(
    at: Array, e: Array, root: float, radius: float, number: int, pitch: float, chord: float
) -> list[Shell]:
    """Return blades from the radius `root` to `radius`, of pitch ratio `pitch`, right-handed."""
    u, v = _across(e)
    found = []
    for k in range(number):
        phi = 2.0 * pi * k / number
        out, side = cos(phi) * u + sin(phi) * v, cos(phi) * v - sin(phi) * u
        rings = []
        for share, wide in ((0.0, 0.6), (0.5, 1.0), (1.0, 0.5)):
            r = root + share * (radius - root)
            beta = atan(pitch * radius / (pi * r))
            along = cos(beta) * side + sin(beta) * e
            face = cos(beta) * e - sin(beta) * side
            c, t = 0.5 * wide * chord, 0.05 * wide * chord * (1.4 - share)
            rings.append([at + r * out + p for p in (c * along, t * face, -c * along, -t * face)])
        found.append(_lofted(np.array(rings)))
    return found


def propeller(
    at: Sequence[float], e: Sequence[float], radius: float, hub: float, blades: int = 3,
    pitch: float = 1.0, chord: float = 0.35,
) -> Shell:  # fmt: skip
    """Return hub and blades of a propeller: `hub` its radius [m], `chord` as a share of radius."""
    way, place = np.asarray(e, float) / np.linalg.norm(e), np.asarray(at, float)
    profile = [(-1.6 * hub, 0.0), (-1.2 * hub, 0.6 * hub), (-0.4 * hub, hub), (hub, hub)]
    body = turned(profile, place, way, 12)
    return joined([body, *_blades(place, way, 0.9 * hub, radius, blades, pitch, chord * radius)])


def thruster(
    at: Sequence[float], e: Sequence[float], radius: float, length: float, hub: float,
    blades: int = 3, pitch: float = 0.9, around: int = 14,
) -> Shell:  # fmt: skip
    """Return a ducted thruster: nozzle, hub with nose, three struts and blades [m].

    `at` is its middle, `e` the direction of positive thrust, where its inlet is.
    """
    way, place = np.asarray(e, float) / np.linalg.norm(e), np.asarray(at, float)
    duct = [(-0.5, 0.90), (0.1, 0.94), (0.5, 1.0), (0.3, 0.86), (-0.5, 0.84)]
    ring = [(length * x, radius * r) for x, r in duct]
    nose = [(-0.6, 0.0), (-0.45, 0.8), (-0.25, 1.0), (0.35, 1.0), (0.5, 0.7), (0.6, 0.0)]
    parts = [
        turned(ring, place, way, around, ring=True),
        turned([(length * x, hub * r) for x, r in nose], place, way, 8),
    ]
    u, v = _across(way)
    for k in range(3):
        phi = 2.0 * pi * k / 3 + 0.5
        out = cos(phi) * u + sin(phi) * v
        side = np.cross(way, out)
        t, wide = 0.025 * radius, 0.09 * length
        rings = [
            [place + r * out + way * (x - 0.32 * length) + y * side
             for x, y in ((-wide, -t), (wide, -t), (wide, t), (-wide, t))]
            for r in (0.96 * hub, 0.85 * radius)
        ]  # fmt: skip
        parts.append(_lofted(np.array(rings)))
    parts += _blades(place + 0.05 * length * way, way, 0.95 * hub, 0.8 * radius, blades, pitch,
                     0.42 * radius)  # fmt: skip
    return joined(parts)


def fin(
    at: Sequence[float], span: Sequence[float], chord: Sequence[float], sweep: float = 0.0,
    thickness: float = 0.12,
) -> Shell:  # fmt: skip
    """Return a fin or wing of a symmetric section, its chord along x.

    `at` is the middle of its root's chord, `span` the vector from root to tip (across x), `chord`
    those of root and tip, `sweep` how far the tip's middle lies behind the root's; all in m.
    `thickness` is a share of the chord, greatest at 30 % of it: NACA's four-digit section.
    """
    s = np.asarray(span, float)
    flat = np.cross([1.0, 0.0, 0.0], s)
    flat /= np.linalg.norm(flat)
    x = np.array([0.0, 0.03, 0.12, 0.3, 0.6, 1.0])
    y = 5 * thickness * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3
                         - 0.1036 * x**4)  # fmt: skip
    rings = []
    for share, c in ((0.0, chord[0]), (1.0, chord[1])):
        middle = np.asarray(at, float) + share * (s - np.array([sweep, 0.0, 0.0]))
        ahead = np.array([[0.5 - k, h] for k, h in zip(x, y, strict=True)])
        back = np.array([[0.5 - k, -h] for k, h in zip(x[-2:0:-1], y[-2:0:-1], strict=True)])
        section = np.concatenate([ahead, back])
        rings.append(middle + c * (section[:, :1] * [1.0, 0.0, 0.0] + section[:, 1:] * flat))
    return _lofted(np.array(rings))


def enclosed_volume(vertices: Array, faces: NDArray[np.integer], cells: int = 400) -> float:
    """Return the volume [m3] within shells, where shells overlap counted once.

    Exact along z, in `cells` columns along each of x and y: the winding number of the surface
    about a place is 1 or more inside.
    """
    t = np.asarray(vertices, float)[faces]
    low, high = t.min(axis=(0, 1)), t.max(axis=(0, 1))
    cell = (high[:2] - low[:2]) / cells
    # Irrational shifts, so that no column runs along an edge of a symmetric hull.
    p = (t[:, :, :2] - low[:2]) / cell + [acos(0.9), acos(0.7)]
    (a, b, c), rows = (p[:, k] for k in range(3)), cells + 3
    area = (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
    columns: list[NDArray[np.int64]] = []
    heights, signs = [], []
    for k in np.flatnonzero(np.abs(area) > 1e-12):
        least, most = np.ceil(p[k].min(axis=0)).astype(int), np.floor(p[k].max(axis=0)).astype(int)
        if (most < least).any():
            continue
        i, j = (q.ravel() for q in np.meshgrid(*map(np.arange, least, most + 1), indexing="ij"))
        w = [
            ((q[0] - i) * (r[1] - j) - (q[1] - j) * (r[0] - i)) / area[k]
            for q, r in ((b[k], c[k]), (c[k], a[k]), (a[k], b[k]))
        ]
        on = (w[0] >= 0) & (w[1] >= 0) & (w[2] >= 0)
        columns.append(i[on] * rows + j[on])
        heights.append(sum(w[m][on] * t[k, m, 2] for m in range(3)))
        signs.append(np.full(int(on.sum()), np.sign(area[k])))
    where, z, sign = np.concatenate(columns), np.concatenate(heights), np.concatenate(signs)
    order = np.lexsort((z, where))
    where, z, sign = where[order], z[order], sign[order]
    # From below (greatest z) each surface is entered by its positive side: sum from the least z.
    inside = -np.cumsum(sign)[:-1] > 0
    same = where[1:] == where[:-1]
    return float(np.sum(np.where(inside & same, z[1:] - z[:-1], 0.0))) * float(cell[0] * cell[1])
