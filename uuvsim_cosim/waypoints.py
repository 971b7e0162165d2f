"""Waypoint files: a CSV of north, east, down in metres becomes an array, errors name the line."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = ["read_waypoints"]

COLUMNS = {
    "n": "n", "north": "n", "e": "e", "east": "e", "d": "d", "down": "d", "depth": "d",
}  # fmt: skip
LARGEST = 1e6  # m; beyond it a latitude-longitude file or a wrong unit is likelier


def read_waypoints(path: str | Path) -> NDArray[np.float64]:
    """Give the waypoints of a CSV file, shape (n, 3): north, east, down [m].

    A first row of names (n,e,d or north,east,down, in any order) is optional; blank lines and
    lines that start with # are passed over. Raises InputInvalid with file and line number.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise InputInvalid(f"{path}: no such file; expected a CSV of waypoints") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputInvalid(f"{path}: cannot be read as text ({error}); expected a CSV") from None
    order: list[str] | None = None
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [cell.strip() for cell in next(csv.reader([line], delimiter=_delimiter(line)))]
        if order is None:
            order = _header(cells, path, number)
            if order is not None:
                continue
            order = ["n", "e", "d"]
        rows.append(_row(cells, order, line, path, number))
    if len(rows) < 2:
        raise InputInvalid(f"{path}: {len(rows)} waypoint(s) were read; expected at least 2")
    return np.array(rows)


def _delimiter(line: str) -> str:
    return next((d for d in (",", ";", "\t") if d in line), ",")


def _header(cells: list[str], path: Path, number: int) -> list[str] | None:
    """Give the order of the columns, or None if the first row holds numbers already."""
    names = [cell.lower().split("[")[0].split("(")[0].strip() for cell in cells]
    if not any(name[:1].isalpha() and name not in ("nan", "inf") for name in names):
        return None
    order = [COLUMNS.get(name, name) for name in names]
    if sorted(order) != ["d", "e", "n"]:
        raise InputInvalid(
            f"{path}:{number}: column names {', '.join(cells)!r} were read; "
            "expected n,e,d or north,east,down"
        )
    return order


def _row(cells: list[str], order: list[str], line: str, path: Path, number: int) -> list[float]:
    wrong = f"{path}:{number}: {line.strip()!r} was read; expected"
    if len(cells) != 3:
        raise InputInvalid(f"{wrong} 3 numbers ({','.join(order)} in metres), not {len(cells)}")
    values: dict[str, float] = {}
    for name, cell in zip(order, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            raise InputInvalid(f"{wrong} a number in metres where {cell!r} stands") from None
        if not math.isfinite(value) or abs(value) > LARGEST:
            raise InputInvalid(f"{wrong} a finite number of at most {LARGEST:.0e} m for {cell!r}")
        if name == "d" and value < 0:
            raise InputInvalid(f"{wrong} a depth of 0 m or more, positive down, for {cell!r}")
        values[name] = value
    return [values["n"], values["e"], values["d"]]
