"""Files of a terrain: GeoTIFF, height map, mesh, Gazebo world, .npz or a scene's folder."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import whole_file
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain, save_terrain
from uuvsim_cosim.scene.shared.extra import wanted
from uuvsim_cosim.scene.terrain.mesh import write_glb, write_sdf

__all__ = ["check_target", "check_whole", "write_terrain"]


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
        return write(scene, scene.terrain, target)
    with whole_file(target) as scratch:
        write(scene, scene.terrain, scratch)
        if write is _tif:
            check_whole(scratch)
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


def check_whole(file: Path) -> None:
    """Read a GeoTIFF back and raise `OSError` if that fails: GDAL reports no full disk."""
    rasterio = wanted("rasterio", "writing a GeoTIFF")
    try:
        with rasterio.open(file) as written:
            for band in written.indexes:
                for _, window in written.block_windows(band):
                    written.read(band, window=window)
    except rasterio.errors.RasterioError:
        raise OSError("it did not arrive whole; is the disk full?") from None


def _npz(scene: Scene, terrain: Terrain, target: Path) -> list[Path]:
    save_terrain(terrain, target)
    return [target]


def _tif(scene: Scene, terrain: Terrain, target: Path) -> list[Path]:
    """Write elevation (= -depth) and its standard deviation; pixels are centred on the nodes."""
    rasterio = wanted("rasterio", "writing a GeoTIFF")
    h = terrain.spacing
    west = terrain.easting + terrain.origin[1]
    north = terrain.northing + terrain.origin[0] + h * (terrain.z.shape[0] - 1)
    bands = [-terrain.z] + ([] if terrain.sigma is None else [terrain.sigma])
    with rasterio.open(
        target, "w", driver="GTiff", height=terrain.z.shape[0], width=terrain.z.shape[1],
        count=len(bands), dtype="float32", crs=terrain.crs or None, nodata=np.nan,
        transform=rasterio.Affine(h, 0, west - h / 2, 0, -h, north + h / 2),
        compress="deflate", predictor=3, tiled=True, blockxsize=256, blockysize=256,
        bigtiff="if_safer",
    ) as out:  # fmt: skip
        names = ("elevation", "sigma")
        for number, band in enumerate(bands, 1):
            out.write(np.ascontiguousarray(band[::-1], np.float32) + 0.0, number)
            out.set_band_description(number, names[number - 1])
            out.set_band_unit(number, "m")
        out.update_tags(
            AREA_OR_POINT="Point",
            VERTICAL_DATUM=terrain.vertical_datum or "not stated",
            SOURCE=terrain.source,
            NOTE="elevation = -depth; sigma: standard deviation of interpolation and soundings, "
            "none on land; not for navigation",
        )
    return [target]


def _png(scene: Scene, terrain: Terrain, target: Path) -> list[Path]:
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
    return [target]


_WRITERS: dict[str, Callable[[Scene, Terrain, Path], list[Path]]] = {
    ".tif": _tif,
    ".tiff": _tif,
    ".png": _png,
    ".glb": write_glb,
    ".sdf": write_sdf,
    ".npz": _npz,
}
