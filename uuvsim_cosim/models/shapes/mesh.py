"""Closed surfaces of triangles: read from STL, refused or repaired, and what they enclose.

Triangles are (n, 3, 3): vertices in m, counted anticlockwise seen from outside.

Volume, centre and second moments are integrals over the solid that become sums over tetrahedra
between the origin and each triangle, exact for the mesh (Eberly 2002, Polyhedral Mass Properties,
gives the same sums as polynomials).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted

__all__ = [
    "Mesh",
    "Solid",
    "finite_triangles",
    "likely_unit",
    "raw_triangles",
    "read_mesh",
    "repaired",
    "silhouette",
    "solid_of",
    "welded",
]

Array = NDArray[np.float64]
UNITS = {"m": 1.0, "mm": 0.001, "cm": 0.01, "inches": 0.0254, "feet": 0.3048}  # m
LEAST, MOST = 0.02, 150.0  # m, of the longest side of a hull
FLAT = 1e-7  # of the longest side cubed: a smaller volume is that of single-precision rounding
_WELD = 1e-6  # of the longest side: corners nearer than this are one


@dataclass(frozen=True)
class Mesh:
    """Closed triangles (n, 3, 3) [m], outside anticlockwise; `notes` lists the repairs."""

    triangles: Array
    notes: tuple[str, ...] = field(default=())


def read_mesh(
    path: str | Path, scale: float = 1.0, *, turn: bool = False, mass: float | None = None
) -> Mesh:
    """Read an STL (other formats by trimesh), times `scale`; raises InputInvalid with the place.

    `turn` turns triangles that are inside out. `mass` [kg] helps to name the unit of the file.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputInvalid(f"--scale {scale:g}: expected a number above 0, as 0.001 for mm")
    triangles = raw_triangles(Path(path))
    hint = likely_unit(triangles, mass, scale)
    return repaired(triangles * scale, str(path), turn=turn, hint=hint)


def likely_unit(triangles: Array, mass: float | None = None, scale: float = 1.0) -> str:
    """Return the likely unit of a file's numbers and its --scale, as a hint; empty if none fits.

    With a `mass` [kg], it is the unit in which the surface encloses the water nearest to that mass,
    at most a factor of 10 away. Else all are named that make the hull 0.1 to 15 m long. The unit
    of the `scale` that was given is not named.
    """
    points = triangles.reshape(-1, 3)
    if not (len(points) and np.isfinite(points).all()):
        return ""
    longest = float(np.ptp(points, axis=0).max())
    own = triangles - points.mean(axis=0)
    water = abs(np.einsum("ni,ni->", own[:, 0], np.cross(own[:, 1], own[:, 2]))) / 6.0 * 1000.0
    fits = {n: s for n, s in UNITS.items() if 0.1 <= s * longest <= 15.0}
    if mass is not None and water > 0:
        off = {n: abs(np.log(water * s**3 / mass)) for n, s in UNITS.items()}
        best = min(off, key=lambda n: off[n])
        fits = {best: UNITS[best]} if off[best] < np.log(10.0) else fits
    fits = {n: s for n, s in fits.items() if s != scale}
    words = (f"{n} (--scale {s:g} makes it {s * longest:.3g} m long)" for n, s in fits.items())
    return f"is the file in {' or '.join(words)}?" if fits else ""


def raw_triangles(path: Path) -> Array:
    """Read the triangles (n, 3, 3) of a file as they are, in its unit, not checked."""
    try:
        data = noted(path).read_bytes()
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be read: {error.strerror}") from None
    if path.suffix.lower() != ".stl":
        return _by_trimesh(path)
    if data[:5].lower() == b"solid" and b"facet" in data[:1000]:
        return _ascii_stl(path, data)
    if len(data) < 84:
        raise InputInvalid(
            path, f"{len(data)} bytes", "an STL: 84 bytes of header and 50 a triangle"
        )
    count = struct.unpack_from("<I", data, 80)[0]
    whole = 84 + 50 * count
    if len(data) != whole:
        found = (len(data) - 84) // 50
        what = "is truncated" if len(data) < whole else "is no STL, or has more after its end"
        raise InputInvalid(
            path,
            (
                f"{what}: its header announces {count} triangles ({whole} bytes), "
                f"and {found} are there ({len(data)} bytes)"
            ),
            "an STL that was exported whole",
        )
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    triangles: Array = np.frombuffer(data, record, count, 84)["corners"].astype(float)
    return triangles


def repaired(triangles: Array, place: str, *, turn: bool = False, hint: str = "") -> Mesh:
    """Check that triangles bound a hull; `turn` turns those outwards that are inside out.

    `hint` names the likely unit of the file. Raises InputInvalid.
    """
    finite_triangles(triangles, place)
    points = triangles.reshape(-1, 3)
    longest = float(np.ptp(points, axis=0).max())
    if not LEAST <= longest <= MOST:
        hint = hint or likely_unit(triangles)
        raise InputInvalid(
            place,
            f"the hull is {longest:.3g} m long",
            f"{LEAST:g} to {MOST:g} m{f': {hint}' if hint else ''}",
        )
    corners, faces = welded(triangles)
    notes = []
    flat = (
        (faces[:, 0] == faces[:, 1]) | (faces[:, 1] == faces[:, 2]) | (faces[:, 2] == faces[:, 0])
    )
    if flat.any():
        notes.append(f"{int(flat.sum())} triangles without area were left out")
        faces = faces[~flat]
    edges = np.sort(_edges(faces), axis=1)
    unique, counts = np.unique(edges, axis=0, return_counts=True)
    lone = unique[counts % 2 == 1]
    if len(lone):
        at = ", ".join(f"{x:.4g}" for x in corners[lone[0]].mean(axis=0))
        raise InputInvalid(
            place,
            (
                f"the surface is open: {len(lone)} edges have a triangle on one "
                f"side only, the first at ({at}) m"
            ),
            "a closed hull (fill the hole where the mesh was made)",
        )
    faces, turned = _outwards(corners, faces, place)
    own = corners[faces] - corners.mean(axis=0)
    volume = np.einsum("ni,ni->", own[:, 0], np.cross(own[:, 1], own[:, 2])) / 6.0
    if volume <= FLAT * longest**3:
        raise InputInvalid(
            place,
            f"the surface encloses no volume ({volume:.3g} m3 at {longest:.3g} m length)",
            "a closed hull with length, breadth and height",
        )
    if turned and not turn:
        raise InputInvalid(
            place,
            f"{turned} of {len(faces)} triangles are inside out: their normals point into the hull",
            "normals that point outwards: turn them where the mesh was made, or give "
            "--turn-inside-out",
        )
    if turned:
        words = "were inside out and are turned, so that every normal points outwards"
        notes.append(f"{turned} of {len(faces)} triangles {words}")
    return Mesh(corners[faces], tuple(notes))


def welded(triangles: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return corners (n, 3) [m] and faces (m, 3): corners that all but coincide are one."""
    points = triangles.reshape(-1, 3)
    longest = float(np.ptp(points, axis=0).max())
    key = np.round((points - points.min(axis=0)) / (_WELD * longest)).astype(np.int64)
    _, first, back = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return points[first], back.reshape(-1, 3).astype(np.int64)


def _ascii_stl(path: Path, data: bytes) -> Array:
    numbers: list[list[float]] = []
    ended = False
    for at, line in enumerate(data.decode("latin-1").splitlines(), 1):
        words = line.split()
        if words[:1] == ["vertex"]:
            try:
                point = [float(w) for w in words[1:]]
            except ValueError:
                point = []
            if len(point) != 3:
                raise InputInvalid(f"{path}:{at}", f"{line.strip()!r}", "vertex and three numbers")
            numbers.append(point)
        ended = words[:1] == ["endsolid"] or (ended and not words)
    if not ended or len(numbers) % 3:
        raise InputInvalid(
            path,
            f"is truncated: {len(numbers)} vertices and {'an' if ended else 'no'} endsolid",
            "three vertices a facet, and endsolid",
        )
    return np.array(numbers, dtype=float).reshape(-1, 3, 3)


def _by_trimesh(path: Path) -> Array:
    try:
        import trimesh
    except ImportError:
        raise InputInvalid(
            path,
            "only .stl is read without trimesh",
            "an STL, or `pip install 'uuvsim-cosim[scene]'` for .obj, .ply, .glb and others",
        ) from None
    try:
        loaded = trimesh.load(str(path), force="mesh", process=False)  # else it drops NaN
        triangles: Array = np.array(loaded.triangles, dtype=float)
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputInvalid(
            path, f"is no mesh that trimesh reads ({reason})", ".stl, .obj, .ply or .glb"
        ) from None
    return triangles


def finite_triangles(triangles: Array, place: str) -> Array:
    """Return the triangles (n, 3, 3); raise InputInvalid where one is not finite or none is."""
    bad = np.flatnonzero(~np.isfinite(triangles).all(axis=(1, 2)))
    if len(bad):
        corner = triangles[bad[0]][~np.isfinite(triangles[bad[0]]).all(axis=1)][0]
        text = " ".join(f"{x:g}" for x in corner)
        raise InputInvalid(
            place,
            f"triangle {bad[0] + 1} of {len(triangles)} has the vertex ({text})",
            f"finite numbers ({len(bad)} triangles have none)",
        )
    if not len(triangles):
        raise InputInvalid(place, "no triangles", "a surface of triangles")
    return triangles


def _edges(faces: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the three directed edges of each face, (3 n, 2): face k has k, n + k, 2 n + k."""
    return np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])


def _outwards(
    corners: Array, faces: NDArray[np.int64], place: str
) -> tuple[NDArray[np.int64], int]:
    """Return the faces with one sense over each shell and outwards, and how many were flipped."""
    n = len(faces)
    edges = _edges(faces)
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((high, low))
    first, second = order[0::2], order[1::2]
    same = (edges[first] == edges[second]).all(axis=1)  # run through in one sense: one is wrong
    neighbours: list[list[tuple[int, bool]]] = [[] for _ in range(n)]
    for a, b, wrong in zip((first % n).tolist(), (second % n).tolist(), same.tolist(), strict=True):
        neighbours[a].append((b, wrong))
        neighbours[b].append((a, wrong))
    flip, shell = np.zeros(n, bool), np.full(n, -1)
    shells = 0
    for start in range(n):
        if shell[start] >= 0:
            continue
        shell[start], todo = shells, [start]
        while todo:
            a = todo.pop()
            for b, wrong in neighbours[a]:
                if shell[b] < 0:
                    shell[b], flip[b] = shells, flip[a] ^ wrong
                    todo.append(b)
                elif flip[b] != flip[a] ^ wrong:
                    at = ", ".join(f"{x:.4g}" for x in corners[faces[b]].mean(axis=0))
                    raise InputInvalid(
                        place,
                        (
                            f"the surface at ({at}) m has no inside (triangles meet there more "
                            "than two to an edge, or it is one-sided)"
                        ),
                        "a closed hull",
                    )
        shells += 1
    turned = np.where(flip[:, None], faces[:, ::-1], faces)
    triangles = corners[turned]
    six = np.einsum("ni,ni->n", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2]))
    inward = np.array([six[shell == k].sum() < 0.0 for k in range(shells)])
    if not inward.any() and not flip.any():
        return faces, 0
    # A shell of its own senses that encloses a negative volume is turned round as a whole.
    wrong_way = inward[shell]
    out = np.where(wrong_way[:, None], turned[:, ::-1], turned)
    return out, int((flip ^ wrong_way).sum())


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
