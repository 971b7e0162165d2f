"""Registry of components by name: one line here makes a declaration known everywhere.

A vehicle needs no line: each folder in models/vehicles is one, addressed as ``id`` or ``id@set``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import Parameter, signature
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qsl, unquote

from uuvsim_cosim.errors import InputInvalid, UuvsimError
from uuvsim_cosim.models.declaration.interruption import interruptible
from uuvsim_cosim.models.declaration.near_names import did_you_mean
from uuvsim_cosim.models.declaration.parameter_files import (
    is_vehicle,
    split_address,
    vehicle_ids,
    vehicle_sets,
)

if TYPE_CHECKING:
    from uuvsim_cosim.models.declaration.model import Model

__all__ = ["ALIASES", "IN_PROCESS", "LIBRARY", "available", "declare", "declare_source"]

LIBRARY: dict[str, str] = {
    "allocation": "uuvsim_cosim.models.control.allocation:allocation",
    "allocation_qp": "uuvsim_cosim.models.control.allocation:allocation_qp",
    "allocation_quadratic": "uuvsim_cosim.models.control.allocation:allocation_quadratic",
    "altimeter": "uuvsim_cosim.models.sensors.altimeter:altimeter",
    "autopilot": "uuvsim_cosim.models.control.autopilot:autopilot",
    "backstepping": "uuvsim_cosim.models.control.backstepping:backstepping",
    "ballast": "uuvsim_cosim.models.hull.ballast:ballast",
    "battery": "uuvsim_cosim.models.actuators.battery:battery",
    "color_camera": "uuvsim_cosim.models.sensors.color_camera:color_camera",
    "compass": "uuvsim_cosim.models.sensors.compass:compass",
    "contact": "uuvsim_cosim.models.hull.contact:contact",
    "controller": "uuvsim_cosim.models.control.controller:controller",
    "current_gauss_markov": "uuvsim_cosim.models.water.current:current_gauss_markov",
    "current_grid": "uuvsim_cosim.models.water.current:current_grid",
    "current_profile": "uuvsim_cosim.models.water.current:current_profile",
    "current_ramps": "uuvsim_cosim.models.water.current:current_ramps",
    "depth_camera": "uuvsim_cosim.models.sensors.multibeam_and_camera:depth_camera",
    "dvl": "uuvsim_cosim.models.sensors.dvl:dvl",
    "feedback_linearisation": (
        "uuvsim_cosim.models.control.feedback_linearisation:feedback_linearisation"
    ),
    "fins": "uuvsim_cosim.models.actuators.fins:fins",
    "gps": "uuvsim_cosim.models.sensors.gps:gps",
    "guidance": "uuvsim_cosim.models.guidance.line_of_sight:guidance",
    "helm": "uuvsim_cosim.models.guidance.helm:helm",
    "imaging_sonar": "uuvsim_cosim.models.sensors.imaging_sonar:imaging_sonar",
    "imu": "uuvsim_cosim.models.sensors.imu:imu",
    "lbl": "uuvsim_cosim.models.sensors.lbl:lbl",
    "leak": "uuvsim_cosim.models.sensors.leak:leak",
    "link": "uuvsim_cosim.models.sensors.link:link",
    "lqr": "uuvsim_cosim.models.control.lqr:lqr",
    "magnetometer": "uuvsim_cosim.models.sensors.magnetometer:magnetometer",
    "modem": "uuvsim_cosim.models.sensors.modem:modem",
    "mpc": "uuvsim_cosim.models.control.mpc:mpc",
    "multibeam": "uuvsim_cosim.models.sensors.multibeam_and_camera:multibeam",
    "multibeam_sonar": "uuvsim_cosim.models.sensors.imaging_sonar:multibeam_sonar",
    "navigation": "uuvsim_cosim.models.navigation.error_state_filter:navigation",
    "navigation_fixes": "uuvsim_cosim.models.navigation.navigation_fixes:navigation_fixes",
    "path_following": "uuvsim_cosim.models.guidance.path_following:path_following",
    "pilot": "uuvsim_cosim.models.guidance.pilot:pilot",
    "policy": "uuvsim_cosim.models.policies.policy:policy",
    "pool": "uuvsim_cosim.models.hull.pool:pool",
    "predictor": "uuvsim_cosim.models.navigation.predictor:predictor",
    "pressure": "uuvsim_cosim.models.sensors.pressure:pressure",
    "propeller": "uuvsim_cosim.models.actuators.propeller:propeller",
    "reference": "uuvsim_cosim.models.guidance.reference:reference",
    "scanning_sonar": "uuvsim_cosim.models.sensors.scanning_sonar:scanning_sonar",
    "side_scan_sonar": "uuvsim_cosim.models.sensors.scanning_sonar:side_scan_sonar",
    "sliding_mode": "uuvsim_cosim.models.control.sliding_mode:sliding_mode",
    "target": "uuvsim_cosim.models.guidance.target:target",
    "tether": "uuvsim_cosim.models.hull.tether:tether",
    "thruster": "uuvsim_cosim.models.actuators.thruster:thruster",
    "thruster_faults": "uuvsim_cosim.models.actuators.faults:thruster_faults",
    "thruster_jet": "uuvsim_cosim.models.actuators.thruster:thruster_jet",
    "thruster_t200": "uuvsim_cosim.models.actuators.thruster:thruster_t200",
    "trajectory": "uuvsim_cosim.models.guidance.trajectory:trajectory",
    "usbl": "uuvsim_cosim.models.sensors.usbl:usbl",
    "vehicle": "uuvsim_cosim.models.hull.vehicle:vehicle",
    "water_column": "uuvsim_cosim.models.water.stratification:water_column",
    "waves": "uuvsim_cosim.models.water.waves:waves",
    "wrench": "uuvsim_cosim.models.actuators.wrench:wrench",
    "yo_yo": "uuvsim_cosim.models.guidance.yo_yo:yo_yo",
}

# Other words for the same: they are found, but not listed.
ALIASES: dict[str, str] = {"dp": "controller", "pid": "controller"}
# Components that are no declarations, and run in this process only.
IN_PROCESS: dict[str, str] = {"mpc_ipopt": "uuvsim_cosim.models.control.mpc_in_process:IpoptMPC"}


def available() -> list[str]:
    """List the names that `declare` knows; ``vehicle`` itself needs an id and is left out."""
    addresses = []
    for id in vehicle_ids():
        addresses += [id, *(f"{id}@{name}" for name in vehicle_sets(id))]
    return sorted([*addresses, *(name for name in LIBRARY if name != "vehicle")])


def declare_source(text: str) -> Model:
    """Declare a component by name and options, ``dvl@a50?scene=tacoma``, ``model:`` or not."""
    name, _, query = text.removeprefix("model:").partition("?")
    return _declared(unquote(name), dict(parse_qsl(query, keep_blank_values=True)))


def declare(name: str, **options: Any) -> Model:
    """Declare a component of the library by `name`, such as ``thruster``, ``remus100``.

    `options` are those of the component, for example the parameter ``set`` of a vehicle.
    ``imu@stim300`` is short for the component ``imu`` with the option ``id="stim300"``. Raises
    InputInvalid for a name or an option that does not exist.

    Example:

    >>> import uuvsim_cosim as uuv
    >>> hull = uuv.declare("remus100", set="fossen_2021")
    >>> hull.description
    'Hull of remus100, parameter set fossen_2021'
    >>> [(v.name, v.shape) for v in hull.of_kind("input")]
    [('tau', (6,)), ('v_c', (3,))]
    """
    return _declared(name, options)


@interruptible()
def _declared(name: str, options: Mapping[str, Any]) -> Model:
    """Declare a component; an option may have any name, `name` included, and be refused."""
    id, published = split_address(name)
    if id not in LIBRARY and is_vehicle(id):
        options = {"id": id, **({"set": published} if published else {}), **options}
        name = "vehicle"
    elif published and ALIASES.get(id, id) in LIBRARY:  # an instrument: imu@stim300
        options, name = {"id": published, **options}, id
    name = ALIASES.get(name, name)
    if name in IN_PROCESS:
        raise InputInvalid(
            f"{name} is no declaration but a Python component ({IN_PROCESS[name]})",
            "it runs in a system, in process, and is not exported or fused",
            "a model such as lqr",
        )
    if name not in LIBRARY:
        hint = did_you_mean(name, [*available(), *ALIASES, *IN_PROCESS])
        raise InputInvalid(f"there is no model {name!r}{hint}", "one that `uuvsim models` lists")
    module, function = LIBRARY[name].split(":")
    declaration = getattr(import_module(module), function)
    try:
        model = declaration(**options)
    except TypeError as error:
        raise _wrong_option(name, declaration, options, error) from None
    except (ValueError, ZeroDivisionError) as error:  # an option's text that is no number
        if isinstance(error, UuvsimError) or not any(isinstance(v, str) for v in options.values()):
            raise
        given = ", ".join(f"{option}={value}" for option, value in options.items())
        raise InputInvalid(f"model {name!r} with {given}", error, "a number") from None
    result: Model = model
    result.made_for.update(_made_for(name, declaration, options))
    return result


def _made_for(
    name: str, declaration: Callable[..., Model], options: Mapping[str, Any]
) -> dict[str, str]:
    """Return the vehicle and the parameter set (``id@set``) that a declaration takes figures of."""
    what, option = ("hull", "id") if name == "vehicle" else ("figures", "vehicle")
    taken = signature(declaration).parameters
    address = options.get(option, taken[option].default) if option in taken else ""
    if not isinstance(address, str) or not address:
        return {}
    id, published = split_address(address)
    if not is_vehicle(id):
        return {}
    published = options.get("set") or published if name == "vehicle" else published
    return {what: f"{id}@{published or vehicle_sets(id)[0]}"}


def _wrong_option(
    name: str, declaration: Callable[..., Model], options: Mapping[str, Any], error: TypeError
) -> Exception:
    """Return the error of a model's wrong option; any other error is returned as it is."""
    taken = signature(declaration).parameters
    unknown = [key for key in options if key not in taken]
    if any(p.kind is p.VAR_KEYWORD for p in taken.values()) or not unknown:
        return error if "argument" not in str(error) else InputInvalid(f"model {name!r}: {error}")
    key = unknown[0]
    if key == "id":
        own = [n for n in LIBRARY if n.startswith(f"{name}_")]
        hint = did_you_mean(f"{name}_{options[key]}", own)
        return InputInvalid(f"model {name!r} has no presets, as {options[key]!r}{hint}")
    kinds = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
    as_text = [k for k, p in taken.items() if p.kind in kinds]
    in_python = ("Parameters", "Mapping", "Preset")  # types of which no text can be
    known = [k for k in as_text if not any(t in str(taken[k].annotation) for t in in_python)]
    return InputInvalid(
        f"model {name!r}",
        f"there is no option {key!r}{did_you_mean(key, known)}",
        f"{', '.join(known) or 'none'} (a parameter is set: --set component.parameter=value)",
    )
