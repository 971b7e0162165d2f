"""Files of a terrain: GeoTIFF, height map, mesh, Gazebo world, .npz or a scene's folder."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import atan2, hypot
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.scene.shared.extra import import_extra

if TYPE_CHECKING:
    from rasterio import Affine
    from rasterio.io import DatasetWriter
    from trimesh import Trimesh

__all__ = ["check_target", "check_whole", "elevation_geotiff", "surface", "write_terrain"]

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
            f"{len(triangles):,} triangles are too many for a mesh file "
            f"({_MOST_TRIANGLES:,}); take a coarser --resolution or a piece"
        )
    north = terrain.origin[0] + terrain.spacing * np.arange(rows, dtype=np.float32)
    east = terrain.origin[1] + terrain.spacing * np.arange(columns, dtype=np.float32)
    n, e = np.meshgrid(north, east, indexing="ij")
    used, inverse = np.unique(triangles, return_inverse=True)
    vertices = np.stack([n.ravel()[used], e.ravel()[used], terrain.z.ravel()[used]], axis=1)
    return vertices.astype(np.float32), inverse.reshape(-1, 3)


def write_glb(scene: Scene, terrain: Terrain, target: Path) -> None:
    """Write the seabed, coloured by depth, and obstacles, and meshes; y is up, -z north (glTF)."""
    trimesh = import_extra("trimesh", "writing a mesh")
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


def write_terrain(scene: Scene, target: Path) -> list[Path]:
    """Write the format of the target's ending (none: a scene's folder); return the files."""
    check_target(target)
    assert scene.terrain is not None
    target.parent.mkdir(parents=True, exist_ok=True)
    if not target.suffix:
        save_scene(scene, target)
        meshes = dict.fromkeys(m.file.name for m in scene.meshes)
        return [target / name for name in ("scene.yaml", "terrain.npz", *meshes)]
    write = _WRITERS[target.suffix.lower()]
    if write is write_sdf:  # names the mesh beside it
        return write_sdf(scene, scene.terrain, target)
    with whole_file(target) as scratch:
        write(scene, scene.terrain, scratch)
    return [target]


def check_target(target: Path) -> None:
    """Raise InputInvalid for an unknown ending, or a target that is a folder or file already."""
    if target.suffix and target.suffix.lower() not in _WRITERS:
        raise InputInvalid(
            f"{target}: expected {', '.join(_WRITERS)}, or a folder's name without an ending"
        )
    if not target.suffix and target.is_file():
        raise InputInvalid(target, "there is a file of this name", "a folder to write")
    if target.suffix and target.is_dir():
        raise InputInvalid(target, "there is a folder of this name", "a file to write")


@contextmanager
def elevation_geotiff(
    target: Path, shape: tuple[int, int], transform: Affine, crs: str, names: Sequence[str],
    **tags: str,
) -> Iterator[DatasetWriter]:  # fmt: skip
    """Open a GeoTIFF with bands of these names in m, and check it at the end.

    Pixels are centred on the nodes. Raises `OSError` if it cannot be written whole.
    """
    rasterio = import_extra("rasterio", "writing a GeoTIFF")
    with rasterio.open(
        target, "w", driver="GTiff", height=shape[0], width=shape[1], count=len(names),
        dtype="float32", crs=crs or None, nodata=np.nan, transform=transform,
        compress="deflate", predictor=3, tiled=True, blockxsize=256, blockysize=256,
        bigtiff="if_safer",
    ) as out:  # fmt: skip
        yield out
        for number, name in enumerate(names, 1):
            out.set_band_description(number, name)
            out.set_band_unit(number, "m")
        out.update_tags(AREA_OR_POINT="Point", **tags)
    check_whole(target)


def check_whole(file: Path) -> None:
    """Read a GeoTIFF back and raise `OSError` if that fails: GDAL reports no full disk."""
    rasterio = import_extra("rasterio", "writing a GeoTIFF")
    try:
        with rasterio.open(file) as written:
            for band in written.indexes:
                for _, window in written.block_windows(band):
                    written.read(band, window=window)
    except rasterio.errors.RasterioError:
        raise OSError("the file is incomplete; is the disk full?") from None


def write_tif(scene: Scene, terrain: Terrain, target: Path) -> None:
    """Write elevation (= -depth) and its standard deviation."""
    rasterio = import_extra("rasterio", "writing a GeoTIFF")
    h = terrain.spacing
    west = terrain.easting + terrain.origin[1]
    north = terrain.northing + terrain.origin[0] + h * (terrain.z.shape[0] - 1)
    bands = {"elevation": -terrain.z}
    if terrain.sigma is not None:
        bands["sigma"] = terrain.sigma
    with elevation_geotiff(
        target, (terrain.z.shape[0], terrain.z.shape[1]),
        rasterio.Affine(h, 0, west - h / 2, 0, -h, north + h / 2), terrain.crs, list(bands),
        VERTICAL_DATUM=terrain.vertical_datum or "not stated", SOURCE=terrain.source,
        NOTE="elevation = -depth; sigma: standard deviation of interpolation and soundings, "
        "none on land; not for navigation",
    ) as out:  # fmt: skip
        for number, band in enumerate(bands.values(), 1):
            out.write(np.ascontiguousarray(band[::-1], np.float32) + 0.0, number)


def write_png(scene: Scene, terrain: Terrain, target: Path) -> None:
    """Write a 16-bit height map, north up; 0 is unknown, 1 the deepest, 65535 the highest."""
    height = -terrain.z[::-1].astype(np.float64)
    low, high = float(np.nanmin(height)), float(np.nanmax(height))
    step = max(high - low, 1e-6) / 65534
    levels = np.where(
        np.isnan(height), 0, 1 + np.rint((np.nan_to_num(height, nan=low) - low) / step)
    )
    texts = {
        "Description": f"elevation in m = {low:.6f} + (level - 1) * {step:.9g}; level 0: unknown; "
        f"{terrain.spacing:g} m a pixel, north up, {terrain.crs}; not for navigation",
        "Source": terrain.source,
    }

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    rows, columns = levels.shape
    lines = np.zeros((rows, 1 + 2 * columns), np.uint8)  # each line opens with filter 0
    lines[:, 1:] = levels.astype(">u2").view(np.uint8).reshape(rows, 2 * columns)
    written = b"".join(
        chunk(b"tEXt", key.encode("latin-1") + b"\0" + text.encode("latin-1", "replace"))
        for key, text in texts.items()
    )
    target.write_bytes(
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", struct.pack(">IIBBBBB", columns, rows, 16, 0, 0, 0, 0))
        + written
        + chunk(b"IDAT", zlib.compress(lines.tobytes(), 6))
        + chunk(b"IEND", b"")
    )


_WRITERS: dict[str, Callable[[Scene, Terrain, Path], object]] = {
    ".tif": write_tif,
    ".tiff": write_tif,
    ".png": write_png,
    ".glb": write_glb,
    ".sdf": write_sdf,
    ".npz": lambda _, terrain, target: save_terrain(terrain, target),
}
