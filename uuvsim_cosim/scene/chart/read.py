"""Reader of S-57 cells and their updates, as arrays in metres of one UTM zone."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.chart.codes import UNITS, VERTICAL_DATUMS
from uuvsim_cosim.scene.chart.files import ChartFiles, chart_files, in_sequence
from uuvsim_cosim.scene.chart.projection import Projection, projection_at
from uuvsim_cosim.scene.shared.extra import import_extra

__all__ = ["Areas", "Chart", "Features", "Shapes", "read_chart"]

Floats = NDArray[np.float64]
Shapes = NDArray[np.object_]  # (n,) shapely geometries
Column = NDArray[np.generic]  # (n,) values of an attribute

_OBJECTS = (
    "OBSTRN", "WRECKS", "UWTROC", "PILPNT", "PONTON", "PIPSOL", "CBLSUB", "MORFAC", "HULKES",
    "FLODOC", "OFSPLF", "PYLONS", "BOYLAT", "BOYCAR", "BOYINB", "BOYISD", "BOYSAW", "BOYSPP",
    "LITFLT", "LITVES", "BCNLAT", "BCNCAR", "BCNISD", "BCNSAW", "BCNSPP",
)  # fmt: skip
_ATTRIBUTES = ("VALSOU", "WATLEV", "CATOBS", "CATWRK", "VERLEN", "HEIGHT", "OBJNAM")
_OPTIONS = {
    "SPLIT_MULTIPOINT": "ON",
    "ADD_SOUNDG_DEPTH": "ON",
    "UPDATES": "APPLY",
    "RETURN_PRIMITIVES": "OFF",
    "RETURN_LINKAGES": "OFF",
    "LNAM_REFS": "OFF",
}


@dataclass(frozen=True, eq=False)
class Areas:
    """Polygons with the depths (m, positive down) between which their seabed lies."""

    shapes: Shapes  # (n,) polygons, in m of the projection
    low: Floats  # (n,), m; -inf where unknown
    high: Floats  # (n,), m; inf where unknown


@dataclass(frozen=True, eq=False)
class Features:
    """Features of one object class."""

    kind: str  # six letters of S-57, such as "WRECKS"
    shapes: Shapes
    values: dict[str, Floats]  # attribute: (n,); NaN where it is not given
    names: list[str]  # OBJNAM, or nothing


@dataclass(frozen=True, eq=False)
class Chart:
    """Seabed data of a cell: positions E, N in m of `projection`, depths in m, positive down."""

    files: ChartFiles
    projection: Projection
    scale: int
    vertical_datum: str
    soundings: Floats  # (n, 3)
    contours: Shapes  # (n,) lines
    contour_depths: Floats  # (n,)
    depth_areas: Areas  # DEPARE and DRGARE
    floating: Shapes  # (n,) polygons that hide the seabed: pontoons, hulks, floating docks
    land: Shapes  # (n,) polygons, lines and points
    coast: Shapes  # (n,) lines
    unsurveyed: Shapes  # (n,) polygons
    quality: Shapes  # (n,) polygons
    zones: NDArray[np.int64]  # (n,) CATZOC of `quality`
    nature: Shapes  # (n,) points, lines and polygons
    natures: list[list[int]]  # NATSUR of `nature`
    features: tuple[Features, ...] = ()
    notes: tuple[str, ...] = ()


class _Cell:
    """One open cell: reads layers in metres of the projection."""

    def __init__(self, path: Path, name: Path) -> None:
        self.path, self.name = path, name
        self.gdal = import_extra("pyogrio", "reading a chart")
        self.shapely = import_extra("shapely", "reading a chart")
        # None until the extent is known; up to then layers are read in degrees.
        self.projection: Projection | None = None
        self.warnings: dict[str, None] = {}  # of GDAL, each once, in their order
        try:
            with self._listening():
                self.layers = {str(row[0]) for row in self.gdal.list_layers(path)}
        except Exception as reason:
            raise InputInvalid(f"{name}: GDAL cannot read it as S-57: {reason}") from None

    @contextmanager
    def _listening(self) -> Iterator[None]:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            yield
        self.warnings.update(dict.fromkeys(" ".join(str(w.message).split()) for w in caught))

    def read(self, layer: str, columns: Sequence[str] = ()) -> tuple[Shapes, dict[str, Column]]:
        """Return (geometries, columns): empty without the layer, NaN without the column."""
        if layer not in self.layers:
            return np.empty(0, object), {name: np.empty(0) for name in columns}
        try:
            with self._listening():
                about, _, coded, data = self.gdal.raw.read(self.path, layer=layer, **_OPTIONS)
        except Exception as reason:
            raise InputInvalid(f"{self.name}: {layer} cannot be read: {reason}") from None
        fields = list(about["fields"])
        shapes = self.shapely.from_wkb(coded) if coded is not None else np.empty(0, object)
        if coded is not None:
            whole = ~(self.shapely.is_missing(shapes) | self.shapely.is_empty(shapes))
        else:
            whole = np.ones(len(data[0]) if data else 0, bool)
        values = {
            name: data[fields.index(name)][whole]
            if name in fields
            else np.full(int(whole.sum()), np.nan)
            for name in columns
        }
        if coded is None:
            return shapes, values
        shapes = shapes[whole]
        if self.projection is not None:
            shapes = self.shapely.transform(shapes, self.projection.forward)
        return shapes, values


def read_chart(file: Path) -> Chart:
    """Read a base cell and the updates beside it; raises `InputInvalid` with the reason."""
    files = chart_files(file)
    notes = list(files.notes)
    with in_sequence(files) as path:
        cell = _Cell(path, file)
        metre, datum, scale = _parameters(cell, notes)
        shapely = cell.shapely
        found = [cell.read(name)[0] for name in ("M_COVR", "DEPARE", "SOUNDG")]
        corners = np.concatenate([shapely.get_coordinates(f) for f in found])
        if not len(corners):
            raise InputInvalid(
                f"{cell.name}: the cell is empty: no coverage, depth area or sounding"
            )
        cell.projection = projection_at(corners)

        soundings, values = cell.read("SOUNDG", ("DEPTH", "QUASOU"))
        xyz = np.column_stack(
            [shapely.get_coordinates(soundings), _number(values["DEPTH"]) * metre]
        )
        bottomless = np.array([5 in _codes(q) for q in values["QUASOU"]], bool)
        if bottomless.any():
            notes.append(f"{bottomless.sum()} soundings found no bottom at their depth: left out")
        xyz = xyz[~bottomless & np.isfinite(xyz).all(axis=1)]
        lines, values = cell.read("DEPCNT", ("VALDCO",))
        known = np.isfinite(_number(values["VALDCO"]))
        if not len(xyz) and not known.any():
            raise InputInvalid(
                f"{cell.name}: no soundings and no depth contours; there is no seabed to make"
            )
        if not len(xyz):
            notes.append("no soundings: the uncertainty is that of the charted bands alone")
        # GDAL's warnings are reported in the order of these reads.
        areas = _areas(cell, metre, notes)
        floating = [_polygons(cell.read(n)[0]) for n in ("PONTON", "HULKES", "FLODOC")]
        land, coast, unsurveyed = (cell.read(n)[0] for n in ("LNDARE", "COALNE", "UNSARE"))
        quality, zones = cell.read("M_QUAL", ("CATZOC",))
        nature, natures = cell.read("SBDARE", ("NATSUR",))
        codes = [_codes(v) for v in natures["NATSUR"]]
        features = []
        for object_class in _OBJECTS:
            shapes, attributes = cell.read(object_class, _ATTRIBUTES)
            if len(shapes):
                names = [v if isinstance(v, str) else "" for v in attributes.pop("OBJNAM")]
                read = {name: _number(column) for name, column in attributes.items()}
                read["VALSOU"] = read["VALSOU"] * metre
                features.append(Features(object_class, shapes, read, names))
        chart = Chart(
            files=files,
            projection=cell.projection,
            scale=scale,
            vertical_datum=datum,
            soundings=xyz,
            contours=lines[known],
            contour_depths=_number(values["VALDCO"])[known] * metre,
            depth_areas=areas,
            floating=np.concatenate(floating),
            land=land,
            coast=coast,
            unsurveyed=_polygons(unsurveyed),
            quality=quality,
            zones=np.nan_to_num(_number(zones["CATZOC"]), nan=6).astype(np.int64),
            nature=nature[np.array([bool(c) for c in codes], bool)],
            natures=[c for c in codes if c],
            features=tuple(features),
        )
        warned = [f"GDAL: {w}" for w in cell.warnings]
        more = [f"GDAL: {len(warned) - 3} more warnings"] if len(warned) > 3 else []
        return replace(chart, notes=(*notes, *warned[:3], *more))


def _parameters(cell: _Cell, notes: list[str]) -> tuple[float, str, int]:
    """Return metres in one unit of depth, the datum of soundings, and the scale."""
    columns = ("DSPM_HDAT", "DSPM_SDAT", "DSPM_CSCL", "DSPM_DUNI", "DSPM_HUNI")
    _, parameters = cell.read("DSID", columns)
    hdat, sdat, scale, duni, huni = (
        int(v[0]) if len(v) and np.isfinite(float(v[0])) else 0 for v in parameters.values()
    )
    if duni not in (0, *UNITS):
        raise InputInvalid(cell.name, f"depths in fathoms (DUNI {duni})", "metres (1) or feet (3)")
    unit, metre = UNITS.get(duni, ("m", 1.0))
    if duni == 0:
        notes.append("the cell does not state its unit of depth: metres are assumed")
    elif unit != "m":
        notes.append(f"depths are charted in {unit}: converted to metres")
    if huni not in (0, 1, *UNITS):
        notes.append(f"heights are in units that are not read (HUNI {huni})")
    if hdat not in (0, 2):
        notes.append(
            f"horizontal datum {hdat} of S-57 is not WGS 84 (2): positions can be hundreds of "
            "metres off, they are not shifted"
        )
    datum = VERTICAL_DATUMS.get(sdat, "")
    if not datum:
        notes.append("the cell does not state the datum of its soundings")
    areas, values = cell.read("M_SDAT", ("VERDAT",))
    others = {int(v) for v in _number(values["VERDAT"]) if np.isfinite(v)} - {sdat}
    if len(areas) and others:
        names = ", ".join(VERTICAL_DATUMS.get(v, str(v)) for v in sorted(others))
        notes.append(f"parts of the cell are sounded from other datums ({names}): not shifted")
    return metre, datum, scale


def _areas(cell: _Cell, metre: float, notes: list[str]) -> Areas:
    shapes, low, high = [], [], []
    for layer in ("DEPARE", "DRGARE"):
        found, values = cell.read(layer, ("DRVAL1", "DRVAL2"))
        first, second = (_number(values[n]) * metre for n in ("DRVAL1", "DRVAL2"))
        flat = np.isin(cell.shapely.get_type_id(found), (3, 6)) if len(found) else np.empty(0, bool)
        shapes.append(found[flat])
        low.append(np.where(np.isnan(first), -np.inf, first)[flat])
        high.append(np.where(np.isnan(second), np.inf, second)[flat])
    joined = Areas(*(np.concatenate(part) for part in (shapes, low, high)))
    turned = joined.low > joined.high
    if turned.any():
        notes.append(
            f"{turned.sum()} depth areas have DRVAL1 below DRVAL2: the two values are exchanged"
        )
    if not len(joined.shapes):
        raise InputInvalid(
            f"{cell.name}: no depth area (DEPARE, DRGARE), so the extent of the water is unknown"
        )
    return Areas(
        joined.shapes, np.minimum(joined.low, joined.high), np.maximum(joined.low, joined.high)
    )


def _polygons(shapes: Shapes) -> Shapes:
    shapely = import_extra("shapely", "reading a chart")
    return shapes[np.isin(shapely.get_type_id(shapes), (3, 6))] if len(shapes) else shapes


def _number(column: Column) -> Floats:
    """Return a column as numbers, NaN for missing values."""
    if column.dtype != object:
        return np.asarray(column, np.float64)
    given = [_codes(v) for v in column]
    return np.array([v[0] if v else np.nan for v in given], np.float64)


def _codes(value: ArrayLike | None) -> list[int]:
    """Return the codes of a list attribute; GDAL returns an array, a text or None."""
    if value is None or (isinstance(value, float) and np.isnan(value)):
        return []
    parts = value.split(",") if isinstance(value, str) else np.atleast_1d(value)
    return [int(p) for p in parts if str(p).strip().lstrip("-").isdigit()]
