"""Panels of a closed surface: three similar meshes of well-shaped triangles, for a panel method.

A surface from a CAD program has long slivers on flat faces and thousands of tiny triangles in round
ones. `panel_meshes` makes a coarse mesh of even triangles out of it by splits, collapses and flips
of edges and by smoothing (Botsch and Kobbelt 2004, A remeshing approach to multiresolution
modeling). It keeps sharp edges. Each triangle is then cut into k² similar ones whose corners lie on
the surface that was given, so that the error of a panel method falls with a power of 1/k.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.shapes.mesh import Mesh, welded

__all__ = ["Panels", "cut_to", "mirror_planes", "panel_meshes"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
MOST = 4000  # panels of the finest mesh at most; of a part, so that its equations cost as much
_SHARP = np.cos(np.radians(35.0))  # normals that differ by more are on two sides of a sharp edge
_TURN = np.cos(np.radians(40.0))  # the most that a collapse may turn a normal
_ROUNDS = 6
_BEND = 1.0  # edges at most, in radii of the curvature of a smooth surface
_CUTS = ((2, 3, 4), (1, 2, 3), (1, 2))  # of each side; tried in this order
_State = tuple[
    list[Array], dict[int, tuple[int, int, int]], dict[int, set[int]], set[tuple[int, int]],
    dict[int, int],
]  # fmt: skip


@dataclass(frozen=True)
class Panels:
    """Similar meshes of one surface, or of its part on the positive side of its mirror planes.

    `mirrored` lists the axes whose reversal maps the surface onto itself; `meshes` are triangles
    (n, 3, 3) [m] of the part for each number of `cuts` of a side of the coarsest triangles.
    """

    mirrored: tuple[int, ...]
    cuts: tuple[int, ...]
    meshes: tuple[Array, ...]

    def count(self, triangles: Array) -> int:
        """Return how many panels the whole surface has in one of the meshes."""
        return int(2 ** len(self.mirrored) * len(triangles))

    def volume(self, triangles: Array) -> float:
        """Return the volume [m3] within the whole surface in one of the meshes."""
        part = np.einsum("ni,ni->", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
        return float(2 ** len(self.mirrored) * part / 6.0)


def panel_meshes(mesh: Mesh, place: str = "the surface") -> Panels:
    """Return similar meshes of even triangles, the coarsest first.

    A hull without detail has three meshes, the finest of about 2400 panels; with each mirror plane,
    its part has 1.4 times fewer panels, and the whole 1.4 times more. With more detail the cuts are
    fewer. Raises InputInvalid, with `place`, if two meshes of at most 4000 panels cannot show the
    sharp edges.
    """
    mirrored = mirror_planes(mesh)
    t = mesh.triangles
    for axis in mirrored:
        t = _positive_half(t, axis)
    area = 0.5 * np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum()
    most = MOST / 2.0 ** (0.5 * len(mirrored))
    side = float(np.sqrt(area / (0.6 * most / 16.0) * 4.0 / np.sqrt(3.0)))
    surface = _Remeshed(t, side)
    for grown in (1.0, 1.25, 1.5):
        surface.remesh(grown * side)
        if len(surface.faces) <= most / 16.0:
            break
    cuts = next((c for c in _CUTS if len(surface.faces) * c[-1] ** 2 <= most), None)
    if cuts is None:
        raise InputInvalid(
            place,
            f"its sharp edges need {len(surface.faces)} panels on the coarsest mesh",
            f"at most {most / 4.0:.0f}: leave bolts, fillets and cables out of the surface",
        )
    return Panels(mirrored, cuts, tuple(surface.cut(k) for k in cuts))


def _positive_half(triangles: Array, axis: int) -> Array:
    """Cut triangles (n, 3, 3) at the plane through the origin; return the positive side."""
    t = triangles.copy()
    x = t[:, :, axis]
    x[np.abs(x) < 1e-6 * np.ptp(x)] = 0.0
    above, below = (x > 0.0).sum(axis=1), (x < 0.0).sum(axis=1)
    out = [t[(below == 0) & (above > 0)]]
    for one in t[(above > 0) & (below > 0)]:
        ring: list[Array] = []
        for p, q in ((0, 1), (1, 2), (2, 0)):
            a, b = one[p], one[q]
            if a[axis] >= 0.0:
                ring.append(a)
            if a[axis] * b[axis] < 0.0:
                low, high = (a, b) if a[axis] < b[axis] else (b, a)  # equal for both neighbours
                cut = low + (high - low) * (low[axis] / (low[axis] - high[axis]))
                cut[axis] = 0.0
                ring.append(cut)
        out.append(np.array([[ring[0], ring[k], ring[k + 1]] for k in range(1, len(ring) - 1)]))
    return np.concatenate(out)


def mirror_planes(mesh: Mesh, tolerance: float = 1e-3) -> tuple[int, ...]:
    """Return the axes 0, 1, 2 whose reversal maps the surface onto itself, about the origin.

    `tolerance` is the greatest distance, in parts of the longest side, from the mirror image of a
    corner or of the middle of a triangle to the surface.
    """
    t = mesh.triangles
    longest = float(np.ptp(t.reshape(-1, 3), axis=0).max())
    fine = cut_to(t, longest / 12.0)
    surface = _Nearest(fine)
    points = np.concatenate([np.unique(t.reshape(-1, 3), axis=0), t.mean(axis=1)])
    out = []
    for axis in range(3):
        image = points * np.where(np.arange(3) == axis, -1.0, 1.0)
        off = np.linalg.norm(surface.of(image) - image, axis=1).max()
        if off <= tolerance * longest:
            out.append(axis)
    return tuple(out)


def cut_to(triangles: Array, edge: float, rounds: int = 6) -> Array:
    """Cut triangles (n, 3, 3) into four until none has a longer edge, at most `rounds` times."""
    done = []
    for _ in range(rounds):
        sides = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2).max(axis=1)
        small = sides <= edge
        done.append(triangles[small])
        t = triangles[~small]
        if not len(t):
            break
        m = 0.5 * (t + np.roll(t, -1, axis=1))  # middles of 01, 12, 20
        triangles = np.concatenate(
            [
                np.stack([t[:, 0], m[:, 0], m[:, 2]], axis=1),
                np.stack([m[:, 0], t[:, 1], m[:, 1]], axis=1),
                np.stack([m[:, 2], m[:, 1], t[:, 2]], axis=1),
                m,
            ]
        )
    else:
        done.append(triangles)
    return np.concatenate(done)


def _normals(triangles: Array) -> Array:
    """Return unit normals (n, 3); a triangle without area has zeros."""
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(cross / np.maximum(np.linalg.norm(cross, axis=1), 1e-300)[:, None])


class _Nearest:
    """The nearest point on small triangles, or on segments: triangles with two equal corners."""

    def __init__(self, triangles: Array) -> None:
        from scipy.spatial import KDTree

        self.triangles = triangles
        self.normals = _normals(triangles)
        self.tree = KDTree(triangles.mean(axis=1))

    def of(self, points: Array, normals: Array | None = None) -> Array:
        """Return nearest points (n, 3), on triangles whose normal is near the given one."""
        count = min(16, len(self.triangles))
        _, near = self.tree.query(points, count)
        near = near.reshape(len(points), count)
        t = self.triangles[near]  # (n, count, 3, 3)
        found = _closest(points[:, None], t)
        far = np.linalg.norm(found - points[:, None], axis=2)
        if normals is not None:
            facing = np.einsum("nki,ni->nk", self.normals[near], normals)
            far = np.where(facing > 0.3, far, far + 1e3 * far.max())
        best = np.argmin(far, axis=1)
        return np.asarray(found[np.arange(len(points)), best])

    def along(self, triangles: Array, normals: Array) -> bool:
        """Return whether each triangle's normal is near the surface's at its middle."""
        _, near = self.tree.query(triangles.mean(axis=1))
        return bool(((self.normals[near] * normals).sum(axis=1) > _TURN).all())


def _closest(p: Array, t: Array) -> Array:
    """Return the point of each triangle t (..., 3, 3) that is nearest to p (..., 3)."""
    a, b, c = t[..., 0, :], t[..., 1, :], t[..., 2, :]
    normal = np.cross(b - a, c - a)
    square = np.maximum((normal**2).sum(-1), 1e-300)
    inside = p - normal * (((p - a) * normal).sum(-1) / square)[..., None]
    signs = [(np.cross(v - u, inside - u) * normal).sum(-1) for u, v in ((a, b), (b, c), (c, a))]
    within = (np.min(signs, axis=0) >= 0.0) & (square > 1e-300)
    best, far = inside, np.where(within, 0.0, np.inf)
    for u, v in ((a, b), (b, c), (c, a)):
        along = v - u
        s = ((p - u) * along).sum(-1) / np.maximum((along**2).sum(-1), 1e-300)
        q = u + np.clip(s, 0.0, 1.0)[..., None] * along
        d = np.linalg.norm(q - p, axis=-1)
        nearer = (d < far) & ~within
        best = np.where(nearer[..., None], q, best)
        far = np.where(nearer, d, far)
    return np.asarray(best)


class _Remeshed:
    """A triangle mesh that is changed edge by edge; sharp edges are kept."""

    def __init__(self, triangles: Array, side: float) -> None:
        corners, faces = welded(triangles)
        # A corner that was welded may have left a triangle without area.
        whole = np.array([len(set(f)) == 3 for f in faces.tolist()])
        faces, triangles = faces[whole], triangles[whole]
        self.points: list[Array] = list(corners)
        self.faces: dict[int, tuple[int, int, int]] = {}
        self.around: dict[int, set[int]] = {}
        self.next = 0
        for a, b, c in faces.tolist():
            self._add(a, b, c)
        normals = _normals(triangles)
        self.sharp: set[tuple[int, int]] = set()
        for (a, b), pair in self._edges().items():
            if len(pair) != 2 or normals[pair[0]] @ normals[pair[1]] < _SHARP:
                self.sharp.add((a, b))
        self._sizes(corners, triangles, normals)
        self.surface = _Nearest(cut_to(triangles, 0.5 * side))
        lines = np.array([[corners[a], corners[b], corners[b]] for a, b in sorted(self.sharp)])
        self.lines = _Nearest(_cut_lines(lines, 0.5 * side)) if len(lines) else None
        self.kinds: dict[int, int] = {}
        for v in range(len(corners)):
            self._classify(v)

    def _sizes(self, corners: Array, triangles: Array, normals: Array) -> None:
        """Note how long an edge may be near each corner: less where a smooth surface bends."""
        from scipy.spatial import KDTree

        twice = np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )
        bend = np.zeros(len(corners))
        for (a, b), pair in self._edges().items():
            if (a, b) not in self.sharp:
                i, j = pair
                angle = np.arccos(min(1.0, float(normals[i] @ normals[j])))
                heights = 0.5 * (twice[i] + twice[j]) / self._length(a, b)
                for v in (a, b):
                    bend[v] = max(bend[v], angle / heights)
        self.bent = _BEND / np.maximum(bend, 1e-9)
        self.nearest_corner = KDTree(corners)

    def _size(self, a: int, b: int) -> float:
        """Return the wanted length of an edge between two corners [m]."""
        _, near = self.nearest_corner.query(0.5 * (self.points[a] + self.points[b]))
        return float(self.wanted[near])

    def _classify(self, v: int) -> None:
        """Note whether a corner is free (0), on a sharp line (2), or fixed (3)."""
        ends = [b if a == v else a for a, b in self._sharp_at(v)]
        kind = 0 if not ends else 3
        if len(ends) == 2:
            u, w = (self.points[e] - self.points[v] for e in ends)
            if u @ w < -0.8 * np.linalg.norm(u) * np.linalg.norm(w):
                kind = 2
        self.kinds[v] = kind

    def _sharp_at(self, v: int) -> list[tuple[int, int]]:
        return [e for e in (_key(v, w) for w in self._neighbours(v)) if e in self.sharp]

    def _neighbours(self, v: int) -> set[int]:
        out = {w for f in self.around[v] for w in self.faces[f]}
        out.discard(v)
        return out

    def _add(self, a: int, b: int, c: int) -> None:
        self.faces[self.next] = (a, b, c)
        for v in (a, b, c):
            self.around.setdefault(v, set()).add(self.next)
        self.next += 1

    def _drop(self, face: int) -> None:
        for v in self.faces.pop(face):
            self.around[v].discard(face)

    def _edges(self) -> dict[tuple[int, int], list[int]]:
        out: dict[tuple[int, int], list[int]] = {}
        for f, (a, b, c) in self.faces.items():
            for e in ((a, b), (b, c), (c, a)):
                out.setdefault(_key(*e), []).append(f)
        return out

    def _by_length(self) -> list[tuple[float, tuple[int, int]]]:
        """Return the edges, the shortest first, with their lengths in parts of the wanted one."""
        edges = list(self._edges())
        ends = np.array(self.points)[np.array(edges)]
        lengths = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
        _, near = self.nearest_corner.query(ends.mean(axis=1))
        return sorted(zip((lengths / self.wanted[near]).tolist(), edges, strict=True))

    def _length(self, a: int, b: int) -> float:
        d = self.points[a] - self.points[b]
        return float(np.sqrt(d @ d))

    def remesh(self, side: float) -> None:
        """Split, collapse, flip and smooth until the edges are near the wanted length.

        At a tip the rounds do not converge: a split may leave a sliver that the next round removes.
        So the mesh is that of the round, among the last ones, whose worst triangle is best.
        """
        self.wanted = np.clip(self.bent, side / 6.0, side)
        best, kept = -np.inf, self._state()
        for k in range(_ROUNDS):
            self._split()
            self._collapse()
            self._flip()
            self._smooth()
            if k >= _ROUNDS // 2 and (worst := self._worst()) > best:
                best, kept = worst, self._state()
        self.points, self.faces, self.around, self.sharp, self.kinds = kept

    def _state(self) -> _State:
        around = {v: set(faces) for v, faces in self.around.items()}
        return list(self.points), dict(self.faces), around, set(self.sharp), dict(self.kinds)

    def _worst(self) -> float:
        """Return the least of all triangles: shape (1: equilateral) times cosine to the surface."""
        t = np.array(self.points)[np.array(list(self.faces.values()))]
        sides = ((t - np.roll(t, 1, axis=1)) ** 2).sum(axis=(1, 2))
        twice = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
        _, near = self.surface.tree.query(t.mean(axis=1))
        facing = (self.surface.normals[near] * _normals(t)).sum(axis=1)
        return float((2.0 * np.sqrt(3.0) * twice / sides * facing).min())

    def _split(self) -> None:
        for _ in range(12):  # each sweep halves the longest edges
            long = [e for length, e in self._by_length() if length > 4.0 / 3.0]
            if not long:
                return
            done: set[int] = set()
            for a, b in reversed(long):  # the longest first; each triangle once a sweep
                pair = sorted(self.around[a] & self.around[b])
                if done.intersection(pair):
                    continue
                m = len(self.points)
                self.points.append(0.5 * (self.points[a] + self.points[b]))
                for f in pair:
                    three = self.faces[f]
                    self._drop(f)
                    for old in (a, b):
                        done.add(self.next)
                        self._add(*(m if v == old else v for v in three))
                    done.add(f)
                if (a, b) in self.sharp:
                    self.sharp.discard((a, b))
                    self.sharp.update((_key(a, m), _key(b, m)))
                    self.kinds[m] = 2
                else:
                    self.kinds[m] = 0

    def _collapse(self) -> None:
        for length, (a, b) in self._by_length():
            if length > 0.8:
                return
            shared = self.around.get(a, set()) & self.around.get(b, set())
            if not shared:
                continue
            for u, v in ((a, b), (b, a)):
                if self._may_collapse(u, v):
                    self._onto(u, v)
                    break

    def _may_collapse(self, u: int, v: int) -> bool:
        """Return whether u can be moved onto v: no line, no fold and no long edge results."""
        kind = self.kinds[u]
        if kind == 3 or (kind == 2 and _key(u, v) not in self.sharp):
            return False
        of_u, of_v = self._neighbours(u), self._neighbours(v)
        shared = of_u & of_v
        if len(shared) != len(self.around[u] & self.around[v]):
            return False
        # A sliver on a flat face may keep its length: only edges that grow too long are refused.
        most = 4.0 / 3.0 * self._size(u, v)
        if any(self._length(w, v) > max(most, self._length(w, u)) for w in of_u - {v}):
            return False
        rest = [self.faces[f] for f in self.around[u] - self.around[v]]
        if not rest:
            return False
        before = np.array([[self.points[w] for w in face] for face in rest])
        after = np.array([[self.points[v if w == u else w] for w in face] for face in rest])
        n = _normals(after)
        if ((_normals(before) * n).sum(axis=1) <= _TURN).any():
            return False
        return self.surface.along(after, n)

    def _onto(self, u: int, v: int) -> None:
        lines = [w for w in self._neighbours(u) if _key(u, w) in self.sharp]
        for f in sorted(self.around[u]):
            three = self.faces[f]
            self._drop(f)
            if v not in three:
                self._add(*(v if w == u else w for w in three))
        for w in lines:
            self.sharp.discard(_key(u, w))
            if w != v:
                self.sharp.add(_key(v, w))
        del self.around[u], self.kinds[u]

    def _flip(self) -> None:
        for a, b in sorted(self._edges()):
            if (a, b) in self.sharp:
                continue
            pair = sorted(self.around[a] & self.around[b])
            if len(pair) != 2:
                continue
            c, d = (next(v for v in self.faces[f] if v not in (a, b)) for f in pair)
            if self._neighbours(c) & {d} or len({a, b, c, d}) < 4:
                continue
            first = self.faces[pair[0]]  # has a then b, or b then a
            if (first.index(b) - first.index(a)) % 3 != 1:
                a, b = b, a
            p = {v: self.points[v] for v in (a, b, c, d)}
            before = np.array([[p[a], p[b], p[c]], [p[b], p[a], p[d]]])
            after = np.array([[p[a], p[d], p[c]], [p[d], p[b], p[c]]])
            if _least_angle(after) <= _least_angle(before) + 1e-6:
                continue
            n = _normals(after)
            if (n @ _normals(before).T).min() < _TURN or n[0] @ n[1] < _TURN:
                continue
            if not self.surface.along(after, n):
                continue
            for f in pair:
                self._drop(f)
            self._add(a, d, c)
            self._add(d, b, c)

    def _smooth(self) -> None:
        free = [v for v in sorted(self.around) if self.kinds[v] == 0]
        if not free:
            return
        old = np.array([self.points[v] for v in free])
        middle = np.array(
            [np.mean([self.points[w] for w in sorted(self._neighbours(v))], axis=0) for v in free]
        )
        normals = self._normals_at(free)
        shift = middle - old
        shift -= normals * (shift * normals).sum(axis=1)[:, None]  # along the surface only
        new = self.surface.of(old + shift, normals)
        for v, before, after in zip(free, old, new, strict=True):
            faces = [self.faces[f] for f in sorted(self.around[v])]
            n = _normals(np.array([[self.points[w] for w in f] for f in faces]))
            self.points[v] = after
            m = _normals(np.array([[self.points[w] for w in f] for f in faces]))
            if ((n * m).sum(axis=1) < _TURN).any():
                self.points[v] = before

    def _normals_at(self, corners: list[int]) -> Array:
        out = np.zeros((len(corners), 3))
        for k, v in enumerate(corners):
            t = np.array([[self.points[w] for w in self.faces[f]] for f in self.around[v]])
            n = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]).sum(axis=0)
            out[k] = n / max(float(np.linalg.norm(n)), 1e-300)
        return out

    def cut(self, k: int) -> Array:
        """Return the triangles (n k², 3, 3), each side cut into k, corners on the surface."""
        index = [(i, j) for i in range(k + 1) for j in range(k + 1 - i)]
        at = {ij: n for n, ij in enumerate(index)}
        small = [(at[i, j], at[i + 1, j], at[i, j + 1]) for i, j in index if i + j < k]
        small += [(at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for i, j in index if i + j < k - 1]
        faces = np.array(list(self.faces.values()))
        points = np.array(self.points)
        t = points[faces]
        share = np.array([[(k - i - j) / k, i / k, j / k] for i, j in index])
        grid = np.einsum("gc,nci->ngi", share, t)  # (n, places, 3)
        normals = np.repeat(_normals(t)[:, None], len(index), axis=1)
        # A place on a sharp edge of the coarse mesh goes to the sharp lines of the surface.
        on_line = np.zeros(grid.shape[:2], bool)
        for side, (p, q) in enumerate(((0, 1), (1, 2), (2, 0))):
            sharp = np.array([_key(int(f[p]), int(f[q])) in self.sharp for f in faces])
            on_line |= sharp[:, None] & (share[:, (2, 0, 1)[side]] == 0.0)[None]
        corner = (share == 1.0).any(axis=1)[None] & np.ones_like(on_line)
        free = ~on_line & ~corner
        moved = grid.copy()
        if free.any():
            moved[free] = self.surface.of(grid[free], normals[free])
        if self.lines is not None and (on_line & ~corner).any():
            moved[on_line & ~corner] = self.lines.of(grid[on_line & ~corner])
        out = moved[:, np.array(small)].reshape(-1, 3, 3)
        area = np.linalg.norm(np.cross(out[:, 1] - out[:, 0], out[:, 2] - out[:, 0]), axis=1)
        return np.asarray(out[area > 1e-6 * area.mean()])


def _cut_lines(lines: Array, edge: float) -> Array:
    """Cut segments, written as triangles with two equal corners, to a length."""
    out = []
    for a, b, _ in lines:
        n = max(1, int(np.ceil(np.linalg.norm(b - a) / edge)))
        s = np.linspace(0.0, 1.0, n + 1)[:, None]
        p = a + s * (b - a)
        out.append(np.stack([p[:-1], p[1:], p[1:]], axis=1))
    return np.concatenate(out)


def _key(a: int, b: int) -> tuple[int, int]:
    return (a, b) if a < b else (b, a)


def _least_angle(triangles: Array) -> float:
    """Return the least angle of triangles (n, 3, 3) [rad]."""
    u = np.roll(triangles, -1, axis=1) - triangles
    w = np.roll(triangles, 1, axis=1) - triangles
    cos = (u * w).sum(-1) / np.maximum(
        np.linalg.norm(u, axis=-1) * np.linalg.norm(w, axis=-1), 1e-300
    )
    return float(np.arccos(np.clip(cos.max(), -1.0, 1.0)))
