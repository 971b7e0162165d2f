"""Surfaces of a scene as files: one GLB, or a Gazebo world with an STL beside it."""

from __future__ import annotations

import struct
from math import atan2, hypot
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.extra import wanted

if TYPE_CHECKING:
    from trimesh import Trimesh

__all__ = ["surface", "write_glb", "write_sdf"]

_MOST_TRIANGLES = 20_000_000  # of a file; viewers fail with far fewer
_SHALLOW, _DEEP, _LAND = (225, 205, 150), (20, 50, 110), (110, 130, 90)  # RGB


def surface(terrain: Terrain) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return vertices N, E, D (m) and triangles, as the caster cuts the known cells.

    Seen from above, triangles turn anticlockwise about the upward normal.
    """
    rows, columns = terrain.z.shape
    node = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]
    # a (i, j), b (i+1, j) north of it, c (i+1, j+1), d (i, j+1) east of it; cut from a to c
    triangles = np.concatenate([np.stack(t, -1).reshape(-1, 3) for t in ((a, c, b), (a, d, c))])
    known = np.isfinite(terrain.z).ravel()
    triangles = triangles[known[triangles].all(axis=1)]
    if not len(triangles):
        raise InputInvalid("no cell of the terrain has a depth at all its corners")
    if len(triangles) > _MOST_TRIANGLES:
        raise InputInvalid(
            f"{len(triangles):,} triangles are more than a mesh file can do with "
            f"({_MOST_TRIANGLES:,}); take a coarser --resolution or a piece"
        )
    north = terrain.origin[0] + terrain.spacing * np.arange(rows, dtype=np.float32)
    east = terrain.origin[1] + terrain.spacing * np.arange(columns, dtype=np.float32)
    n, e = np.meshgrid(north, east, indexing="ij")
    used, inverse = np.unique(triangles, return_inverse=True)
    vertices = np.stack([n.ravel()[used], e.ravel()[used], terrain.z.ravel()[used]], axis=1)
    return vertices.astype(np.float32), inverse.reshape(-1, 3)


def write_glb(scene: Scene, terrain: Terrain, target: Path) -> list[Path]:
    """Write the seabed, coloured by depth, and obstacles, and meshes; y is up, -z north (glTF)."""
    trimesh = wanted("trimesh", "writing a mesh")
    vertices, triangles = surface(terrain)
    z = vertices[:, 2]
    part = np.clip(z / max(float(z.max()), 1e-6), 0, 1)[:, None] ** 0.6
    colour = (1 - part) * np.array(_SHALLOW) + part * np.array(_DEEP)
    colour[z < 0] = _LAND
    rgba = np.column_stack([colour, np.full(len(z), 255)]).astype(np.uint8)
    seabed = trimesh.Trimesh(_gltf(vertices), triangles, vertex_colors=rgba, process=False)
    model = trimesh.Scene()
    model.add_geometry(seabed, node_name="seabed", geom_name="seabed")
    bodies = [_body(trimesh, o) for o in scene.obstacles]
    bodies += [trimesh.Trimesh(_gltf(m.vertices), m.corners, process=False) for m in scene.meshes]
    if bodies:
        joined = trimesh.util.concatenate(bodies)
        joined.visual = trimesh.visual.ColorVisuals(joined, face_colors=(150, 90, 70, 255))
        model.add_geometry(joined, node_name="obstacles", geom_name="obstacles")
    target.write_bytes(model.export(file_type="glb"))
    return [target]


def _gltf(ned: NDArray[np.floating]) -> NDArray[np.floating]:
    """Turn N, E, D into glTF's x east, y up, z south."""
    return np.stack([ned[:, 1], -ned[:, 2], -ned[:, 0]], axis=1)


def _body(trimesh: ModuleType, obstacle: Obstacle) -> Trimesh:
    """Return an obstacle's surface in glTF's axes."""
    if isinstance(obstacle, Box):
        body = trimesh.creation.box(2 * np.array(obstacle.half))
        body.apply_transform(trimesh.transformations.rotation_matrix(obstacle.yaw, (0, 0, 1)))
        body.apply_translation(obstacle.centre)
    elif isinstance(obstacle, Sphere):
        body = trimesh.creation.icosphere(2, obstacle.radius)
        body.apply_translation(obstacle.centre)
    elif isinstance(obstacle, Cylinder):
        body = trimesh.creation.cylinder(obstacle.radius, 2 * obstacle.half_height, sections=16)
        body.apply_translation(obstacle.centre)
    else:
        ends = np.array([obstacle.start, obstacle.end])
        body = trimesh.creation.cylinder(obstacle.radius, segment=ends, sections=8)
    return trimesh.Trimesh(_gltf(body.vertices), body.faces, process=False)


def write_sdf(scene: Scene, terrain: Terrain, target: Path) -> list[Path]:
    """Write a Gazebo world (SDF 1.9, x east, y north, z up) and seabed and meshes as STL beside."""
    vertices, triangles = surface(terrain)
    enu = np.stack([vertices[:, 1], vertices[:, 0], -vertices[:, 2]], axis=1)
    mesh = target.with_suffix(".stl")
    mesh.write_bytes(_stl(enu, triangles))
    uri = escape(mesh.name)
    about = escape(f"{terrain.source}; datum {terrain.vertical_datum or 'not stated'}").replace(
        "--", "- -"
    )
    shape = f"<geometry><mesh><uri>{uri}</uri></mesh></geometry>"
    parts = [
        '<?xml version="1.0"?>',
        f"<!-- {about} -->",
        '<sdf version="1.9">',
        f"  <world name={quoteattr(scene.name)}>",
        '    <light type="directional" name="sun"><direction>-0.3 0.2 -0.9</direction></light>',
        '    <model name="seabed">',
        "      <static>true</static>",
        '      <link name="seabed">',
        f'        <collision name="seabed">{shape}</collision>',
        f'        <visual name="seabed">{shape}</visual>',
        "      </link>",
        "    </model>",
    ]
    parts += [_sdf_model(k, o) for k, o in enumerate(scene.obstacles)]
    files = [target, mesh]
    for k, m in enumerate(scene.meshes, len(scene.obstacles)):
        file = target.with_name(f"{target.stem}_{k}.stl")
        n, e, d = m.vertices.T
        file.write_bytes(_stl(np.stack([e, n, -d], axis=1), m.corners))
        geometry = f"<geometry><mesh><uri>{escape(file.name)}</uri></mesh></geometry>"
        parts.append(_sdf_body(f"{k} {m.name}".strip(), "0 0 0 0 0 0", geometry))
        files.append(file)
    parts += ["  </world>", "</sdf>", ""]
    target.write_text("\n".join(parts), encoding="utf-8")
    return files


def _stl(vertices: NDArray[np.floating], triangles: NDArray[np.integer]) -> bytes:
    corners = vertices[triangles].astype("<f4")
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal /= np.where(length > 0.0, length, 1.0)
    record = np.zeros(
        len(triangles), np.dtype([("n", "<f4", 3), ("v", "<f4", (3, 3)), ("attribute", "<u2")])
    )
    record["n"], record["v"] = normal, corners
    return bytes(80) + struct.pack("<I", len(triangles)) + record.tobytes()


def _sdf_model(number: int, o: Obstacle) -> str:
    """Return one obstacle as a static model; ENU, so yaw from N towards E becomes pi/2 - yaw."""
    turn = "0 0 0"
    if isinstance(o, Box):
        n, e, d = o.centre
        turn = f"0 0 {np.pi / 2 - o.yaw:.6f}"
        shape = f"<box><size>{' '.join(f'{2 * h:.3f}' for h in o.half)}</size></box>"
    elif isinstance(o, Sphere):
        n, e, d = o.centre
        shape = f"<sphere><radius>{o.radius:g}</radius></sphere>"
    elif isinstance(o, Cylinder):
        n, e, d = o.centre
        length = f"<length>{2 * o.half_height:.3f}</length>"
        shape = f"<cylinder><radius>{o.radius:g}</radius>{length}</cylinder>"
    else:
        n, e, d = ((a + b) / 2 for a, b in zip(o.start, o.end, strict=True))
        north, east, down = (b - a for a, b in zip(o.start, o.end, strict=True))
        level = hypot(north, east)
        # SDF's capsule lies along z: pitched about y by its angle from the vertical, then yawed
        turn = f"0 {atan2(level, -down):.6f} {atan2(north, east):.6f}"
        length = f"<length>{hypot(level, down):.3f}</length>"
        shape = f"<capsule><radius>{o.radius:g}</radius>{length}</capsule>"
    pose = f"{e:.3f} {n:.3f} {-d:.3f} {turn}"
    return _sdf_body(f"{number} {o.name}".strip(), pose, f"<geometry>{shape}</geometry>")


def _sdf_body(name: str, pose: str, geometry: str) -> str:
    return (
        f"    <model name={quoteattr(name)}><static>true</static><pose>{pose}</pose>"
        f'<link name="body"><collision name="body">{geometry}</collision>'
        f'<visual name="body">{geometry}</visual></link></model>'
    )
