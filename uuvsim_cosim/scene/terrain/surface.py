"""Depth of a chart and its standard deviation at the nodes of a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.scene.chart.codes import ZONES_OF_CONFIDENCE
from uuvsim_cosim.scene.chart.read import Chart
from uuvsim_cosim.scene.shared.extra import import_extra
from uuvsim_cosim.scene.terrain.grid import Grid
from uuvsim_cosim.scene.terrain.points import known_points
from uuvsim_cosim.scene.terrain.tin import HoldOut, Triangulation

__all__ = ["Prepared", "Surface", "prepared", "surface_on"]

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SHARE = 0.3  # of the interpolation's standard deviation that the relief takes up
_SLOPE = 3.0  # of the power spectrum, k^-3: between sand and rock of published seabeds
_LONGEST = 200.0  # m; of the relief's waves
_LEAST_LAND = 2.0  # m above the datum, where no area dries higher
_SLACK = 0.05  # m; half of the least step in which depths are charted
_SQRT_12 = 12**0.5


@dataclass(frozen=True, eq=False)
class Prepared:
    """A chart, its triangulation and hold-out errors: the input of every grid over it."""

    chart: Chart
    mesh: Triangulation
    hold_out: HoldOut
    height: float  # m, of land above the datum; NaN leaves it unknown
    beyond: Floats  # (points,), m; how far a sounding lies outside the band charted around it

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on the chart for the user."""
        notes = self.chart.notes
        if not len(self.chart.quality):
            notes += ("no M_QUAL: the soundings count as unassessed (CATZOC U)",)
        if against := int((self.beyond > 0).sum()):
            notes += (
                f"{against} soundings lie outside the depths charted for their area, by up to "
                f"{self.beyond.max():.1f} m: clipped like the rest, and included in sigma",
            )
        return notes


@dataclass(frozen=True, eq=False)
class Surface:
    """Values of a chart at the nodes of a grid."""

    z: Floats  # m, down; NaN: unknown
    sigma: Floats  # m; NaN on land
    land: Mask  # whether land
    charted: Mask  # whether interpolated in a charted band
    held: Mask  # whether, of these, in it before clipping
    relief: str = ""  # a note on invented relief


def prepared(chart: Chart, spacing: float, land: float | None) -> Prepared:
    """Triangulate a chart for grids of a spacing (m), and leave its soundings out one by one."""
    mesh = Triangulation(known_points(chart, spacing))
    if land is None:  # as high as the highest area that dries
        dries = chart.depth_areas.low
        dries = dries[np.isfinite(dries)]
        land = max(float(-dries.min()) if len(dries) else 0.0, _LEAST_LAND)
    low, high = _charted(chart, mesh.points.xy[: mesh.points.soundings])
    sounded, beyond = mesh.points.z[: len(low)], np.zeros(len(mesh.points.z))
    apart = np.maximum(low - sounded, sounded - high)
    beyond[: len(low)] = np.where((low <= high) & (apart > _SLACK), apart, 0.0)
    # Soundings are left out one by one; what is interpolated there is clipped as the terrain is.
    rows, value, slope, distance = mesh.left_out()
    low, high = _charted(chart, mesh.points.xy[rows])
    charted = low <= high
    value[charted] = np.clip(value[charted], low[charted], high[charted])
    kept = np.isfinite(value)
    hold_out = HoldOut((value - mesh.points.z[rows])[kept], distance[kept], slope[kept])
    return Prepared(chart, mesh, hold_out, land, beyond)


def surface_on(of: Prepared, grid: Grid, relief: int | None = None) -> Surface:
    """Interpolate at the nodes of a grid, clip into the charted areas, and estimate sigma."""
    chart, mesh, hold_out = of.chart, of.mesh, of.hold_out
    area, band = _bands(chart, grid)
    wet = band[0] <= band[1]
    raw, slope = mesh.over(grid)
    raw[~wet] = np.nan
    known = mesh.points.xy[: len(mesh.points.xy) - mesh.points.border]
    distance, raw = _distance_and_filled(grid, known, raw, wet)
    charted = np.isfinite(raw) & (area >= 0)
    held = charted & (raw >= band[0] - _SLACK) & (raw <= band[1] + _SLACK)
    z = np.clip(raw, band[0], band[1])
    spread = np.full(grid.shape, np.inf)
    if len(hold_out.errors):
        typical = np.median(hold_out.slopes)  # where nothing is triangulated
        spread = hold_out.sigma(distance, np.where(np.isnan(slope), typical, slope))
    spread = np.minimum(spread, np.where(area >= 0, band[1] - band[0], np.inf) / _SQRT_12)
    if of.beyond.any():
        spread = np.fmax(spread, mesh.over(grid, of.beyond)[0])
    note = ""
    if relief is not None and np.isfinite(z).any():
        z, note = _with_relief(z, distance, spread, grid.spacing, relief, band)
    # The standard deviation of soundings in the charted zones of confidence.
    order = np.argsort(-chart.zones, kind="stable")  # the best last, so that it wins
    zone = grid.burn(chart.quality[order], chart.zones[order])
    zone = np.clip(np.where(zone < 0, 6, zone), 0, 7)
    accuracy = [ZONES_OF_CONFIDENCE.get(n, ZONES_OF_CONFIDENCE[6])[1:] for n in range(8)]
    a, b = np.array(accuracy).T
    of_zone = (a[zone] + b[zone] * np.abs(z)) / 1.96
    sigma = np.hypot(np.where(np.isfinite(spread), spread, 0.0), of_zone)
    land = grid.burn(chart.land) >= 0
    small = [s for s in chart.land if s.geom_type not in ("Polygon", "MultiPolygon")]
    land |= grid.burn(small, touched=True) >= 0
    # rounded so that files compress well; a chart resolves 0.1 m
    z, sigma = np.clip(np.rint(256 * z) / 256, *band), np.rint(64 * sigma) / 64
    z[land] = -of.height
    sigma[land | np.isnan(z)] = np.nan
    return Surface(z, sigma, land, charted, held, note)


def _with_relief(
    z: Floats, distance: Floats, spread: Floats, spacing: float, seed: int,
    band: tuple[Floats, Floats],
) -> tuple[Floats, str]:  # fmt: skip
    """Add noise with a power-law spectrum to depths z; return the depths and a note on them.

    Nothing is added at the data; away from them the standard deviation is a share of that of the
    interpolation. Waves are longer than two spacings and shorter than the soundings' distance.
    The result stays within the charted band.
    """
    near = distance[np.isfinite(z)]
    longest = float(np.clip(2 * np.quantile(near, 0.9), 4 * spacing, max(_LONGEST, 4 * spacing)))
    # Gaussian noise with a power-law spectrum, band-limited, of unit variance.
    draws = np.random.Generator(np.random.Philox(key=seed)).standard_normal(z.shape)
    k = np.hypot(
        np.fft.fftfreq(z.shape[0], spacing)[:, None], np.fft.rfftfreq(z.shape[1], spacing)[None, :]
    )
    with np.errstate(divide="ignore"):
        gain = np.where((k > 1 / longest) & (k < 0.5 / spacing), k ** (-_SLOPE / 2), 0.0)
    noise = np.fft.irfft2(np.fft.rfft2(draws) * gain, s=z.shape)
    deviation = float(noise.std())
    noise = noise / deviation if deviation > 0 else noise
    room = np.where(np.isfinite(spread), spread, 0.0)
    taper = np.clip(distance / longest, 0.0, 1.0)
    added = np.clip(z + _SHARE * room * taper * noise, band[0], band[1])
    rms = float(np.sqrt(np.nanmean((added - z) ** 2)))
    return added, (
        f"relief shorter than {longest:.0f} m is invented (seed {seed}, {rms:.2f} m root mean "
        "square): no sounding measured it"
    )


def _bands(chart: Chart, grid: Grid) -> tuple[NDArray[np.int32], tuple[Floats, Floats]]:
    """Return each node's depth area (-1: none), its least and greatest depth (inf, -inf: dry)."""
    areas = chart.depth_areas
    area = grid.burn(areas.shapes)
    area[grid.burn(chart.unsurveyed) >= 0] = -1
    low = np.append(areas.low, np.inf)[area]
    high = np.append(areas.high, -np.inf)[area]
    hidden = (area < 0) & (grid.burn(chart.floating) >= 0)
    low[hidden], high[hidden] = -np.inf, np.inf
    return area, (low, high)


def _distance_and_filled(grid: Grid, xy: Floats, raw: Floats, wet: Mask) -> tuple[Floats, Floats]:
    """Return each node's distance to data (m), and the depths where the nearest known fills."""
    from scipy.ndimage import distance_transform_edt

    row, column, inside = grid.nearest(xy)
    empty = np.ones(grid.shape, bool)
    empty[row[inside], column[inside]] = False
    if empty.all():
        from scipy.spatial import cKDTree

        nodes = np.column_stack([a.ravel() for a in np.meshgrid(grid.east, grid.north)])
        distance = np.asarray(cKDTree(xy).query(nodes)[0]).reshape(grid.shape)
    else:
        distance = distance_transform_edt(empty, sampling=grid.spacing)
    missing = wet & np.isnan(raw)
    if missing.any() and np.isfinite(raw).any():
        at = distance_transform_edt(np.isnan(raw), return_distances=False, return_indices=True)
        raw = np.where(missing, raw[tuple(at)], raw)
    return distance, raw


def _charted(chart: Chart, xy: Floats) -> tuple[Floats, Floats]:
    """Return the least and greatest depth charted at places (inf, -inf: nothing is)."""
    shapely = import_extra("shapely", "gridding a chart")
    areas = chart.depth_areas
    at, area = shapely.STRtree(areas.shapes).query(shapely.points(xy), predicate="intersects")
    low, high = np.full(len(xy), np.inf), np.full(len(xy), -np.inf)
    np.minimum.at(low, at, areas.low[area])
    np.maximum.at(high, at, areas.high[area])
    return low, high
