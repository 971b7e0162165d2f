"""Triangle meshes of hulls, obstacles, basins and terrain."""

from __future__ import annotations

from dataclasses import replace
from math import ceil, pi

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.declaration.parameter_files import Size
from uuvsim_cosim.models.shapes.hull_shape import hull_shape
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.view.scene3d.scene import Mesh

__all__ = [
    "MOST_DRAWN",
    "basin",
    "box",
    "cropped",
    "floor",
    "hull_of",
    "lathe",
    "obstacle_mesh",
    "placed_surface",
    "shape_of",
    "surface",
    "terrain_mesh",
]

Array = NDArray[np.float64]
AROUND = 20  # corners of round shapes
MOST_DRAWN = 50_000  # triangles of a mesh


def _mesh(vertices: NDArray[np.floating], faces: NDArray[np.integer]) -> Mesh:
    return Mesh(np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.uint32))


def box(low: Array, high: Array) -> Mesh:
    """Return a box between two corners."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array([
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ])  # fmt: skip
    return _mesh(np.asarray(low) + corners * (np.asarray(high) - np.asarray(low)), faces)


def lathe(along: Array, radius: Array, around: int = AROUND) -> Mesh:
    """Turn a profile about x: closed where its first and last radius are 0."""
    angle = np.arange(around) * (2.0 * pi / around)
    ring = np.column_stack([np.zeros(around), np.cos(angle), np.sin(angle)])
    rows = [np.array([x, 0, 0]) + r * ring for x, r in zip(along, radius, strict=True)]
    faces = []
    for i in range(len(rows) - 1):
        for j in range(around):
            a, b = i * around + j, i * around + (j + 1) % around
            faces += [[a, a + around, b], [b, a + around, b + around]]
    return _mesh(np.concatenate(rows), np.array(faces)[:, ::-1])


def hull_of(size: Size) -> Mesh:
    """Return a hull by its size and shape, as the vehicle's picture draws it."""
    half = 0.5 * np.array([size.length, size.breadth, size.height])
    if size.shape == "box":
        mesh = box(-half, half)
    elif size.shape == "ellipsoid":
        t = np.linspace(0.0, pi, 13)
        mesh = lathe(-np.cos(t), np.sin(t))
        mesh = _mesh(mesh.vertices * half, mesh.faces)
    else:  # a torpedo: its tail tapers over 1.8 diameters, its nose is round
        wide = 2.0 * float(half[1:].max())
        length = 2.0 * float(half[0])
        tail, nose = min(1.8 * wide, length / 3), min(wide, length / 4)
        s, t = np.linspace(0.0, 1.0, 7), np.linspace(0.0, 0.5 * pi, 7)
        along = np.concatenate([[0.0], s * tail, length - nose + np.sin(t) * nose])
        radius = np.concatenate([[0.0], 0.15 + 0.85 * np.sin(0.5 * pi * s), np.cos(t)])
        mesh = lathe(along - 0.5 * length, radius)
        mesh = _mesh(mesh.vertices * np.array([1.0, half[1], half[2]]), mesh.faces)
    return _mesh(mesh.vertices + np.asarray(size.at), mesh.faces)


def shape_of(vehicle: str) -> Mesh | None:
    """Return a vehicle by its shape.yaml; None if its folder has none."""
    shape = hull_shape(vehicle)
    return None if shape is None else _mesh(*shape.surface)


def basin(middle: Array, size: Array) -> Mesh:
    """Return floor and walls of a pool, facing inwards; `middle` is that of its surface."""
    low = np.array([middle[0] - size[0] / 2, middle[1] - size[1] / 2, middle[2]])
    whole = box(low, low + np.asarray(size))
    keep = ~(whole.vertices[whole.faces][:, :, 2] <= low[2] + 1e-9).all(axis=1)
    return _mesh(whole.vertices, whole.faces[keep][:, ::-1])


def floor(low: Array, high: Array, depth: float) -> Mesh:
    """Return a flat bottom below a rectangle (2,) to (2,), facing up."""
    (a, b), (c, d) = low, high
    corners = np.array([[a, b, depth], [c, b, depth], [c, d, depth], [a, d, depth]])
    return _mesh(corners, np.array([[0, 2, 1], [0, 3, 2]]))


def surface(low: Array, high: Array) -> Mesh:
    """Return still water above a rectangle (2,) to (2,), facing up and down."""
    (a, b), (c, d) = low, high
    corners = np.array([[a, b, 0.0], [c, b, 0.0], [c, d, 0.0], [a, d, 0.0]])
    return _mesh(corners, np.array([[0, 2, 1], [0, 3, 2], [0, 1, 2], [0, 2, 3]]))


def obstacle_mesh(obstacle: Obstacle) -> Mesh:
    """Return the surface of an obstacle, in `n`."""
    if isinstance(obstacle, Box):
        mesh = box(-np.asarray(obstacle.half), np.asarray(obstacle.half))
        c, s = np.cos(obstacle.yaw), np.sin(obstacle.yaw)
        turned = mesh.vertices @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
        return _mesh(turned + np.asarray(obstacle.centre), mesh.faces)
    if isinstance(obstacle, Sphere):
        t = np.linspace(0.0, pi, 11)
        ball = lathe(-obstacle.radius * np.cos(t), obstacle.radius * np.sin(t))
        return _mesh(ball.vertices + np.asarray(obstacle.centre), ball.faces)
    if isinstance(obstacle, Cylinder):
        h, r = obstacle.half_height, obstacle.radius
        tube = lathe(np.array([-h, -h, h, h]), np.array([0.0, r, r, 0.0]))
        return _mesh(tube.vertices[:, [1, 2, 0]] + np.asarray(obstacle.centre), tube.faces)
    assert isinstance(obstacle, Capsule)
    start, end = np.asarray(obstacle.start, float), np.asarray(obstacle.end, float)
    length, r = float(np.linalg.norm(end - start)), obstacle.radius
    t = np.linspace(0.0, 0.5 * pi, 6)
    along = np.concatenate([-r * np.cos(t), length + r * np.sin(t)])
    capsule = lathe(along, np.concatenate([r * np.sin(t), r * np.cos(t)]))
    # A rotation whose first column is the direction.
    x = (end - start) / length if length > 0 else np.array([1.0, 0.0, 0.0])
    y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
    y /= np.linalg.norm(y)
    turn = np.column_stack([x, y, np.cross(x, y)])
    return _mesh(capsule.vertices @ turn.T + start, capsule.faces)


def placed_surface(mesh: PlacedMesh, most: int = MOST_DRAWN) -> Mesh:
    """Return the surface of a mesh, in `n`.

    One of more than `most` triangles is coarsened: vertices in one cell of a grid become one.
    """
    vertices = mesh.vertices
    faces: NDArray[np.integer] = mesh.corners
    low = vertices.min(axis=0)
    cell = float(np.ptp(vertices, axis=0).max()) / 512
    while len(faces) > most:
        key = np.floor((mesh.vertices - low) / cell).astype(np.int64)
        _, same, counts = np.unique(key, axis=0, return_inverse=True, return_counts=True)
        same = same.reshape(-1)
        sums = [np.bincount(same, column) for column in mesh.vertices.T]
        vertices, faces = np.stack(sums, axis=1) / counts[:, None], same[mesh.corners]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        cell *= 1.25
    return _mesh(vertices, faces)


def terrain_mesh(terrain: Terrain, nodes: int = 160) -> Mesh:
    """Return the height field with at most `nodes` a side, without cells of an unknown corner."""
    n, m = terrain.z.shape
    rows, columns = _picks(n, nodes), _picks(m, nodes)
    z = terrain.z[np.ix_(rows, columns)]
    north = terrain.origin[0] + rows * terrain.spacing
    east = terrain.origin[1] + columns * terrain.spacing
    grid = np.stack([*np.meshgrid(north, east, indexing="ij"), z], axis=-1).reshape(-1, 3)
    i = np.arange(len(rows) * len(columns)).reshape(len(rows), len(columns))
    a, b, c, d = i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]
    faces = np.concatenate([
        np.stack([a, c, b], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)
    ])  # fmt: skip
    known = np.isfinite(grid[:, 2])
    faces = faces[known[faces].all(axis=1)]
    used, faces = np.unique(faces, return_inverse=True)
    return _mesh(grid[used], faces.reshape(-1, 3))


def cropped(terrain: Terrain, low: Array, high: Array, margin: float) -> Terrain:
    """Return the part of a height field within a margin [m] of a box; all if there is none."""
    parts, origin = [], []
    for i in range(2):
        n, start = terrain.z.shape[i], terrain.origin[i]
        first = int(np.clip((low[i] - margin - start) // terrain.spacing, 0, n))
        last = int(np.clip((high[i] + margin - start) // terrain.spacing + 2, 0, n))
        parts.append(slice(first, last))
        origin.append(start + first * terrain.spacing)
    z = terrain.z[parts[0], parts[1]]
    if min(z.shape) < 2 or not np.isfinite(z).any():
        return terrain
    return replace(terrain, z=z, origin=(origin[0], origin[1]), sigma=None, material=None)


def _picks(n: int, most: int) -> NDArray[np.intp]:
    """Return every k-th index, and the last."""
    step = ceil(n / most)
    picks = np.arange(0, n, step)
    return picks if picks[-1] == n - 1 else np.append(picks, n - 1)
