"""Files of a map or its points for other tools: GeoTIFF, LAZ, LAS, PLY.

Files are written whole or not at all. If writing fails, an earlier file of that name stays.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.cache import whole_file, write_whole
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.mapping.mapping import SeabedMap
from uuvsim_cosim.scene.shared.extra import import_extra

__all__ = ["check_target", "write_geotiff", "write_las", "write_ply"]

Array = NDArray[np.float64]
NODATA = -9999.0


def check_target(file: Path, crs: str = "") -> None:
    """Raise InputInvalid if a file cannot be written: its folder, or a library, is missing.

    Call it before long computations. `crs` is that of the points, if it is known.
    """
    if not file.absolute().parent.is_dir():
        raise InputInvalid(file, "its folder does not exist", "a file in a folder")
    ending = file.suffix.lower()
    if ending in (".tif", ".tiff"):
        import_extra("rasterio", f"{file}: writing a GeoTIFF")
    if ending in (".las", ".laz"):
        import_extra("laspy", f"{file}: writing points")
        if ending == ".laz":
            import_extra("lazrs", f"{file}: compressing points (.las needs nothing more)")
        if crs:
            import_extra("pyproj", f"{file}: a CRS")


def write_geotiff(made: SeabedMap, file: Path, pose: str = "true") -> Path:
    """Write elevation (up from the vertical datum) [m], and as a second band its error.

    Its CRS is the scene's; without one, coordinates are metres of the local frame.
    """
    rasterio = import_extra("rasterio", f"{file}: writing a GeoTIFF")
    if pose not in made.depth:
        raise InputInvalid(f"pose {pose!r}", f"one of {', '.join(made.depth)}")
    w = made.window
    north = made.northing + w.north + w.rows * w.cell
    transform = rasterio.Affine(w.cell, 0.0, made.easting + w.east, 0.0, -w.cell, north)
    bands = (-made.depth[pose], -(made.depth[pose] - made.truth))
    tags = {"VERTICAL_DATUM": made.vertical_datum or "local", "POSE": pose, "SCENE": made.scene,
            "NOTE": "simulated survey; not for navigation"}  # fmt: skip
    try:
        with rasterio.MemoryFile() as memory:  # GDAL reports no error if the disk is full
            with memory.open(
                driver="GTiff", height=w.rows, width=w.columns, count=2, dtype="float32",
                crs=made.crs or None, transform=transform, nodata=NODATA, compress="deflate",
            ) as out:  # fmt: skip
                for i, (band, words) in enumerate(
                    zip(bands, ("elevation [m]", "error of elevation [m]"), strict=True), 1
                ):
                    flipped = band[::-1].astype(np.float32)
                    out.write(np.where(np.isfinite(flipped), flipped, np.float32(NODATA)), i)
                    out.set_band_description(i, words)
                out.update_tags(**tags)
            write_whole(file, bytes(memory.getbuffer()))
    except rasterio.errors.RasterioError as error:
        raise InputInvalid(f"{file}: cannot be written ({error})") from None
    except OSError as error:
        raise InputInvalid(f"{file}: cannot be written ({error.strerror or error})") from None
    return file


def write_las(batches: Iterable[Array], file: Path, crs: str = "",
              origin: tuple[float, float] = (0.0, 0.0)) -> int:  # fmt: skip
    """Write points N E D [m] as easting, northing, elevation; compressed if it is a .laz.

    `origin` is northing and easting of the local frame in `crs`. Returns the number of points.
    """
    laspy = import_extra("laspy", f"{file}: writing points")
    failures: tuple[type[Exception], ...] = (OSError,)
    if file.suffix.lower() == ".laz":
        lazrs = import_extra("lazrs", f"{file}: compressing points (.las needs nothing more)")
        failures = (OSError, lazrs.LazrsError)
    header = laspy.LasHeader(point_format=6, version="1.4")
    header.scales = np.full(3, 0.001)
    header.offsets = np.array([np.floor(origin[1]), np.floor(origin[0]), 0.0])
    if crs:
        pyproj = import_extra("pyproj", f"{file}: a CRS")
        header.add_crs(pyproj.CRS.from_user_input(crs))
    total = 0
    try:
        with (
            whole_file(file) as scratch,
            scratch.open("w+b") as raw,
            laspy.open(raw, mode="w", header=header, closefd=False) as out,
        ):
            for xyz in batches:
                record = laspy.ScaleAwarePointRecord.zeros(len(xyz), header=header)
                record.x, record.y = xyz[:, 1] + origin[1], xyz[:, 0] + origin[0]
                record.z = -xyz[:, 2]
                out.write_points(record)
                total += len(xyz)
    except failures as error:
        why = getattr(error, "strerror", None) or error
        raise InputInvalid(f"{file}: cannot be written ({why})") from None
    return total


def write_ply(batches: Iterable[Array], file: Path) -> int:
    """Write points N E D [m] as binary PLY: x east, y north, z up, in float32 of the local frame.

    Returns the number of points.
    """
    head = "ply\nformat binary_little_endian 1.0\ncomment x east y north z up [m]\n"
    form = (
        "element vertex {:>12d}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    )
    total = 0
    try:
        with whole_file(file) as scratch, scratch.open("wb") as out:
            out.write((head + form.format(0)).encode())
            for xyz in batches:
                turned = np.column_stack([xyz[:, 1], xyz[:, 0], -xyz[:, 2]])
                out.write(turned.astype("<f4").tobytes())
                total += len(xyz)
            out.seek(0)
            out.write((head + form.format(total)).encode())  # of the same length as before
    except OSError as error:
        raise InputInvalid(f"{file}: cannot be written ({error.strerror})") from None
    return total
