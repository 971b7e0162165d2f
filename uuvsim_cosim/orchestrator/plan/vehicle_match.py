"""Warnings about components that were designed for another vehicle than their hull.

A declaration with the option `vehicle` (thruster places, allocation, gains, models inside
controllers) is made for that vehicle, by default for the option's default. Components of other
kinds, FMUs and Python classes do not say for which vehicle they are made, and are not compared.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from importlib import import_module
from inspect import signature
from urllib.parse import parse_qsl, unquote

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.library import ALIASES, LIBRARY
from uuvsim_cosim.models.declaration.parameters import is_vehicle, split_address, vehicle_file
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["vehicle_warnings"]

# Components whose preset holds forces, which fit the preset's vehicle whatever `vehicle` is.
GAINS = frozenset({"backstepping", "controller", "sliding_mode"})


def vehicle_warnings(components: Iterable[PlannedComponent]) -> list[str]:
    """Return a sentence for each component that is made for another vehicle than its hull.

    A component's hulls are those beside it, in the same system; one that fits any of them fits.
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
        for c in members:
            for what, vehicle in _made_for(c.source) if c.path not in hulls else ():
                if vehicle not in hulls.values():
                    found.append(
                        f"{c.path}: {what} {vehicle}, but {shown}; expected a component for that "
                        f"vehicle, such as {_other(c.source, next(iter(hulls.values())))}"
                    )
    return found


def _parts(source: str) -> tuple[str, dict[str, str]]:
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
    """Return what of a source is made for which vehicle; nothing if it does not say so."""
    if not source.startswith("model:"):
        return ()
    name, options = _parts(source)
    if name not in LIBRARY or name == "vehicle":
        return ()
    module, function = LIBRARY[name].split(":")
    taken = signature(getattr(import_module(module), function)).parameters
    if "vehicle" not in taken:
        return ()
    usual = str(taken["vehicle"].default)
    vehicle = options.get("vehicle", usual)
    found = []
    if vehicle and (id := _id(vehicle)) is not None:
        found.append(("is made for", id))
    preset = str(taken["id"].default) if "id" in taken else ""
    if name in GAINS and options.get("id", preset) == preset and vehicle != usual:
        found.append((f"its gains ({preset}) are those of", usual))
    return tuple(found)


def _id(address: str) -> str | None:
    """Return the id in a vehicle's file; None if there is none that can be read."""
    try:
        return str(vehicle_file(split_address(address)[0])[1]["id"])
    except (UuvsimError, KeyError, OSError):
        return None


def _other(source: str, vehicle: str) -> str:
    name, options = _parts(source)
    return f"model:{name}?vehicle={vehicle}" if "vehicle" not in options else f"one of {vehicle}"
