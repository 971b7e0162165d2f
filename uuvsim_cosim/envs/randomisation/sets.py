"""Ready-made sets of parameters: a hull's published intervals, sensors, current, thrusters, delays.

A study file names them under `sets`; `published.py` makes randomisations of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.envs.randomisation.distributions import Distribution, LogUniform, Normal, Uniform
from uuvsim_cosim.envs.randomisation.targets import Declared, Places, Vary
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

__all__ = [
    "SETS",
    "current_of_any_direction",
    "delays_of_components",
    "noise_of_sensors",
    "published_intervals",
    "strength_of_thrusters",
]

NOISE = ("noise_density", "sigma", "sigma_v", "sigma_v_relative", "sigma_range", "sigma_angle")


def published_intervals(
    vehicle: str,
    prefix: str = "hull",
    set: str | None = None,
    distribution: Callable[[float, float], Distribution] | None = None,
) -> Declared:
    """Draw each number of a hull from the interval of all its published values.

    An identified set has a normal distribution, with the correlation of its errors.
    """
    from uuvsim_cosim.models.declaration.parameter_files import (
        in_unit,
        is_vehicle,
        parameter_set,
        read_yaml,
        split_address,
        vehicle_folder,
    )

    vehicle, own = split_address(vehicle)
    there = sorted(p.parent.name for p in content("models", "vehicles").glob("*/published.yaml"))
    if not is_vehicle(vehicle) or not (vehicle_folder(vehicle) / "published.yaml").is_file():
        raise InputInvalid(
            f"no published intervals of {vehicle!r}",
            f"{', '.join(there)}, or a folder with a published.yaml",
        )
    file = vehicle_folder(vehicle) / "published.yaml"
    data = read_yaml(file, "published.schema.json")
    ships = file.is_relative_to(content())
    place = file.relative_to(content()).as_posix() if ships else str(file.absolute())
    known = parameter_set(vehicle, set or own or None).quantities
    found: list[Vary] = []
    chosen = set or own
    identified: list[str] = []
    for name, values in data["parameters"].items():
        if name not in known:
            continue
        unit = known[name].unit
        values = [v for v in values if v.get("set", chosen) == chosen]
        values = [v for v in values if "set" in v] or values
        if len(values) < 2:
            continue
        numbers = [in_unit(float(v["value"]), str(v["unit"]), unit) for v in values]
        sources = tuple((place, " ".join(str(v["source"]).split())) for v in values)
        low, high = min(numbers), max(numbers)
        if "set" in values[0]:
            identified.append(name)
            drawn = (distribution or _normal(known[name].value))(low, high)
        else:
            drawn = (distribution or Uniform)(low, high)
        found.append(Vary(f"{prefix}.{name}", drawn, sources=sources))
    pairs = {}
    for entry in data.get("correlation", ()):
        a, b = entry["between"]
        # The errors of a fit have their own correlation, whatever was published of the two.
        own_pair = a in identified and b in identified
        if entry.get("set") == (chosen if own_pair else None) and (
            {f"{prefix}.{a}", f"{prefix}.{b}"} <= {vary.name for vary in found}
        ):
            pairs[f"{prefix}.{a}", f"{prefix}.{b}"] = float(entry["value"])
    return Declared(found, pairs)


def _normal(value: float) -> Callable[[float, float], Distribution]:
    """Return a maker of the normal distribution about `value` of a 95 % interval.

    It ends at three deviations: numbers are saved only if that is less than the number itself.
    """

    def made(low: float, high: float) -> Distribution:
        std = (high - low) / (2.0 * 1.96)
        return Normal(value, std, value - 3.0 * std, value + 3.0 * std)

    return made


def noise_of_sensors(system: System, low: float = 0.5, high: float = 2.0) -> Declared:
    """Scale the noise of every sensor: densities, deviations and biases, independently."""
    places = Places(system)
    names = [
        f"{c.path}.{v.name}"
        for c in places.plan.components
        if any(v.name == "t_sample" for v in c.description.of("output"))
        and not any(v.name.endswith("_t_sample") for v in c.description.of("input"))
        for v in c.description.of("parameter")
        if v.name in NOISE or v.name.endswith(("_noise_density", "_sigma"))
    ]
    factor = LogUniform(low, high)
    noisy = [n for n in names if np.any(places.start(n) != 0.0)]
    _must(noisy, system, "sensor with noise", "components with an output t_sample, as model:imu")
    return Declared([Vary(n, factor, relative=True, together=True) for n in noisy])


def current_of_any_direction(system: System, speed: float = 0.5) -> Declared:
    """Draw a current of up to `speed` [m/s] from any direction."""
    places = Places(system)
    found: list[Vary] = []
    for c in places.plan.components:
        variables = c.description.variables
        if {"speed", "direction"} <= variables.keys() and "v_c" in variables:
            found.append(Vary(f"{c.path}.speed", Uniform(0.0, speed), "m/s"))
            found.append(Vary(f"{c.path}.direction", Uniform(-np.pi, np.pi), "rad"))
    for name in _free(places, "v_c"):
        part = speed / 2.0**0.5
        found.append(Vary(f"{name}[1:2]", Uniform(-part, part), "m/s"))
    _must(found, system, "current", "model:current_gauss_markov, or a hull with a free v_c")
    return Declared(found)


def strength_of_thrusters(
    system: System, low: float = 0.8, high: float = 1.1, voltage: tuple[float, float] = (13.0, 16.0)
) -> Declared:
    """Scale each thruster's `K_n`; where strength follows the supply, draw the supply's voltage."""
    places = Places(system)
    found: list[Vary] = []
    for name in places.variables:
        own = name.rpartition(".")[2]
        if own == "K_n":
            found.append(Vary(name, Uniform(low, high), relative=True))
        elif own == "soc_0":
            found.append(Vary(name, Uniform(0.3, 1.0)))
    if _free(places, "voltage"):
        found.append(Vary("*.voltage", Uniform(*voltage), "V", together=True))
    _must(found, system, "thruster", "parameters K_n, a free voltage, or a battery")
    return Declared(found)


def delays_of_components(system: System, most: float = 0.2) -> Declared:
    """Draw every delay from 0 to `most` [s], or to what its component allows."""
    places = Places(system)
    found = []
    for name, v in places.variables.items():
        own = name.rpartition(".")[2]
        if v.causality == "parameter" and v.unit == "s" and own.startswith("delay"):
            found.append(Vary(name, Uniform(v.min or 0.0, min(most, v.max or most))))
    _must(found, system, "delay", "components with a parameter `delay`, as model:link")
    return Declared(found)


def _free(places: Places, own: str) -> list[str]:
    """List the unconnected inputs of a name."""
    fed = {
        f"{places.plan.components[t.target].path}.{t.target_variable.name}"
        for t in places.plan.transfers
    }
    return [
        name
        for name, v in places.variables.items()
        if v.causality == "input" and name.rpartition(".")[2] == own and name not in fed
    ]


def _must(found: Iterable[object], system: System, what: str, expected: str) -> None:
    if not list(found):
        raise InputInvalid(system.name, f"has no {what} that can be drawn", expected)


SETS: dict[str, Callable[..., Declared]] = {
    "published": lambda system, **options: published_intervals(**options),
    "sensor_noise": noise_of_sensors,
    "current": current_of_any_direction,
    "thruster_strength": strength_of_thrusters,
    "delays": delays_of_components,
}
