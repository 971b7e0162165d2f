"""A vehicle's thrusters.yaml: places and directions of thrusters, and sets of fitted parameters.

    sets:
      my_fit:                       # of the same name as the hull's set that was fitted with it
        model: thruster             # the component that the numbers are of
        options: {dead_band: true}  # with which it is declared; none unless given
        source: "identified from dive on 2025-07-01 by uuvsim identify"
        parameters:
          K_n: {value: 3.1e-4, unit: N.s2/rad2, interval: [3.0e-4, 3.2e-4], source: "..."}

A value may be a list with one number for each thruster: `number` says which of them. Components
that take such a set have the option ``vehicle``: ``model:thruster?vehicle=my_rov@my_fit``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.library import LIBRARY, declare
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    is_vehicle,
    line_of,
    parameter_set,
    read_yaml,
    size_alone,
    split_address,
    vehicle_folder,
)

__all__ = [
    "NO_THRUSTERS",
    "OF_VEHICLE",
    "Geometry",
    "configuration_matrix",
    "of_vehicle",
    "options_of",
    "read_thrusters",
    "thruster_geometry",
    "thrusters_file",
]

# What is wrong with a vehicle's folder without thrusters.yaml, and what is expected.
NO_THRUSTERS = (
    "no such file, so the vehicle has no thrusters and no propeller",
    "one with the place and the direction of each (docs/vehicles/add_a_vehicle.md)",
)

# The components that take a set of numbers of thrusters.yaml, by their option `vehicle`.
OF_VEHICLE = ("thruster", "thruster_t200", "thruster_jet")


@dataclass(frozen=True)
class Geometry:
    """n thrusters: names, positions r (n, 3) [m] from CO and unit directions e (n, 3), in b."""

    names: tuple[str, ...]
    r: NDArray[np.float64]
    e: NDArray[np.float64]


def configuration_matrix(geometry: Geometry) -> NDArray[np.float64]:
    """Return T (6, n) of  tau = T thrust:  columns (e, r x e)."""
    return np.vstack([geometry.e.T, np.cross(geometry.r, geometry.e).T])


@shared_until_changed
def thruster_geometry(vehicle: str) -> Geometry:
    """Read the thrusters of a vehicle, by its id or its folder, or of a file (.yaml)."""
    is_file = vehicle.endswith((".yaml", ".yml"))
    path = Path(vehicle)
    if not is_file:
        vehicle, _ = split_address(vehicle)
        folder = vehicle_folder(vehicle) if is_vehicle(vehicle) else Path(vehicle)
        path = folder / "thrusters.yaml"
        if (folder / "parameters.yaml").is_file() and not path.is_file():
            raise ParameterInvalid(path, *NO_THRUSTERS)
    if not path.is_file():
        known = sorted(
            p.parent.name for p in content("models", "vehicles").glob("*/thrusters.yaml")
        )
        raise ParameterInvalid(
            f"there is no thruster geometry of {vehicle!r}",
            f"{', '.join(known)}, or the path of a folder or a file (.yaml)",
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
    """Yield (line, sentence) of each thruster that cannot stand there or push that way."""
    models = [n for n in LIBRARY if n.startswith(("thruster", "prop"))]
    if "model" in data and str(data["model"]) not in models:
        expected = expected_names(data["model"], models)
        yield line_of(data, ["model"]), f"model: {str(data['model'])!r}; expected {expected}"
    if "sets" in data:
        yield from _set_mistakes(data)
    reach = float("inf")  # m from CO
    # Only the size is read: other mistakes in the hull's file are reported where the hull is read.
    size = size_alone(path.parent / "parameters.yaml")
    if size is not None:
        half = 0.5 * np.array([size.length, size.breadth, size.height])
        reach = float(1.25 * np.linalg.norm(half + np.abs(size.at)))
    seen: dict[tuple[float, ...], str] = {}
    for i, item in enumerate(data["thrusters"]):
        name, vectors = str(item.get("name", i + 1)), {}
        for key, unit in (("r", "m"), ("e", "1")):
            try:
                entry = item[key]["value"]
                # Other lengths, and entries that are no numbers, are mistakes of the schema.
                if len(entry) == 3 and all(isinstance(x, int | float) for x in entry):
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
        if distance > reach:
            text = f"{name}: r = {vectors['r']} m is {distance:.3g} m from CO; expected at most "
            yield line, text + f"{reach:.3g} m, the hull's size"
        if len(vectors) == 2:
            place, push = np.round(vectors["r"], 6), np.abs(np.round(vectors["e"], 6))
            key_ = (*place.tolist(), *push.tolist())
            if key_ in seen:
                yield line, f"{name}: stands where {seen[key_]} does; expected another place"
            seen.setdefault(key_, name)


def _set_mistakes(data: Any) -> Iterator[tuple[int, str]]:
    """Yield (line, sentence) of each set that is not one of its component's, in a file as read."""
    for name, chosen in data["sets"].items():
        at = ["sets", name]
        model = str(chosen["model"])
        if model not in OF_VEHICLE:
            yield line_of(data, [*at, "model"]), f"{model}: expected {', '.join(OF_VEHICLE)}"
            continue
        options = chosen.get("options", {})
        if own := sorted(options.keys() & {"vehicle", "number"}):
            wrong = f"options: {' and '.join(own)}: are set where the component is used; expected"
            yield line_of(data, [*at, "options"]), f"{wrong} options of {model} alone"
            continue
        try:
            declared = declare(model, **options)
        except InputInvalid as error:
            yield line_of(data, [*at, "options"]), f"options: {error}"
            continue
        variables = {v.name: v for v in declared.of_kind("parameter", "input") if v.size == 1}
        for key, entry in chosen["parameters"].items():
            line = line_of(data, [*at, "parameters", key])
            if key not in variables:
                expected = expected_names(key, sorted(variables))
                yield line, f"{key}: not a parameter of {model}; expected {expected}"
                continue
            values = entry["value"] if isinstance(entry["value"], list) else [entry["value"]]
            if len(values) not in (1, len(data["thrusters"])):
                yield line, f"{key}: {len(values)} values; expected 1 or {len(data['thrusters'])}"
            v = variables[key]
            try:
                numbers = [in_unit(float(x), str(entry["unit"]), v.unit) for x in values]
            except ValueError as error:
                yield line, f"{key}: {error}"
                continue
            low = -float("inf") if v.min is None else v.min
            high = float("inf") if v.max is None else v.max
            if not all(low <= x <= high for x in numbers):
                yield line, f"{key} = {values}: expected {low:g} to {high:g} {v.unit}"


Declaration = Callable[..., Model]


def of_vehicle(declaration: Declaration) -> Declaration:
    """Add the options `vehicle` (``id@set``) and `number` (from 1) to a thruster's declaration."""
    name = declaration.__name__
    own = signature(declaration)
    defaults = {k: p.default for k, p in own.parameters.items()}

    @wraps(declaration)
    def declared(*args: Any, vehicle: str = "", number: int | str = 1, **options: Any) -> Model:
        if not vehicle:
            return declaration(*args, **options)
        chosen = _chosen(name, vehicle)
        given = {k: v for k, v in options.items() if k not in defaults or v != defaults[k]}
        model = declaration(*args, **{**chosen.get("options", {}), **given})
        for key, entry in chosen["parameters"].items():
            value = entry["value"]
            if isinstance(value, list):
                if not 1 <= int(number) <= len(value):
                    raise InputInvalid(f"thruster {number} of {vehicle}", f"1 to {len(value)}")
                value = value[int(number) - 1]
            if key not in model.variables:
                raise InputInvalid(
                    f"{name} of {vehicle}",
                    f"{key} is no parameter with these options",
                    ", ".join(sorted(chosen["parameters"].keys() & model.variables)),
                )
            unit = model.variables[key].unit
            start = in_unit(float(value), str(entry["unit"]), unit)
            model.variables[key] = replace(model.variables[key], start=np.array([start]))
        return model

    added = [Parameter(n, Parameter.KEYWORD_ONLY, default=d) for n, d in (("vehicle", ""),
             ("number", 1))]  # fmt: skip
    declared.__signature__ = own.replace(  # type: ignore[attr-defined]
        parameters=[*own.parameters.values(), *added]
    )
    return declared


def options_of(name: str, options: Mapping[str, str]) -> dict[str, str]:
    """Return a component's options with those of its vehicle's set in the place of `vehicle`."""
    rest = {k: v for k, v in options.items() if k not in ("vehicle", "number")}
    if "vehicle" not in options:
        return rest
    return {**_chosen(name, options["vehicle"]).get("options", {}), **rest}


def _chosen(name: str, vehicle: str) -> Mapping[str, Any]:
    """Read the set that ``id@set`` names; without @, that of the hull's default set."""
    id, wanted = split_address(vehicle)
    file = vehicle_folder(id) / "thrusters.yaml"
    if not file.is_file():
        raise ParameterInvalid(file, "no such file", "one with the vehicle's thrusters")
    sets = thrusters_file(file).get("sets", {})
    wanted = wanted or parameter_set(id).name
    if wanted not in sets:
        raise ParameterInvalid(
            f"{file}: there is no set {wanted!r} of its thrusters; expected "
            + (", ".join(sets) or f"one under `sets:`, or model:{name} without vehicle")
        )
    chosen: Mapping[str, Any] = sets[wanted]
    if chosen["model"] != name:
        raise ParameterInvalid(
            file,
            f"the set {wanted!r} is of model:{chosen['model']}",
            f"model:{chosen['model']}?vehicle={vehicle}, not model:{name}",
        )
    return chosen
