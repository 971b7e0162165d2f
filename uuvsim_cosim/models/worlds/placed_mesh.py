"""A surface of triangles in a scene: a wreck, a jacket, a wall, read from a file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.files_read import noted
from uuvsim_cosim.models.declaration.units import parse_unit
from uuvsim_cosim.models.shapes.mesh import finite_triangles, raw_triangles

__all__ = ["AXES", "MOST_TRIANGLES", "PlacedMesh", "gltf_parts", "placed_mesh", "unique_rows"]

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]
Real = TypeVar("Real", np.float32, np.float64)

MOST_TRIANGLES = 500_000  # of all meshes of a scene
LEAST, MOST = 0.01, 20_000.0  # m, of the longest side
# What the file's x, y and z are, as rows of the rotation to N, E, D.
AXES: dict[str, tuple[Vector3, Vector3, Vector3]] = {
    "NED": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "ENU": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    "NWU": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "EUS": ((0, 0, -1), (1, 0, 0), (0, -1, 0)),
}
_MEANS = "NED: x north, y east, z down; ENU: z up; NWU: x north, z up; EUS: x east, y up"
_SUFFIXES = (".stl", ".obj", ".glb", ".gltf")


@dataclass(frozen=True, eq=False)
class PlacedMesh:
    """Triangles where they stand, in `n`; `corners` are anticlockwise seen from outside."""

    file: Path
    vertices: Array  # (m, 3) m, N E D, each once
    corners: NDArray[np.int32]  # (n, 3) vertices of each triangle
    position: Vector3  # m, N E D of the file's origin
    orientation: Vector3 = (0.0, 0.0, 0.0)  # rad, phi theta psi of the file's axes
    unit: str = "m"  # of the file's numbers
    scale: float = 1.0  # their factor
    axes: str = "NED"  # directions of the file's x, y, z before they are turned
    material: str = ""  # that a sonar meets, of models/materials.yaml
    name: str = ""
    contact: bool = True  # whether a hull touches it; where not, it passes through
    open_edges: int = 0  # that belong to an odd number of triangles; 0: a closed surface
    flat: int = 0  # triangles of the file with two equal corners, which were left out

    @property
    def facts(self) -> str:
        """Return its size and place in one sentence."""
        low, high = self.vertices.min(axis=0), self.vertices.max(axis=0)
        place = ", ".join(
            f"{axis} {a:.2f} to {b:.2f}" for axis, a, b in zip("NED", low, high, strict=True)
        )
        shell = f"open at {self.open_edges} edges" if self.open_edges else "closed"
        flat = f"; {self.flat} triangles without area were left out" if self.flat else ""
        return f"{len(self.corners):,} triangles, {place} m, {shell}{flat}"


def placed_mesh(
    file: Path,
    position: Vector3,
    orientation: Vector3 = (0.0, 0.0, 0.0),
    unit: str = "",
    scale: float = 1.0,
    axes: str = "",
    material: str = "",
    name: str = "",
    contact: bool = True,
) -> PlacedMesh:
    """Read a mesh (.stl, .obj, .glb, .gltf) and place it.

    A point p of the file is at  position + R(orientation) A scale p,  with A of `axes` and scale
    in `unit`. glTF has metres and the axes EUS unless given otherwise; STL and OBJ state neither,
    so both are needed. Raises InputInvalid for a file or a number that is no mesh.
    """
    ending = file.suffix.lower()
    if ending not in _SUFFIXES:
        raise InputInvalid(f"{file.name}: expected a file ending in {', '.join(_SUFFIXES)}")
    if not file.is_file():
        beside = sorted(p.name for p in file.parent.glob("*") if p.suffix.lower() in _SUFFIXES)
        raise InputInvalid(
            file.name,
            f"there is no such file in {file.parent}",
            ", ".join(beside) or "a mesh beside scene.yaml",
        )
    if ending in (".glb", ".gltf"):
        unit, axes = unit or "m", axes or "EUS"
    if not unit:
        raise InputInvalid(
            file.name, f"{ending} states no unit", "unit: m, cm, mm or another length"
        )
    if axes.upper() not in AXES:
        found = f"axes: {axes}" if axes else f"{ending} states no axes"
        raise InputInvalid(file.name, found, f"axes: {', '.join(AXES)} ({_MEANS})")
    try:
        given, metre = parse_unit(unit), parse_unit("m")
        if not given.commensurable(metre):
            raise ValueError(f"{unit} is no length")
    except ValueError as error:
        raise InputInvalid(file.name, f"unit: {error}", "m, cm, mm or another length") from None
    factor = scale * given.conversion_to(metre)[0]
    if not (np.isfinite(factor) and factor > 0):
        raise InputInvalid(file.name, f"scale: {scale:g}", "a number above 0")
    if max(abs(a) for a in orientation) > 2.0 * pi:
        raise InputInvalid(
            file.name,
            f"orientation: {list(orientation)}",
            "rad, from -2 pi to 2 pi: are these degrees?",
        )
    for part in gltf_parts(file):
        noted(file.parent / part)  # trimesh reads it
    triangles = finite_triangles(raw_triangles(file), file.name)
    if len(triangles) > MOST_TRIANGLES:
        raise InputInvalid(
            file.name,
            f"{len(triangles):,} triangles",
            f"at most {MOST_TRIANGLES:,}: simplify the mesh, or take a part of it",
        )
    points, same = unique_rows(triangles.reshape(-1, 3))
    corners = same.reshape(-1, 3)
    whole = (corners != np.roll(corners, 1, axis=1)).all(axis=1)
    if not whole.any():
        raise InputInvalid(f"{file.name}: all {len(corners)} triangles are without area")
    corners = corners[whole]
    longest = factor * float(np.ptp(points, axis=0).max())
    if not LEAST <= longest <= MOST:
        raise InputInvalid(
            file.name,
            f"is {longest:.3g} m long with unit: {unit} and scale: {scale:g}",
            f"{LEAST:g} to {MOST:g} m",
        )
    edges = np.sort(np.concatenate([corners[:, k] for k in ([0, 1], [1, 2], [2, 0])]), axis=1)
    _, times = np.unique(edges[:, 0] * len(points) + edges[:, 1], return_counts=True)
    return PlacedMesh(
        file, _turned(points * factor, axes.upper(), orientation) + position,
        corners.astype(np.int32), position, orientation, unit, scale, axes.upper(), material, name,
        contact, int((times % 2 == 1).sum()), int((~whole).sum()),
    )  # fmt: skip


def _turned(points: Array, axes: str, orientation: Vector3) -> Array:
    """Turn points (m, 3) term by term: equal points stay equal to the bit, wherever they stand."""
    (cf, sf), (ct, st), (cp, sp) = ((cos(a), sin(a)) for a in orientation)
    R = np.array(
        [
            [cp * ct, cp * st * sf - sp * cf, cp * st * cf + sp * sf],
            [sp * ct, sp * st * sf + cp * cf, sp * st * cf - cp * sf],
            [-st, ct * sf, ct * cf],
        ]
    )
    for M in (np.array(AXES[axes], float), R):
        points = np.stack(
            [row[0] * points[:, 0] + row[1] * points[:, 1] + row[2] * points[:, 2] for row in M],
            axis=1,
        )
    return points


def unique_rows(rows: NDArray[Real]) -> tuple[NDArray[Real], NDArray[np.intp]]:
    """Return each row once, and which of them each row is; -0 is 0."""
    rows = rows + rows.dtype.type(0)
    order = np.lexsort(rows.T[::-1])
    ranked = rows[order]
    new = np.ones(len(rows), bool)
    new[1:] = (ranked[1:] != ranked[:-1]).any(axis=1)
    same = np.empty(len(rows), np.intp)
    same[order] = np.cumsum(new) - 1
    return ranked[new], same


def gltf_parts(file: Path) -> list[str]:
    """List the files that a .gltf reads, relative to its folder: buffers and images."""
    if file.suffix.lower() != ".gltf":
        return []
    try:
        read = json.loads(noted(file).read_text(encoding="utf-8"))
        named = [part.get("uri", "") for key in ("buffers", "images") for part in read.get(key, ())]
    except (ValueError, AttributeError, TypeError):
        return []  # trimesh says what is wrong with it
    return [unquote(uri) for uri in named if uri and not uri.startswith("data:")]
