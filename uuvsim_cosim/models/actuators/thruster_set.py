"""Sets of fitted thruster parameters in a vehicle's thrusters.yaml.

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

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import wraps
from inspect import Parameter, signature
from typing import Any

import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.actuators.thruster_geometry import thrusters_file
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    parameter_set,
    split_address,
    vehicle_folder,
)

__all__ = ["of_vehicle", "options_of"]

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
        for key, value in _values(chosen, vehicle, int(number)).items():
            if key not in model.variables:
                raise InputInvalid(
                    f"{name} of {vehicle}",
                    f"{key} is no parameter with these options",
                    ", ".join(sorted(chosen["parameters"].keys() & model.variables)),
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


def _values(chosen: Mapping[str, Any], vehicle: str, number: int) -> dict[str, float]:
    found = {}
    for key, entry in chosen["parameters"].items():
        value = entry["value"]
        if isinstance(value, list):
            if not 1 <= number <= len(value):
                raise InputInvalid(f"thruster {number} of {vehicle}", f"1 to {len(value)}")
            value = value[number - 1]
        found[str(key)] = float(value)
    return found
