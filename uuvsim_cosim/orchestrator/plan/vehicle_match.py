"""Warnings about components that were designed for another vehicle than their hull.

A declaration with the option `vehicle` (thruster places, allocation, gains, models inside
controllers) is designed for that vehicle, by default for the option's default. Other declarations,
FMUs and Python classes do not name a vehicle and are not compared.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from importlib import import_module
from inspect import signature
from urllib.parse import parse_qsl, unquote

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.library import ALIASES, LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import is_vehicle, split_address, vehicle_file
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["vehicle_warnings"]

# Components whose preset holds forces, which fit only the preset's vehicle, whatever `vehicle` is.
GAINS = frozenset({"backstepping", "controller", "sliding_mode"})


def vehicle_warnings(components: Iterable[PlannedComponent]) -> list[str]:
    """Return a warning for each component that is designed for another vehicle than its hull.

    A component is compared with the hulls of its own (nested) system, and has to fit one of them.
    """
    levels: dict[str, list[PlannedComponent]] = {}
    for c in components:
        levels.setdefault(c.path.rpartition(".")[0], []).append(c)
    found: list[str] = []
    for members in levels.values():
        hulls = {c.path: id for c in members if (id := _hull(c.source)) is not None}
        if not hulls:
            continue
        shown = ", ".join(f"{path} is {id}" for path, id in hulls.items())
        first = next(iter(hulls.values()))
        for c in members:
            for what, vehicle in _made_for(c.source) if c.path not in hulls else ():
                if vehicle not in hulls.values():
                    name, options = _parts(c.source)
                    named = "vehicle" in options
                    other = f"one of {first}" if named else f"model:{name}?vehicle={first}"
                    found.append(
                        f"{c.path}: {what} {vehicle}, but {shown}; expected a component for that "
                        f"vehicle, such as {other}"
                    )
    return found


def _parts(source: str) -> tuple[str, dict[str, str]]:
    """Return the name of a declaration and its options, of ``model:name?option=value``."""
    name, _, query = source.removeprefix("model:").partition("?")
    name, published = split_address(unquote(name))
    options = dict(parse_qsl(query, keep_blank_values=True))
    return ALIASES.get(name, name), ({"id": published} if published else {}) | options


@lru_cache(maxsize=1024)
def _hull(source: str) -> str | None:
    """Return the id of the vehicle whose hull a source is; None for anything else."""
    if not source.startswith("model:"):
        return None
    name, options = _parts(source)
    if name == "vehicle":
        return _id(options.get("id", ""))
    return _id(name) if name not in LIBRARY and is_vehicle(name) else None


@lru_cache(maxsize=1024)
def _made_for(source: str) -> tuple[tuple[str, str], ...]:
    """Return the vehicles that a source is designed for, each with the text of a message."""
    if not source.startswith("model:"):
        return ()
    name, options = _parts(source)
    if name not in LIBRARY or name == "vehicle":
        return ()
    module, function = LIBRARY[name].split(":")
    accepted = signature(getattr(import_module(module), function)).parameters
    if "vehicle" not in accepted:
        return ()
    default = str(accepted["vehicle"].default)
    vehicle = options.get("vehicle", default)
    found = []
    if vehicle and (id := _id(vehicle)) is not None:
        found.append(("is made for", id))
    preset = str(accepted["id"].default) if "id" in accepted else ""
    if name in GAINS and options.get("id", preset) == preset and vehicle != default:
        found.append((f"its gains ({preset}) are those of", default))
    return tuple(found)


def _id(address: str) -> str | None:
    """Return the id in a vehicle's file; None if there is no such file that can be read."""
    try:
        return str(vehicle_file(split_address(address)[0])[1]["id"])
    except (UuvsimError, KeyError, OSError):
        return None
