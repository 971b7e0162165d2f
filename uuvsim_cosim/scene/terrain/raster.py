"""Terrain of a surveyed grid (BAG, GeoTIFF, S-102), also of files larger than memory.

GDAL's warper reads the file piece by piece, so that only the terrain itself is in memory.
"""

from __future__ import annotations

import re
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.chart.projection import Projection, utm_code
from uuvsim_cosim.scene.shared.extra import import_extra
from uuvsim_cosim.scene.terrain.chart import DescribedTerrain
from uuvsim_cosim.scene.terrain.grid import Bounds, Grid, Piece, cropped_terrain, grid_over
from uuvsim_cosim.scene.terrain.relief_lost import place, relief_lost

if TYPE_CHECKING:
    from rasterio import DatasetReader
    from rasterio.crs import CRS
    from rasterio.enums import Resampling

__all__ = ["raster_terrain"]

Floats = NDArray[np.floating]
_DEEPEST, _HIGHEST = 11_100.0, 9_000.0  # m; beyond lies nothing on Earth
_METRES = {
    "": 1.0, "m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0,
    "cm": 0.01, "centimetre": 0.01, "centimeter": 0.01, "dm": 0.1,
    "ft": 0.3048, "foot": 0.3048, "feet": 0.3048, "us survey foot": 1200 / 3937,
    "us-ft": 1200 / 3937, "ftus": 1200 / 3937, "us_survey_foot": 1200 / 3937,
    "fathom": 1.8288, "fathoms": 1.8288,
}  # fmt: skip
_LOCAL = "EPSG:32631"  # any projection in metres: a local grid is not placed on Earth
_FILL_GROWTH = 0.05  # m of standard deviation per m of distance in filled holes: assumed


@dataclass(frozen=True)
class _Convention:
    """How a grid stores its values: unit, direction, datum, scaling."""

    metre: float  # m in one unit
    down: bool  # positive downwards
    datum: str
    sigma_band: int  # 0: none
    scaling: tuple[tuple[float, float], ...]  # of each band: scale and offset of the stored numbers

    def metres(self, band: int) -> tuple[float, float]:
        """Return factor and offset from the numbers that a band stores to m."""
        scale, offset = self.scaling[band - 1]
        return scale * self.metre, offset * self.metre


def raster_terrain(
    file: Path,
    resolution: float | None = None,
    piece: Piece | None = None,
    *,
    unit: str | None = None,
    positive: str | None = None,
    fill: float = 0.0,
    crs: str | None = None,
    local: bool = False,
) -> DescribedTerrain:
    """Make a terrain of the first band of a grid that GDAL reads.

    Without `resolution` [m], the nodes are the centres of the grid's own cells. Relief that is lost
    between the nodes is reported and included in sigma. `unit` and `positive` ("up" or "down")
    apply where the file does not state them; `fill` [m] bridges holes up to that far from data.
    A grid without a coordinate reference system needs `crs` ("EPSG:32632") or `local`: x is east
    and y is north [m] in the local frame. Raises `InputInvalid`.
    """
    rasterio = import_extra("rasterio", "reading a grid")
    import_extra("rasterio.warp", "reading a grid")
    notes: list[str] = []
    with _opened(file, resolution, notes) as source:
        reference = _reference(file, source, crs, local, notes)
        convention = _convention(file, source, reference, unit, positive, notes)
        code, bounds, own, first = _placement(source, reference)
        if not np.isfinite(bounds).all():
            raise InputInvalid(f"{file}: its corners cannot be placed in {code}")
        if piece is not None:
            if local:
                raise InputInvalid("--around with --local; a local grid has no latitude, longitude")
            pyproj = import_extra("pyproj", "placing a grid on Earth")
            to = pyproj.Transformer.from_crs("EPSG:4326", code, always_xy=True)
            bounds = piece.within(Projection(code, to), bounds)
        spacing = own if resolution is None else resolution
        grid = grid_over(bounds, spacing, first=first)
        same = first is not None and abs(spacing / own - 1) < 1e-9  # nothing is resampled
        way = rasterio.enums.Resampling
        finer = spacing < own * (1 + 1e-9)
        elevation, sigma = _layers(
            file, source, reference, code, grid, way.nearest if same else way.bilinear if finer else
            way.average, convention,
        )  # fmt: skip
        if spacing < own * 0.99:
            notes.append(
                f"the grid's cells are about {own:.3g} m: {spacing:g} m interpolates between them "
                "and adds no detail"
            )
        lost = None
        if not same:
            lost = relief_lost(source, reference, code, grid, elevation, convention.metres(1))
        if lost is not None:
            part = "" if lost.compared == 1 else f", from {100 * lost.compared:.2g} % of the cells"
            notes.append(
                f"resampled to nodes at {spacing:.6g} m: relief of {lost.rms:.3g} m RMS, "
                f"{100 * lost.share:.2g} % of the grid's variance, lies between them{part}; "
                f"sigma {'includes it' if sigma is not None else 'is this relief alone'}"
            )
            spread: Floats = lost.sigma.astype(np.float32)
            sigma = spread if sigma is None else np.hypot(sigma, spread)
    z = elevation if convention.down else -elevation
    sense = z[np.isfinite(z)]
    if not len(sense):
        raise InputInvalid(f"{file}: not one cell has a value in this piece")
    if sense.max() > _DEEPEST or -sense.min() > _HIGHEST:
        raise InputInvalid(
            f"{file}: depths from {sense.min():g} to {sense.max():g} m are not of this Earth; "
            "a value for missing data that the file does not declare, or another unit (--unit)"
        )
    if sense.max() <= 0 and sense.min() < 0 and positive is None:
        raise InputInvalid(
            f"{file}: all values ({-sense.max() + 0.0:g} to {-sense.min():g} m) lie above the "
            f"datum; if they are {'heights' if convention.down else 'depths'}, say --positive "
            f"{'up' if convention.down else 'down'}"
        )
    z, sigma = _without_holes(z, sigma, grid.spacing, fill, notes)
    origin_note = f"{file.name}; not for navigation"
    terrain = cropped_terrain(z, sigma, None, (), grid, code, convention.datum, origin_note)
    if local:
        origin = terrain.northing + terrain.origin[0], terrain.easting + terrain.origin[1]
        terrain = replace(terrain, origin=origin, crs="", northing=0.0, easting=0.0)
    z = terrain.z[np.isfinite(terrain.z)] + 0.0  # no -0.0
    doubt = "not stated"
    if terrain.sigma is not None and np.isfinite(terrain.sigma).any():
        doubt = f"{np.nanmedian(terrain.sigma):.2f} m, the median"
    facts = {
        "grid": f"{file.name}: {terrain.z.shape[0]} x {terrain.z.shape[1]} nodes at "
        f"{terrain.spacing:g} m, {terrain.crs or 'local frame'}, origin N {terrain.northing:.9g} "
        f"E {terrain.easting:.9g}",
        "datum": convention.datum or "not stated",
        "depth": f"{z.min():.2f} to {z.max():.2f} m",
        "known": f"{100 * len(z) / terrain.z.size:.1f} % of nodes",
        "uncertainty": doubt,
    }
    return DescribedTerrain(terrain, (), facts, tuple(notes))


def _opened(file: Path, resolution: float | None, notes: list[str]) -> DatasetReader:
    """Open a grid; a BAG of variable resolution with refined cells, not their coarse summary."""
    rasterio = import_extra("rasterio", "reading a grid")
    try:
        source: DatasetReader = rasterio.open(file)
        tags = source.tags()
        if source.driver == "BAG" and tags.get("HAS_SUPERGRIDS") == "TRUE":
            finest, coarsest = (float(tags[f"{m}_RESOLUTION_X"]) for m in ("MIN", "MAX"))
            step = min(max(resolution or finest, finest), coarsest)
            notes.append(f"variable resolution: cells of {finest:.3g} to {coarsest:.3g} m")
            with source:
                source = rasterio.open(
                    source.name, MODE="RESAMPLED_GRID", RESX=step, RESY=step,
                    VALUE_POPULATION="MEAN",
                )  # fmt: skip
    except Exception as reason:
        bare = file.suffix.lower() in (".h5", ".hdf5") and "not recognized" in str(reason)
        hint = "; of S-102, GDAL 3.10 reads files with an uncertainty only" if bare else ""
        raise InputInvalid(
            f"{file}: neither an S-57 chart nor a grid that GDAL reads (BAG, GeoTIFF, S-102): "
            f"{reason}{hint}"
        ) from None
    with ExitStack() as ending:
        ending.push(source)
        if source.count < 1:
            subs = ", ".join(source.subdatasets[:3])
            raise InputInvalid(f"{file}: no band in it" + (f"; it holds {subs}" if subs else ""))
        if np.dtype(source.dtypes[0]).kind not in "iuf":
            raise InputInvalid(file, f"band 1 is {source.dtypes[0]}", "numbers")
        for band, scale, offset in zip(source.indexes, source.scales, source.offsets, strict=True):
            if not (np.isfinite([scale, offset]).all() and scale):
                raise InputInvalid(
                    file,
                    f"band {band} has the scale {scale:g} and the offset {offset:g}",
                    "a scale that is finite and not 0, and a finite offset",
                )
        ending.pop_all()
    return source


def _reference(
    file: Path, source: DatasetReader, crs: str | None, local: bool, notes: list[str]
) -> CRS:
    """Return the coordinate reference system that the file or the user states."""
    rasterio = import_extra("rasterio", "reading a grid")
    if crs is not None and local:
        raise InputInvalid(f"--crs {crs} with --local", "one of the two")
    given = _LOCAL if local else crs
    if given is None:
        if source.crs is not None:
            return source.crs
        raise InputInvalid(
            file,
            "the grid has no coordinate reference system",
            (
                "--crs EPSG:… (such as EPSG:32632), or --local if x is east and y "
                "is north in metres of the local frame"
            ),
        )
    try:
        chosen = rasterio.crs.CRS.from_user_input(given)
    except rasterio.errors.CRSError:
        raise InputInvalid(f"--crs {crs}", "a code such as EPSG:32632") from None
    if source.crs is not None and source.crs != chosen:
        option = "--local" if local else f"--crs {crs}"
        raise InputInvalid(f"{option}: the file states {source.crs.to_string()}")
    if source.transform.is_identity:
        notes.append(
            "the file has no positions: its cells are assumed to be 1 unit wide, columns to the "
            "east and "
            "rows to the north"
        )
    return chosen


def _placement(
    source: DatasetReader, crs: CRS
) -> tuple[str, Bounds, float, tuple[float, float] | None]:
    """Return the terrain's projection, bounds and size of cells there, and a first node.

    The projection is the grid's own if it is in true metres, else UTM. The bounds are those of the
    centres of the cells, between which nothing is extrapolated. The first node is the centre of a
    cell if all of them can be nodes, else None.
    """
    warp = import_extra("rasterio.warp", "reading a grid")
    name = crs.to_wkt()[:200].lower()
    true = crs.is_projected and crs.linear_units_factor[1] == 1.0 and "mercator" not in (
        name.replace("transverse", "").replace("transverse_mercator", "")
    )  # fmt: skip
    epsg = crs.to_epsg()
    if true and epsg and epsg != 3857:
        code = f"EPSG:{epsg}"
    else:
        west, south, east, north = warp.transform_bounds(crs, "EPSG:4326", *source.bounds)
        middle = 0.5 * (west + (east if east >= west else east + 360))
        code = utm_code((middle + 180) % 360 - 180, 0.5 * (south + north))
    t = source.transform
    west, south, east, north = source.bounds
    south, north = min(south, north), max(south, north)
    x, y = abs(t.a) / 2, abs(t.e) / 2
    if source.width < 2 or source.height < 2:
        x = y = 0
    centres = (west + x, south + y, east - x, north - y)
    bounds = warp.transform_bounds(crs, code, *centres, densify_pts=21)
    if crs.to_string() == code and t.b == t.d == 0:
        square = abs(abs(t.e / t.a) - 1) < 1e-9
        return code, bounds, min(abs(t.a), abs(t.e)), place(t, 0.5, 0.5) if square else None
    west, south, east, north = warp.transform_bounds(crs, code, *source.bounds)
    cell = min((east - west) / source.width, (north - south) / source.height)
    return code, bounds, float(f"{cell:.3g}"), None


def _convention(
    file: Path,
    source: DatasetReader,
    crs: CRS,
    unit: str | None,
    positive: str | None,
    notes: list[str],
) -> _Convention:
    tags = {k.lower(): str(v) for k, v in source.tags().items()}
    wkt = crs.to_wkt()
    stated = (source.units[0] or "").strip().lower()
    axis = re.search(r'VERT_CS\[.*?UNIT\["([^"]+)",([^],]+)(.*)', wkt, re.S)
    metres = dict(_METRES)
    if axis is not None:
        stated = stated or axis[1].lower()
        metres.setdefault(axis[1].lower(), float(axis[2]))
    if unit is not None and stated and metres.get(unit.lower()) != metres.get(stated):
        raise InputInvalid(f"{file}: --unit {unit}; the file says {stated}")
    chosen = (unit or stated).lower()
    if chosen not in metres:
        raise InputInvalid(file, f"values in {chosen!r}", "metres, feet, US survey feet or fathoms")
    metre = metres[chosen]
    for band, scale, offset in zip(source.indexes, source.scales, source.offsets, strict=True):
        if (scale, offset) != (1.0, 0.0):
            notes.append(
                f"band {band} states a scale and an offset, which are applied: value = {scale:g} x "
                f"stored number + {offset:g}"
            )
    if metre != 1.0:
        notes.append(f"values are in {chosen}: converted to metres")
    elif not stated and unit is None and source.driver == "GTiff":
        notes.append("the grid does not state its unit: metres are assumed (else --unit ft)")
    name = (source.descriptions[0] or "").lower()
    downward = (  # a BAG holds elevations, whatever its axis
        source.driver == "GTiff"
        and axis is not None
        and re.search(r'AXIS\["[^"]*",DOWN\]', axis[3]) is not None
    )
    down = source.driver == "S102" or "depth" in name or tags.get("positive") == "down" or downward
    if downward and positive is None:
        notes.append("the vertical axis of the file points down: its values are read as depths")
    if positive is not None:
        if positive not in ("up", "down"):
            raise InputInvalid(f"--positive {positive}", "up or down")
        down = positive == "down"
    datum = tags.get("vertical_datum_abbrev") or tags.get("vertical_datum_name") or tags.get(
        "vertical_datum", ""
    )  # fmt: skip
    if not datum:
        named = re.search(r'VERT_CS\["([^"]+)"', wkt)
        datum = named.group(1) if named else _bag_datum(source)
    if not datum:
        notes.append("the grid does not state its vertical datum")
    second = (source.descriptions[1] or "").lower() if source.count > 1 else ""
    has_sigma = source.count > 1 and (
        source.driver in ("BAG", "S102") or re.search("uncert|sigma|std|deviation", second)
    )
    scaling = tuple(zip(source.scales, source.offsets, strict=True))
    return _Convention(metre, down, datum, 2 if has_sigma else 0, scaling)


def _bag_datum(source: DatasetReader) -> str:
    if "xml:BAG" not in source.tag_namespaces():
        return ""
    text = " ".join(source.tags(ns="xml:BAG").values())
    part = re.search(r"verticalDatum>(.*?)</\w*:?verticalDatum>", text, re.S | re.I)
    code = re.search(r"<(?:\w+:)?code>\s*(?:<[^>]*>)?([^<]+)<", part.group(1)) if part else None
    if code is None:
        named = re.search(r'VERT(?:_CS|CRS)\["([^"]+)"', text.replace("&quot;", '"'))
        return named.group(1).strip() if named else ""
    return code.group(1).strip()


def _layers(
    file: Path,
    source: DatasetReader,
    crs: CRS,
    code: str,
    grid: Grid,
    way: Resampling,
    convention: _Convention,
) -> tuple[Floats, Floats | None]:
    vrt = import_extra("rasterio.vrt", "reading a grid")
    layers: list[Floats | None] = []
    try:
        with vrt.WarpedVRT(
            source, src_crs=crs, crs=code, transform=grid.transform, width=grid.columns,
            height=grid.rows, resampling=way, dtype="float32", nodata=np.nan,
            src_nodata=source.nodata if source.nodata is not None else None,
        ) as warped:  # fmt: skip
            for band in (1, convention.sigma_band):
                if not band:
                    layers.append(None)
                    continue
                read = warped.read(band, masked=True).astype(np.float32)
                factor, offset = convention.metres(band)
                stored = np.ma.filled(read, np.nan)[::-1].astype(np.float64)
                layers.append((factor * stored + offset).astype(np.float32))
    except Exception as reason:
        raise InputInvalid(f"{file}: GDAL cannot read its values: {reason}") from None
    first, second = layers
    assert first is not None
    if second is not None:
        second[(second < 0) | (second > _HIGHEST)] = np.nan
    return first, second


def _without_holes(
    z: Floats, sigma: Floats | None, spacing: float, fill: float, notes: list[str]
) -> tuple[Floats, Floats | None]:
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    known = np.isfinite(z)
    holes = binary_fill_holes(known) & ~known
    if not holes.any():
        return z, sigma
    if fill > 0:
        distance, at = distance_transform_edt(~known, sampling=spacing, return_indices=True)
        bridged = holes & (distance <= fill)
        filled = import_extra("rasterio.fill", "filling holes").fillnodata(
            np.where(known, z, 0).astype(np.float32), mask=known.astype(np.uint8),
            max_search_distance=fill / spacing + 1,
        )  # fmt: skip
        z = np.where(bridged, filled, z)
        base = sigma if sigma is not None else np.zeros_like(z)
        sigma = np.where(bridged, base[tuple(at)] + _FILL_GROWTH * distance, base)
        notes.append(f"{int(bridged.sum()):,} nodes in holes are bridged: assumed")
        holes &= ~bridged
    if holes.any():
        share = 100 * holes.sum() / (known.sum() + holes.sum())
        notes.append(
            f"{int(holes.sum()):,} nodes ({share:.2g} %) lie in holes without data and stay "
            "unknown (--fill M bridges those up to M metres from data)"
        )
    return z, sigma
