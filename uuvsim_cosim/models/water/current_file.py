"""A netCDF file of currents as a grid in the local frame: which variables, axes and units it has.

Along its axes the file may be in any order and direction. The local frame `n` stands at (latitude,
longitude), or at (northing, easting) of a projected file; without them, at the middle of the grid:

    N = M (lat - lat_0),   E = R cos(lat_0) (lon - lon_0)

with the radii of curvature M and R of WGS 84 at lat_0 (Hofmann-Wellenhof et al. 2003, Navigation,
section 2.1.1). This is a plane approximation: its error is 1 in 1,000 at 15 km from the origin at
45 degrees.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from math import cos, radians, sin, sqrt
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.models.water.netcdf import Variable, read_netcdf

__all__ = ["CurrentGrid", "read_current_file"]

Array = NDArray[np.float64]
MOST = 500_000  # numbers that a component holds; more would take minutes to compile
SPEEDS = {
    "m/s": 1.0, "m s-1": 1.0, "m.s-1": 1.0, "m s^-1": 1.0, "meter second-1": 1.0, "mps": 1.0,
    "meters/second": 1.0, "metre/second": 1.0, "meter/second": 1.0, "m/sec": 1.0, "m s**-1": 1.0,
    "cm/s": 0.01, "cm s-1": 0.01, "cm.s-1": 0.01, "mm/s": 0.001, "mm s-1": 0.001,
    "km/h": 1.0 / 3.6, "km h-1": 1.0 / 3.6, "knot": 1852.0 / 3600.0, "knots": 1852.0 / 3600.0,
    "kt": 1852.0 / 3600.0, "kn": 1852.0 / 3600.0, "kts": 1852.0 / 3600.0, "ft/s": 0.3048,
    "ft s-1": 0.3048, "feet/s": 0.3048, "feet per second": 0.3048, "feet s-1": 0.3048,
}  # fmt: skip
LENGTHS = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "km": 1000.0, "cm": 0.01,
    "ft": 0.3048, "feet": 0.3048, "foot": 0.3048, "fathom": 1.8288, "fathoms": 1.8288,
}  # fmt: skip
_SINCE = re.compile(
    r"(\w+?)s? since (\d{4}-\d{1,2}-\d{1,2}(?:[T ][\d:.]+)?)\s*(?:Z|UTC|\+00:?00|)$"
)
SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "min": 60.0, "minute": 60.0, "h": 3600.0,
           "hr": 3600.0, "hour": 3600.0, "d": 86400.0, "day": 86400.0}  # fmt: skip
EAST = ("eastward_sea_water_velocity", "sea_water_x_velocity", "eastward_current")
NORTH = ("northward_sea_water_velocity", "sea_water_y_velocity", "northward_current")
NAMES = {
    "u": ("u", "uo", "water_u", "u_eastward", "uvel", "ucur", "vozocrtx", "east"),
    "v": ("v", "vo", "water_v", "v_northward", "vvel", "vcur", "vomecrty", "north"),
}
ROLES = {
    "time": ("time", "ocean_time", "t", "mt"),
    "depth": ("depth", "lev", "level", "z", "deptht", "height", "altitude"),
    "north": ("lat", "latitude", "y", "northing", "nav_lat", "lat_rho"),
    "east": ("lon", "longitude", "x", "easting", "nav_lon", "lon_rho"),
}


@dataclass(frozen=True, eq=False)
class CurrentGrid:
    """Currents at (time [s], depth, N, E [m]), the axes rising; nodes[t, d, n, e] = (v_N, v_E)."""

    axes: tuple[Array, Array, Array, Array]
    nodes: NDArray[np.float32]  # m/s
    start: float  # s, simulation's time 0, since the first time of the file
    words: str  # what it is, in one line


def read_current_file(
    file: Path,
    *,
    u: str = "",
    v: str = "",
    origin: tuple[float, float] | None = None,
    start: str = "",
    extent: float | None = None,
    holes: str = "refuse",
    unit: str = "",
) -> CurrentGrid:
    """Read currents; raises InputInvalid, which names the file and the variable.

    `origin` is (latitude, longitude) [deg], or (northing, easting) [m] of a projected file;
    `start` when simulation begins, in s after the first time or as 2020-05-01T12:00; of a large
    file only what lies within `extent` [m] north, south, east and west of the origin is taken;
    `holes` is "refuse", or "nearest": land and gaps take the nearest node of the same time and
    depth; `unit` is that of u and v where the file has none.
    """
    variables = read_netcdf(file)
    read = _Reader(file, variables)
    along_east, along_north = read.velocity("u", u, EAST), read.velocity("v", v, NORTH)
    if along_east.dimensions != along_north.dimensions:
        raise InputInvalid(
            file,
            (
                f"{along_east.name} has axes {along_east.dimensions}, "
                f"{along_north.name} {along_north.dimensions}"
            ),
            "the same (a staggered grid: interpolate it first)",
        )
    roles = read.roles(along_east)
    axes, words = read.axes(roles, origin)
    index: dict[str, slice] = {}
    for role in ("north", "east") if extent is not None else ():
        axis = axes[role]
        inside = np.flatnonzero(np.abs(axis) <= extent)
        if len(inside) == 0:
            raise InputInvalid(
                file,
                (
                    f"nothing lies within {extent:g} m of the origin along {role}, "
                    f"which goes from {axis.min():.0f} to {axis.max():.0f} m"
                ),
                "a larger extent, or another origin",
            )
        index[role] = slice(max(int(inside[0]) - 1, 0), min(int(inside[-1]) + 2, len(axis)))
        axes[role] = axis[index[role]]
    parts = []
    size = 2 * int(np.prod([len(a) for a in axes.values()]))
    if size > MOST:
        raise InputInvalid(
            file,
            f"{size:,} numbers",
            f"at most {MOST:,}: give extent=METRES around the origin, or cut the file in time",
        )
    for variable in (along_east, along_north):
        read_roles = [roles[d] for d in variable.dimensions]
        taken = tuple(index.get(role, slice(None)) for role in read_roles)
        values = variable.read(taken) * read.factor(variable, unit)
        values = values.transpose([read_roles.index(role) for role in axes if role in read_roles])
        parts.append(values.reshape([len(axis) for axis in axes.values()]))
    order = [np.argsort(axis, kind="stable") for axis in axes.values()]
    rising = [axis[o] for axis, o in zip(axes.values(), order, strict=True)]
    nodes = np.stack([part[np.ix_(*order)] for part in reversed(parts)], axis=-1)
    for name, axis in zip(axes, rising, strict=True):
        if np.any(np.diff(axis) <= 0):
            raise InputInvalid(file, f"axis {name} has a value twice", "each once")
    nodes = _whole(file, along_east.name, nodes, rising, holes)
    seconds = rising[0] - rising[0][0]
    first = _start(file, start, read.epoch, float(rising[0][0]), float(seconds[-1]))
    grid = (seconds, rising[1], rising[2], rising[3])
    return CurrentGrid(grid, nodes.astype(np.float32), first, words)


class _Reader:
    """Finds velocities and their axes among the variables of a file."""

    def __init__(self, file: Path, variables: Mapping[str, Variable]) -> None:
        self.file, self.variables = file, variables
        self.epoch: datetime | None = None

    def velocity(self, which: str, name: str, standard: tuple[str, ...]) -> Variable:
        """Find the variable u or v by its name, its CF standard name, or a usual name."""
        has = [k for k, v in self.variables.items() if len(v.shape) >= 2]
        listed = ", ".join(has) or "none with two axes or more"
        if name:
            if name not in self.variables:
                hint = did_you_mean(name, has)
                raise InputInvalid(f"{self.file}: no variable {name!r}{hint}; it has {listed}")
            return self.variables[name]
        found = [k for k in has if self.variables[k].text("standard_name") in standard]
        found = found or [k for k in has if k.lower() in NAMES[which]]
        if len(found) != 1:
            what = "several variables" if found else "no variable"
            raise InputInvalid(
                self.file,
                (
                    f"{what} for the current to the "
                    f"{'east' if which == 'u' else 'north'} ({', '.join(found) or listed})"
                ),
                f"{which}=NAME",
            )
        return self.variables[found[0]]

    def factor(self, variable: Variable, unit: str) -> float:
        """Return m/s in a unit of the variable."""
        text = variable.text("units") or unit
        factor = SPEEDS.get(text) or SPEEDS.get(text.lower())
        if factor is None:
            read = f"unit {text!r}" if text else "no unit"
            raise InputInvalid(
                f"{self.file}: {variable.name} has {read}; expected a speed such as m/s, cm/s, "
                "knots or ft/s" + ("" if text else ", or unit=UNIT")
            )
        return factor

    def roles(self, variable: Variable) -> dict[str, str]:
        """Return what each dimension of a variable is: time, depth, north or east."""
        roles: dict[str, str] = {}
        for dimension in variable.dimensions:
            role = next((r for r, names in ROLES.items() if dimension.lower() in names), None)
            if dimension in self.variables:
                by_axis = {"T": "time", "Z": "depth", "Y": "north", "X": "east"}
                role = by_axis.get(self.variables[dimension].text("axis").upper(), role)
            if role is None or role in roles.values():
                raise InputInvalid(
                    self.file,
                    (
                        f"axis {dimension!r} of {variable.name}{variable.dimensions} is "
                        f"{'none that is known' if role is None else f'{role} once more'}"
                    ),
                    "time, depth, lat or y, lon or x, each with a variable of its name",
                )
            roles[dimension] = role
        missing = [r for r in ("north", "east") if r not in roles.values()]
        if missing:
            raise InputInvalid(
                self.file,
                f"{variable.name}{variable.dimensions} has no axis {missing[0]}",
                "lat and lon, or y and x",
            )
        return roles

    def axes(
        self, roles: dict[str, str], origin: tuple[float, float] | None
    ) -> tuple[dict[str, Array], str]:
        """Return each axis in s or m of the local frame, in the order time, depth, north, east."""
        by_role: dict[str, Variable] = {}
        for name, role in roles.items():
            found = self.variables.get(name)
            if found is None:
                wide = [
                    k
                    for k, v in self.variables.items()
                    if name in v.dimensions and k.lower() in (*ROLES["north"], *ROLES["east"])
                ]
                hint = f" ({wide[0]} has two axes: a curvilinear grid)" if wide else ""
                raise InputInvalid(
                    self.file,
                    f"axis {name!r} has no variable of its name{hint}",
                    "one with its values: a regular grid",
                )
            if len(found.shape) != 1:
                raise InputInvalid(
                    self.file,
                    f"{name} has axes {found.dimensions}",
                    "one: a regular grid (a curvilinear one is to be regridded first)",
                )
            by_role[role] = found
        axes = {"time": np.zeros(1), "depth": np.zeros(1)}
        if "time" in by_role:
            axes["time"] = self._seconds(by_role["time"])
        if "depth" in by_role:
            v = by_role["depth"]
            up = v.text("positive").lower() == "up"
            axes["depth"] = v.read() * self._length(v) * (-1.0 if up else 1.0)
        north, east = (by_role[r].read() for r in ("north", "east"))
        texts = [by_role[r].text("units").lower() for r in ("north", "east")]
        words = "projected"
        if all(t.startswith("degree") for t in texts):
            lat, lon = origin or (float(np.mean(north)), float(np.mean(east)))
            # Radii of curvature of WGS 84 along the meridian and across it [m].
            a, e2 = 6378137.0, 6.69437999014e-3
            w = sqrt(1.0 - e2 * sin(radians(lat)) ** 2)
            M, R = a * (1.0 - e2) / w**3, a / w
            east = (east - lon + 180.0) % 360.0 - 180.0
            axes["north"] = np.radians(north - lat) * M
            axes["east"] = np.radians(east) * R * cos(radians(lat))
            words = f"origin {lat:.6g} N {lon:.6g} E"
        elif any(t.startswith("degree") for t in texts):
            raise InputInvalid(
                self.file,
                f"axes in {texts[0]!r} and {texts[1]!r}",
                "both in degrees or both in metres",
            )
        else:
            north, east = (a * self._length(by_role[r]) for a, r in ((north, "north"),
                                                                      (east, "east")))  # fmt: skip
            y, x = origin or (float(np.mean(north)), float(np.mean(east)))
            axes["north"], axes["east"] = north - y, east - x
            words = f"origin at northing {y:.6g} m, easting {x:.6g} m"
        for role, axis in axes.items():
            if not np.all(np.isfinite(axis)):
                raise InputInvalid(self.file, f"axis {role} has missing values", "all")
        return axes, words

    def _length(self, v: Variable) -> float:
        text = v.text("units").lower()
        if text not in LENGTHS:
            read = f"unit {text!r}" if text else "no unit"
            raise InputInvalid(
                self.file, f"{v.name} has {read}", "m, km, ft or fathoms (degrees for lat and lon)"
            )
        return LENGTHS[text]

    def _seconds(self, v: Variable) -> Array:
        m = _SINCE.match(v.text("units"))
        calendar = v.text("calendar").lower() or "standard"
        length = None if m is None else SECONDS.get(m[1].lower())
        if m is None or length is None:
            text = v.text("units").lower()
            known = SECONDS.get(text) or SECONDS.get(text.rstrip("s"))
            if known is not None:  # of no date
                return v.read() * known
            raise InputInvalid(
                self.file,
                f"{v.name} has unit {v.text('units')!r}",
                "s, or as 'hours since 2020-05-01 00:00:00'",
            )
        if calendar not in ("standard", "gregorian", "proleptic_gregorian", "utc"):
            raise InputInvalid(
                self.file, f"{v.name} has calendar {calendar!r}", "standard (gregorian)"
            )
        fields = [int(float(x)) for x in re.split(r"[-T: ]", m[2].strip()) if x]
        try:
            self.epoch = datetime(*fields, tzinfo=UTC)  # type: ignore[misc,arg-type]
        except (ValueError, TypeError):
            raise InputInvalid(self.file, f"{m[2]!r} is no date", "2020-05-01 12:00:00") from None
        return v.read() * length


def _whole(file: Path, name: str, nodes: Array, axes: list[Array], holes: str) -> Array:
    """Refuse nodes without a value, or give them that of the nearest with one."""
    if holes not in ("refuse", "nearest"):
        raise InputInvalid(f"holes={holes!r}", "refuse or nearest")
    gone = ~np.all(np.isfinite(nodes), axis=-1)
    if not gone.any():
        return nodes
    if holes == "refuse":
        t, d, n, e = (int(i[0]) for i in np.nonzero(gone))
        raise InputInvalid(
            file,
            (
                f"{name} has no value at {int(gone.sum()):,} of {gone.size:,} nodes "
                f"(land or gaps), the first at {axes[1][d]:g} m depth, N "
                f"{axes[2][n]:.0f} m, E {axes[3][e]:.0f} m"
            ),
            "none, a smaller extent, or holes=nearest",
        )
    from scipy.ndimage import distance_transform_edt

    filled = nodes.copy()
    for t, d in np.ndindex(*nodes.shape[:2]):
        layer = gone[t, d]
        if not layer.any():
            continue
        if layer.all():  # below the sea bed everywhere: as the level above
            if d == 0:
                raise InputInvalid(f"{file}: {name} has no value at all at its time {t}")
            filled[t, d] = filled[t, d - 1]
            continue
        apart = [float(np.mean(np.diff(a))) if len(a) > 1 else 1.0 for a in axes[2:]]
        at = distance_transform_edt(
            layer, sampling=apart, return_distances=False, return_indices=True
        )
        filled[t, d] = nodes[t, d][tuple(at)]
    return filled


def _start(file: Path, text: str, epoch: datetime | None, first: float, length: float) -> float:
    if not text:
        return 0.0
    try:
        start = float(text)
    except ValueError:
        if epoch is None:
            raise InputInvalid(
                file, f"start={text!r}, but its time has no date", "s after its first"
            ) from None
        try:
            given = datetime.fromisoformat(text)
        except ValueError:
            raise InputInvalid(
                f"start={text!r}",
                f"s after the first time of {file}, or a date such as 2020-05-01T12:00",
            ) from None
        given = given if given.tzinfo else given.replace(tzinfo=UTC)
        start = (given - epoch).total_seconds() - first
    if not 0.0 <= start <= length:
        raise InputInvalid(
            file, f"start={text} is {start:g} s after its first time", f"0 to {length:g} s"
        )
    return start
