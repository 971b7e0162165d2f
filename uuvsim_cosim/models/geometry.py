"""Where a vehicle's thrusters sit and push, and the matrix that makes tau of their thrusts."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from difflib import get_close_matches
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
    size_alone,
    split_address,
    vehicle_folder,
)

__all__ = [
    "Geometry",
    "configuration_matrix",
    "read_thrusters",
    "thruster_geometry",
    "thrusters_file",
]


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
    return read_thrusters(path)


def read_thrusters(path: Path) -> Geometry:
    """Read a file of thrusters; raises ParameterInvalid with the line of every mistake."""
    data = thrusters_file(path)
    items = data["thrusters"]
    r = np.array([_vector(t["r"], "m") for t in items])
    e = np.array([_vector(t["e"], "1") for t in items])
    return Geometry(tuple(str(t["name"]) for t in items), r, e)


def thrusters_file(path: Path) -> Any:
    """Read a file of thrusters as it stands; raises ParameterInvalid with every mistake."""
    return read_yaml(path, "thrusters.schema.json", lambda data: _mistakes(path, data))


def _vector(entry: Any, unit: str) -> list[float]:
    vector = [in_unit(float(v), str(entry["unit"]), unit) for v in entry["value"]]
    if not np.all(np.isfinite(vector)):
        raise ValueError(f"{vector}; expected three numbers")
    return vector


def _mistakes(path: Path, data: Any) -> Iterator[tuple[int, str]]:
    """Give (line, sentence) of each thruster that cannot stand there or push that way."""
    if "model" in data:
        yield from _unknown_model(data)
    if "sets" in data:
        from uuvsim_cosim.models.thruster_set import set_mistakes

        yield from set_mistakes(data)
    reach = _reach(path)
    seen: dict[tuple[float, ...], str] = {}
    for i, item in enumerate(data["thrusters"]):
        name, vectors = str(item.get("name", i + 1)), {}
        for key, unit in (("r", "m"), ("e", "1")):
            try:
                if len(item[key]["value"]) == 3:  # else the schema says so, as below
                    vectors[key] = _vector(item[key], unit)
            except (KeyError, TypeError):
                continue
            except ValueError as error:
                yield line_of(data, ["thrusters", i, key]), f"{name}: {key}: {error}"
        line = line_of(data, ["thrusters", i, "r"])
        if "e" in vectors and abs(np.linalg.norm(vectors["e"]) - 1.0) > 1e-6:
            at = line_of(data, ["thrusters", i, "e"])
            yield at, f"{name}: e = {vectors['e']}; expected length 1"
        distance = float(np.linalg.norm(vectors.get("r", [0.0])))
        if reach is not None and distance > reach:
            text = f"{name}: r = {vectors['r']} m is {distance:.3g} m from CO; expected at most "
            yield line, text + f"{reach:.3g} m, the hull's size"
        if len(vectors) == 2:
            place, push = np.round(vectors["r"], 6), np.abs(np.round(vectors["e"], 6))
            key_ = (*place.tolist(), *push.tolist())
            if key_ in seen:
                yield line, f"{name}: stands where {seen[key_]} does; expected another place"
            seen.setdefault(key_, name)


def _unknown_model(data: Any) -> Iterator[tuple[int, str]]:
    from uuvsim_cosim.models.library import LIBRARY

    model, known = str(data["model"]), [n for n in LIBRARY if n.startswith(("thruster", "prop"))]
    if model not in known:
        near = get_close_matches(model, known, 2) or known
        yield line_of(data, ["model"]), f"model: {model!r}; expected {' or '.join(near)}"


def _reach(path: Path) -> float | None:
    """Give the largest distance from CO that a part of the vehicle may have, None if unknown.

    The size alone is read: what else is wrong with the hull's file is said where the hull is read.
    """
    try:
        size = size_alone(path.parent / "parameters.yaml")
    except ParameterInvalid:
        return None
    if size is None:
        return None
    half = 0.5 * np.array([size.length, size.breadth, size.height])
    return float(1.25 * np.linalg.norm(half + np.abs(size.at)))
