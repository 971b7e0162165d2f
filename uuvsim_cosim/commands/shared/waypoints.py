"""Waypoint files: CSV in metres or degrees, or QGroundControl's .plan; errors name the line."""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.units import parse_unit

__all__ = ["Waypoints", "load_waypoints", "local_of", "origin_of"]

Floats = NDArray[np.float64]
Place = tuple[float, float]  # latitude and longitude, degrees
Item = Mapping[str, Any]  # of a mission in JSON

COLUMNS = {
    "n": "n", "north": "n", "northing": "n", "e": "e", "east": "e", "easting": "e",
    "d": "d", "down": "d", "depth": "d", "lat": "lat", "latitude": "lat",
    "lon": "lon", "lng": "lon", "long": "lon", "longitude": "lon",
}  # fmt: skip
EXPECTED = "n,e,d or north,east,down, or lat,lon,d with --origin"
LARGEST = 1e6  # m; beyond it a latitude-longitude file or a wrong unit is likelier
EXTENT = 1.0  # of a path; in m it is hardly one, in degrees it is up to 111 km
WAYPOINT, SPLINE = 16, 82  # MAV_CMD_NAV_…
RELATIVE = {0: "mean sea level", 5: "mean sea level", 3: "home", 6: "home"}  # MAV_FRAME
A, E2 = 6378137.0, 6.69437999014e-3  # WGS 84: semi-major axis [m], first eccentricity squared


@dataclass(frozen=True)
class Waypoints:
    """Waypoints (n, 3): north, east, down [m], and what was assumed or left out.

    `origin` is the place of the local frame, if the file is in degrees.
    """

    points: Floats
    notes: tuple[str, ...] = ()
    origin: Place | None = None


def load_waypoints(
    path: str | Path, origin: Place | None = None, *, shared: bool = False
) -> Waypoints:
    """Read the waypoints of a file.

    CSV: a first row of names (n,e,d or north,east,down, or lat,lon,d; in any order, each with a
    unit in brackets if it is not m or deg); blank lines and lines that start with # are skipped.
    A table without names is in m, which is noted; it is refused if its values may be degrees.
    ``.plan``: the mission of QGroundControl; its altitudes have to be 0 or less.
    Latitudes and longitudes need the `origin` of the local frame, (lat, lon) in degrees; of a
    .plan it is the planned home position, unless it is given. An origin of a table in m is refused,
    unless it is `shared`, that is, of use for something else. Raises InputInvalid with file and
    line number, or number of the item.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputInvalid(path, "no such file", "a CSV of waypoints") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(path, f"cannot be read as text ({error})", "a CSV") from None
    if path.suffix.lower() == ".plan":
        found = _plan(text, path, origin)
    else:
        found = _csv(text, path, origin, shared)
    if len(found.points) < 2:
        raise InputInvalid(path, f"{len(found.points)} waypoint(s) were read", "at least 2")
    return found


def origin_of(text: str) -> Place:
    """Read a place, ``LAT,LON`` in degrees; raises InputInvalid."""
    parts = text.split(",")
    try:
        latitude, longitude = (float(part) for part in parts)
    except ValueError:
        raise InputInvalid(f"--origin {text}: expected LAT,LON in degrees") from None
    if not (abs(latitude) < 90 and abs(longitude) <= 360):
        raise InputInvalid(f"--origin {text}: expected a latitude within 90 and a longitude")
    return latitude, longitude


def local_of(place: Place, origin: Place) -> tuple[float, float]:
    """Return north and east [m] of a place in the plane that touches WGS 84 at the origin.

    Both lie on the ellipsoid (height 0). The coordinates are those of the vector between them,
    in the directions true north and east at the origin (EPSG Guidance Note 7-2, method 9837).
    They are d^3/(6 R^2) shorter than the way on the ground: 4 mm at 10 km.
    """
    phi, lam = (math.radians(v) for v in origin)
    x, y, z = (b - a for a, b in zip(_earth(origin), _earth(place), strict=True))
    east = -math.sin(lam) * x + math.cos(lam) * y
    across = math.cos(lam) * x + math.sin(lam) * y
    return -math.sin(phi) * across + math.cos(phi) * z, east


def _earth(place: Place) -> tuple[float, float, float]:
    phi, lam = (math.radians(v) for v in place)
    n = A / math.sqrt(1.0 - E2 * math.sin(phi) ** 2)
    return (
        n * math.cos(phi) * math.cos(lam),
        n * math.cos(phi) * math.sin(lam),
        n * (1.0 - E2) * math.sin(phi),
    )


# ---- CSV --------------------------------------------------------------------------------------


def _csv(text: str, path: Path, origin: Place | None, shared: bool) -> Waypoints:
    lines: list[tuple[int, str, list[str]]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip() and not line.lstrip().startswith("#"):
            delimiter = next((d for d in (",", ";", "\t") if d in line), ",")
            cells = next(csv.reader([line], delimiter=delimiter))
            lines.append((number, line, [cell.strip() for cell in cells]))
    named = _header(lines[0][2], path, lines[0][0]) if lines else None
    order, factors = named or (["n", "e", "d"], [1.0, 1.0, 1.0])
    if named is None:
        _refuse_degrees([cells for _, _, cells in lines], path, origin)
    elif "lat" in order and origin is None:
        expected = "--origin LAT,LON as well, the place of the local frame's origin"
        raise InputInvalid(f"{path}:{lines[0][0]}", "latitudes and longitudes", expected)
    rows = [
        _row(cells, order, factors, line, path, number)
        for number, line, cells in lines[0 if named is None else 1 :]
    ]
    notes: list[str] = []
    if "lat" in order and origin is not None:
        rows = [[*_near((lat, lon), origin, path), d] for lat, lon, d in rows]
        notes.append(_placed(path, origin))
    elif origin is not None and not shared:
        raise InputInvalid(
            f"--origin: {path.name} is in metres", "latitudes and longitudes (lat,lon,d)"
        )
    elif named is None:
        notes.append(
            f"{path.name} has no header: its columns are read as north, east and down in m"
        )
    return Waypoints(np.array(rows), tuple(notes), origin)


def _refuse_degrees(rows: list[list[str]], path: Path, origin: Place | None) -> None:
    """Refuse a table without header that may be in degrees: one place on the globe, not in m."""
    try:
        values = np.array([[float(cell) for cell in cells] for cells in rows])
    except ValueError:  # a row that is refused later, with its line
        return
    if values.ndim != 2 or values.shape[1] != 3:
        return
    horizontal = values[:, :2]
    largest = np.abs(horizontal).max(axis=0)
    on_the_globe = largest.min() <= 90 and largest.max() <= 180
    in_one_place = np.ptp(horizontal, axis=0).max() <= EXTENT < largest.max()
    if (on_the_globe and in_one_place and (horizontal % 1 != 0).any()) or origin is not None:
        first = ",".join(rows[0][:2])
        read = f"has no header, and {first} may be in degrees or in m"
        degrees = "a first line lat,lon,d (or lon,lat,d) and --origin LAT,LON for degrees"
        raise InputInvalid(path, read, f"{degrees}, or n,e,d for m")


def _placed(path: Path, origin: Place) -> str:
    return (
        f"{path.name}: the origin of the local frame is at {origin[0]:.7g}, {origin[1]:.7g} deg, "
        "and its north is true north"
    )


def _near(place: Place, origin: Place, path: Path) -> tuple[float, float]:
    north, east = local_of(place, origin)
    if not (max(abs(north), abs(east)) <= 1e5 and abs(place[0]) <= 90):
        away = f"{math.hypot(north, east) / 1e3:.0f} km from the origin"
        read = f"{place[0]:.7g}, {place[1]:.7g} deg is {away} {origin[0]:.7g}, {origin[1]:.7g}"
        raise InputInvalid(path, read, "at most 100 km")
    return north, east


def _header(cells: list[str], path: Path, number: int) -> tuple[list[str], list[float]] | None:
    """Return the order of the columns and their factors to m and deg; None for a row of numbers."""
    names = [re.split(r"[\[(]", cell)[0].strip().lower() for cell in cells]
    if not any(name[:1].isalpha() and name not in ("nan", "inf") for name in names):
        return None
    order = [COLUMNS.get(name, name) for name in names]
    if sorted(order) not in (["d", "e", "n"], ["d", "lat", "lon"]):
        read = f"column names {_short(', '.join(cells))!r} were read"
        raise InputInvalid(f"{path}:{number}", read, EXPECTED)
    factors = []
    for cell, name in zip(cells, order, strict=True):
        wanted = parse_unit("deg" if name in ("lat", "lon") else "m")
        match = re.search(r"[\[(]\s*(.*?)\s*[\])]", cell)  # the unit behind the name
        unit = (match[1] if match else "") or wanted.name
        try:
            found = parse_unit("deg" if unit == "°" else unit)
        except ValueError:
            found = None
        if found is None or not found.commensurable(wanted):
            expected = f"a unit such as {wanted.name}"
            raise InputInvalid(f"{path}:{number}", f"{_short(cell)!r}", expected)
        factors.append(found.factor / wanted.factor)
    return order, factors


def _row(
    cells: list[str], order: list[str], factors: list[float], line: str, path: Path, number: int
) -> list[float]:
    wrong = f"{path}:{number}: {_short(line.strip())!r} was read; expected"
    if len(cells) != 3:
        raise InputInvalid(f"{wrong} 3 numbers ({','.join(order)} in metres), not {len(cells)}")
    values: dict[str, float] = {}
    for name, factor, cell in zip(order, factors, cells, strict=True):
        try:
            value = factor * float(cell)
        except ValueError:
            raise InputInvalid(f"{wrong} a number instead of {_short(cell)!r}") from None
        if not math.isfinite(value) or abs(value) > LARGEST:
            raise InputInvalid(f"{wrong} a finite number of at most {LARGEST:.0e} m for {cell!r}")
        if name == "d" and value < 0:
            raise InputInvalid(f"{wrong} a depth of 0 m or more, positive down, for {cell!r}")
        values[name] = value
    return [values[name] for name in (("lat", "lon", "d") if "lat" in values else ("n", "e", "d"))]


def _short(text: str) -> str:
    """Return the beginning of what was read: a file may be one long line."""
    return text if len(text) <= 60 else f"{text[:57]}…"


# ---- QGroundControl ------------------------------------------------------------------------------


def _plan(text: str, path: Path, origin: Place | None) -> Waypoints:
    try:
        mission = json.loads(text)["mission"]
        items = list(_simple(mission["items"]))
        home = mission.get("plannedHomePosition")
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InputInvalid(
            path, "is no plan of QGroundControl", "JSON with mission.items"
        ) from None
    if origin is None:
        try:
            origin = (float(home[0]), float(home[1]))
        except (TypeError, ValueError, IndexError):
            raise InputInvalid(path, "has no plannedHomePosition", "--origin LAT,LON") from None
    notes = [_placed(path, origin)]
    skipped: dict[object, int] = {}  # number of items by command
    zeros: set[str] = set()
    points: list[list[float]] = []
    for number, item in enumerate(items, start=1):
        place = f"{path}: item {number}"
        command = item.get("command")
        if command not in (WAYPOINT, SPLINE):
            skipped[command] = skipped.get(command, 0) + 1
            continue
        zero = RELATIVE.get(item.get("frame", 3))
        if zero is None:
            expected = "one above home (3) or mean sea level (0)"
            raise InputInvalid(place, f"altitude in frame {item['frame']}", expected)
        zeros.add(zero)
        try:
            latitude, longitude, altitude = (float(v) for v in item["params"][4:7])
        except (KeyError, TypeError, ValueError):
            raise InputInvalid(place, "has no place", "params of 7 numbers") from None
        if not (math.isfinite(latitude + longitude + altitude) and altitude <= 0):
            expected = "0 m or less, which is below the surface"
            raise InputInvalid(place, f"altitude {altitude:g} m", expected)
        points.append([*_near((latitude, longitude), origin, path), -altitude])
        if (item["params"][0] or 0) > 0:
            hold = item["params"][0]
            notes.append(f"{path.name}: item {number}: its hold of {hold:g} s is ignored")
        if command == SPLINE:
            notes.append(f"{path.name}: item {number}: its spline is flown as straight legs")
    notes += [f"{path.name}: the surface is taken to be at {zero}" for zero in sorted(zeros)]
    notes += [
        f"{path.name}: {count} item(s) with command {command} are ignored, because they are not "
        "waypoints"
        for command, count in skipped.items()
    ]
    return Waypoints(np.array(points).reshape(-1, 3), tuple(notes), origin)


def _simple(items: Iterable[Item]) -> Iterator[Item]:
    """Yield the simple items, those of surveys and corridors too."""
    for item in items:
        inner = item.get("TransectStyleComplexItem")
        if inner is not None:
            yield from _simple(inner["Items"])
        elif item.get("type") == "SimpleItem":
            yield item
        else:
            raise KeyError(item.get("complexItemType"))
