"""A thruster's numbers as a vehicle's folder holds them: named sets in its thrusters.yaml.

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
from dataclasses import replace
from difflib import get_close_matches
from functools import wraps
from inspect import Parameter, signature
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.parameters import (
    in_unit,
    line_of,
    parameter_set,
    split_address,
    vehicle_folder,
)

__all__ = ["OF_VEHICLE", "of_vehicle", "options_of", "set_mistakes"]

Declaration = Callable[..., Model]
OF_VEHICLE: dict[str, Declaration] = {}  # the components that take a set, without `vehicle`


def of_vehicle(declaration: Declaration) -> Declaration:
    """Give a thruster's declaration the options `vehicle` (``id@set``) and `number` (from 1)."""
    name = declaration.__name__
    own = signature(declaration)
    defaults = {k: p.default for k, p in own.parameters.items()}
    OF_VEHICLE[name] = declaration

    @wraps(declaration)
    def declared(*args: Any, vehicle: str = "", number: int | str = 1, **options: Any) -> Model:
        if not vehicle:
            return declaration(*args, **options)
        chosen = _chosen(name, vehicle)
        given = {k: v for k, v in options.items() if k not in defaults or v != defaults[k]}
        model = declaration(*args, **{**chosen.get("options", {}), **given})
        for key, value in _values(chosen, vehicle, int(number)).items():
            if key not in model.variables:
                raise InputInvalid(
                    f"{name} of {vehicle}: {key} is no parameter with these options; expected "
                    f"{', '.join(sorted(chosen['parameters'].keys() & model.variables))}"
                )
            unit = model.variables[key].unit
            start = in_unit(value, str(chosen["parameters"][key]["unit"]), unit)
            model.variables[key] = replace(model.variables[key], start=np.array([start]))
        return model

    added = [Parameter(n, Parameter.KEYWORD_ONLY, default=d) for n, d in (("vehicle", ""),
             ("number", 1))]  # fmt: skip
    declared.__signature__ = own.replace(  # type: ignore[attr-defined]
        parameters=[*own.parameters.values(), *added]
    )
    return declared


def options_of(name: str, options: Mapping[str, str]) -> dict[str, str]:
    """Give a component's options with those of its vehicle's set in the place of `vehicle`."""
    rest = {k: v for k, v in options.items() if k not in ("vehicle", "number")}
    if "vehicle" not in options:
        return rest
    return {**_chosen(name, options["vehicle"]).get("options", {}), **rest}


def _chosen(name: str, vehicle: str) -> Mapping[str, Any]:
    """Read the set that ``id@set`` names; without @, that of the hull's default set."""
    from uuvsim_cosim.models.geometry import thrusters_file

    id, wanted = split_address(vehicle)
    file = vehicle_folder(id) / "thrusters.yaml"
    if not file.is_file():
        raise ParameterInvalid(f"{file}: no such file; expected one with the vehicle's thrusters")
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
            f"{file}: the set {wanted!r} is of model:{chosen['model']}; expected "
            f"model:{chosen['model']}?vehicle={vehicle}, not model:{name}"
        )
    return chosen


def _values(chosen: Mapping[str, Any], vehicle: str, number: int) -> dict[str, float]:
    found = {}
    for key, entry in chosen["parameters"].items():
        value = entry["value"]
        if isinstance(value, list):
            if not 1 <= number <= len(value):
                raise InputInvalid(f"thruster {number} of {vehicle}; expected 1 to {len(value)}")
            value = value[number - 1]
        found[str(key)] = float(value)
    return found


def set_mistakes(data: Any) -> Iterator[tuple[int, str]]:
    """Give (line, sentence) of each set that is not one of its component's, in a file as read."""
    from uuvsim_cosim.models import thruster, thruster_jet

    known = {n: OF_VEHICLE[n] for m in (thruster, thruster_jet) for n in m.__all__
             if n in OF_VEHICLE}  # fmt: skip
    for name, chosen in data["sets"].items():
        at = ["sets", name]
        model = str(chosen["model"])
        if model not in known:
            yield line_of(data, [*at, "model"]), f"{model}: expected {', '.join(known)}"
            continue
        try:
            declared = known[model](**chosen.get("options", {}))
        except (InputInvalid, TypeError) as error:
            yield line_of(data, [*at, "options"]), f"options: {error}"
            continue
        variables = {v.name: v for v in declared.of_kind("parameter", "input") if v.size == 1}
        for key, entry in chosen["parameters"].items():
            line = line_of(data, [*at, "parameters", key])
            if key not in variables:
                near = get_close_matches(str(key), variables, 3) or sorted(variables)
                yield line, f"{key}: not a parameter of {model}; expected {', '.join(near)}"
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
