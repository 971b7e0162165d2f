"""Where a vehicle's thrusters sit and push, and the matrix that makes tau of their thrusts."""

from __future__ import annotations

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
    r = [_vector(path, data, i, "r", "m") for i in range(len(items))]
    e = [_vector(path, data, i, "e", "1") for i in range(len(items))]
    for i, direction in enumerate(e):
        if abs(np.linalg.norm(direction) - 1.0) > 1e-6:
            line = line_of(data, ["thrusters", i, "e"])
            raise ParameterInvalid(f"{path}:{line}: e = {direction}; expected length 1")
    return Geometry(tuple(str(t["name"]) for t in items), np.array(r), np.array(e))


def _vector(path: Path, data: Any, i: int, key: str, unit: str) -> list[float]:
    entry = data["thrusters"][i][key]
    try:
        return [in_unit(float(v), str(entry["unit"]), unit) for v in entry["value"]]
    except ValueError as error:
        line = line_of(data, ["thrusters", i, key])
        raise ParameterInvalid(f"{path}:{line}: {key}: {error}") from None
