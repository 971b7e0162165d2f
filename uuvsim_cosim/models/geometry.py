"""Where a vehicle's thrusters sit and push, and the matrix that makes tau of their thrusts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.parameters import (
    in_unit,
    is_vehicle,
    line_of,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_size,
)

__all__ = ["Geometry", "configuration_matrix", "thruster_geometry"]


@dataclass(frozen=True)
class Geometry:
    """n thrusters: names, positions r (n, 3) [m] from CO and unit directions e (n, 3), in b."""

    names: tuple[str, ...]
    r: NDArray[np.float64]
    e: NDArray[np.float64]


def configuration_matrix(geometry: Geometry) -> NDArray[np.float64]:
    """Give T (6, n) of  tau = T thrust:  columns (e, r x e)."""
    return np.vstack([geometry.e.T, np.cross(geometry.r, geometry.e).T])


@lru_cache
def thruster_geometry(vehicle: str) -> Geometry:
    """Read the thrusters of a vehicle, by its id or its folder, or of a file (.yaml)."""
    is_file = vehicle.endswith((".yaml", ".yml"))
    path = Path(vehicle)
    if not is_file:
        vehicle, _ = split_address(vehicle)
        folder = vehicle_folder(vehicle) if is_vehicle(vehicle) else Path(vehicle)
        path = folder / "thrusters.yaml"
    if not path.is_file():
        known = sorted(
            p.parent.name for p in content("models", "vehicles").glob("*/thrusters.yaml")
        )
        raise ParameterInvalid(
            f"there is no thruster geometry of {vehicle!r}; expected {', '.join(known)}, "
            "or the path of a folder or a file (.yaml)"
        )
    data = read_yaml(path, "thrusters.schema.json")
    items = data["thrusters"]
    problems: list[str] = []
    r = [_vector(path, data, i, "r", "m", problems) for i in range(len(items))]
    e = [_vector(path, data, i, "e", "1", problems) for i in range(len(items))]
    if not problems:
        problems += _misplaced(path, data, r, e)
    if problems:
        raise ParameterInvalid("\n  ".join(problems))
    return Geometry(tuple(str(t["name"]) for t in items), np.array(r), np.array(e))


def _vector(path: Path, data: Any, i: int, key: str, unit: str, problems: list[str]) -> list[float]:
    entry = data["thrusters"][i][key]
    line = line_of(data, ["thrusters", i, key])
    try:
        vector = [in_unit(float(v), str(entry["unit"]), unit) for v in entry["value"]]
    except ValueError as error:
        problems.append(f"{path}:{line}: {key}: {error}")
        return [0.0] * 3
    if not np.all(np.isfinite(vector)):
        problems.append(f"{path}:{line}: {key} = {vector}; expected three numbers")
    return vector


def _misplaced(path: Path, data: Any, r: list[list[float]], e: list[list[float]]) -> Iterator[str]:
    """Give a sentence for each thruster that cannot stand there or push that way."""
    reach = _reach(path)
    seen: dict[tuple[float, ...], str] = {}
    for i, (place, direction) in enumerate(zip(r, e, strict=True)):
        name = str(data["thrusters"][i]["name"])
        line = line_of(data, ["thrusters", i, "e"])
        if abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            yield f"{path}:{line}: e = {direction}; expected length 1"
        line = line_of(data, ["thrusters", i, "r"])
        distance = float(np.linalg.norm(place))
        if reach is not None and distance > reach:
            yield (
                f"{path}:{line}: {name}: r = {place} m is {distance:.3g} m from CO; expected at "
                f"most {reach:.3g} m, the hull's size"
            )
        key = (*np.round(place, 6).tolist(), *np.abs(np.round(direction, 6)).tolist())
        if key in seen:
            yield f"{path}:{line}: {name}: stands where {seen[key]} does; expected another place"
        seen.setdefault(key, name)


def _reach(path: Path) -> float | None:
    """Give the largest distance from CO that a part of the vehicle may have, None if unknown."""
    folder = path.parent
    if not (folder / "parameters.yaml").is_file():
        return None
    size = vehicle_size(str(folder / "parameters.yaml"))
    if size is None:
        return None
    half = 0.5 * np.array([size.length, size.breadth, size.height])
    return float(1.25 * np.linalg.norm(half + np.abs(size.at)))
