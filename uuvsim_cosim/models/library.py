"""The registry: components by name; one line here makes a declaration known everywhere.

A vehicle needs no line: each folder in models/vehicles is one, addressed as ``id`` or ``id@set``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.model import Model

__all__ = ["LIBRARY", "available", "declare"]

LIBRARY: dict[str, str] = {
    "allocation": "uuvsim_cosim.models.allocation:allocation",
    "allocation_quadratic": "uuvsim_cosim.models.allocation_quadratic:allocation_quadratic",
    "battery": "uuvsim_cosim.models.battery:battery",
    "compass": "uuvsim_cosim.models.compass:compass",
    "controller": "uuvsim_cosim.models.controller:controller",
    "current_gauss_markov": "uuvsim_cosim.models.current:current_gauss_markov",
    "current_ramps": "uuvsim_cosim.models.disturbance:current_ramps",
    "dvl": "uuvsim_cosim.models.dvl:dvl",
    "fins": "uuvsim_cosim.models.fins:fins",
    "guidance": "uuvsim_cosim.models.guidance:guidance",
    "helm": "uuvsim_cosim.models.helm:helm",
    "imu": "uuvsim_cosim.models.imu:imu",
    "link": "uuvsim_cosim.models.link:link",
    "navigation": "uuvsim_cosim.models.navigation:navigation",
    "pilot": "uuvsim_cosim.models.pilot:pilot",
    "pool": "uuvsim_cosim.models.pool:pool",
    "pressure": "uuvsim_cosim.models.pressure:pressure",
    "propeller": "uuvsim_cosim.models.propeller:propeller",
    "reference": "uuvsim_cosim.models.reference:reference",
    "target": "uuvsim_cosim.models.target:target",
    "thruster": "uuvsim_cosim.models.thruster:thruster",
    "thruster_faults": "uuvsim_cosim.models.disturbance:thruster_faults",
    "thruster_jet": "uuvsim_cosim.models.thruster_jet:thruster_jet",
    "thruster_t200": "uuvsim_cosim.models.thruster:thruster_t200",
    "usbl": "uuvsim_cosim.models.usbl:usbl",
    "vehicle": "uuvsim_cosim.models.vehicle:vehicle",
    "wrench": "uuvsim_cosim.models.wrench:wrench",
}


def available() -> list[str]:
    """List the names that `declare` knows; ``vehicle`` itself needs an id and is left out."""
    from uuvsim_cosim.models.parameters import vehicle_ids, vehicle_sets

    addresses = []
    for id in vehicle_ids():
        addresses += [id, *(f"{id}@{name}" for name in vehicle_sets(id))]
    return sorted([*addresses, *(name for name in LIBRARY if name != "vehicle")])


def declare(name: str, **options: Any) -> Model:
    """Declare a component by name; options go to its function, e.g. ``set`` of a vehicle.

    Raises InputInvalid for a name or an option that does not exist.
    """
    from uuvsim_cosim.models.parameters import is_vehicle, split_address

    id, published = split_address(name)
    if id not in LIBRARY and is_vehicle(id):
        options = {"id": id, **({"set": published} if published else {}), **options}
        name = "vehicle"
    if name not in LIBRARY:
        raise InputInvalid(f"there is no model {name!r}; expected one of {', '.join(available())}")
    module, function = LIBRARY[name].split(":")
    declaration = getattr(import_module(module), function)
    try:
        model = declaration(**options)
    except TypeError as error:
        if "argument" not in str(error):
            raise
        raise InputInvalid(f"model {name!r}: {error}") from None
    assert isinstance(model, Model)
    return model
