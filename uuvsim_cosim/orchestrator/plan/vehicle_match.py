"""Mismatches: components that are made for another vehicle than their hull.

A declaration with the option `vehicle` (wrench, allocation, gains, models inside controllers) is
made for that vehicle. It fits a hull of another vehicle if the figures that it uses agree:

- *places* of the thrusters (wrench, allocation, propeller) within 1 mm, directions within 1e-3;
- *inertia* with added mass (controllers), in each axis, within a factor of 2.5. Published sets of
  one vehicle differ by up to 2.1 (yaw of the BlueROV2 Heavy), and its gains fly both;
- *fins*, by the places of their file.

FMUs and Python components are compared by their parameters of the same names (`r` and `e`, `M_ff`
or `M`, and those of a hull). Values that a user sets are not compared: they are deliberate.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from math import dist
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, unquote

from uuvsim_cosim.errors import Problem, UuvsimError
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.library import ALIASES, LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import (
    is_vehicle,
    parameter_set,
    read_yaml,
    split_address,
    vehicle_file,
    vehicle_folder,
)
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["hull_address", "vehicle_mismatches"]

# Components whose preset holds forces, which fit only the preset's vehicle, whatever `vehicle` is.
GAINS = frozenset({"backstepping", "controller", "sliding_mode"})
PLACES = frozenset({"allocation", "allocation_qp", "allocation_quadratic", "wrench", "propeller"})
FACTOR = 2.5  # of an inertia
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")

Places = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]  # (r, e) of each


@dataclass(frozen=True)
class _Figures:
    """Figures of a vehicle that a component was made for; None: the component does not use them.

    `places` is (r [m], e) of each thruster, `inertia` the diagonal of M [kg, kg.m2], `fins` the
    places of the fins [m].
    """

    address: str
    places: Places | None = None
    inertia: tuple[float, ...] | None = None
    fins: Places | None = None


def vehicle_mismatches(name: str, components: Iterable[PlannedComponent]) -> list[Problem]:
    """Return a problem for each component that is made for another vehicle than its hull.

    A component is compared with the hulls of its own (nested) system, and has to fit one of them.
    `name` is the system's, which may name its mission.
    """
    levels: dict[str, list[PlannedComponent]] = {}
    for c in components:
        levels.setdefault(c.path.rpartition(".")[0], []).append(c)
    found: list[Problem] = []
    for members in levels.values():
        hulls = {c.path: hull for c in members if (hull := _hull(c)) is not None}
        if not hulls:
            continue
        path, first = next(iter(hulls.items()))
        for c in members:
            for what, made in _made_for(c) if c.path not in hulls else ():
                differences = [_difference(made, hull) for hull in hulls.values()]
                if all(differences):
                    here = f"{path} is {first.address}" if first.address else f"{path} is another"
                    expected = _resolved(name, members, first.address)
                    found.append(
                        Problem(c.path, f"{what}{made.address}, but {here}: {differences[0]}",
                                expected)
                    )  # fmt: skip
    return found


def _resolved(name: str, members: Iterable[PlannedComponent], address: str) -> str:
    """Return what resolves a mismatch with the hull of `address`: the mission that is flown now.

    A survey is one by its name or by its navigation. A system without guidance flies no mission.
    """
    if not address:
        return "one for that hull"
    modules = [LIBRARY.get(_parts(c.source)[0], "") for c in members if ":" in c.source]
    if "survey" in name or any(".navigation." in m for m in modules):
        return f"`uuvsim run survey --vehicle {address}`"
    if any(".guidance." in m for m in modules):
        return f"`uuvsim run hold --vehicle {address}`"
    return f"one with vehicle={address}, as in model:wrench?vehicle={address}"


def _difference(made: _Figures, hull: _Figures) -> str:
    """Return what differs between the figures of a component and of a hull; empty if they fit."""
    for what, a, b in (("thruster", made.places, hull.places), ("fin", made.fins, hull.fins)):
        if a is None or b is None:
            continue
        if len(a) != len(b):
            return f"{len(a)} {what}{'s' * (len(a) != 1)}, not {len(b)}"
        for i, ((r, e), (r_hull, e_hull)) in enumerate(zip(a, b, strict=True), 1):
            if dist(r, r_hull) > 1e-3:
                return f"{what} {i} at {_row(r)} m, not {_row(r_hull)} m"
            if dist(e, e_hull) > 1e-3:
                return f"{what} {i} pushes along {_row(e)}, not {_row(e_hull)}"
    if made.inertia is None or hull.inertia is None:
        return ""
    for axis, own, wanted in zip(AXES, made.inertia, hull.inertia, strict=True):
        if not wanted / FACTOR <= own <= FACTOR * wanted:
            unit = "kg" if axis in AXES[:3] else "kg.m2"
            return f"inertia with added mass of {axis} {own:.3g} {unit}, not {wanted:.3g} {unit}"
    return ""


def _row(vector: Iterable[float]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"


def _parts(source: str) -> tuple[str, dict[str, str]]:
    """Return the name of a declaration and its options, of ``model:name?option=value``."""
    name, _, query = source.removeprefix("model:").partition("?")
    name, published = split_address(unquote(name))
    options = dict(parse_qsl(query, keep_blank_values=True))
    return ALIASES.get(name, name), ({"id": published} if published else {}) | options


def _hull(c: PlannedComponent) -> _Figures | None:
    """Return the figures of a hull; None for any other component."""
    if c.source.startswith("model:"):
        return _declared_hull(c.source)
    numbers = _numbers(c)
    if not {"eta", "nu"} <= c.description.variables.keys() or "m" not in numbers:
        return None
    return _Figures("", inertia=_diagonal(numbers))


@kept_until_changed
def _declared_hull(source: str) -> _Figures | None:
    address = hull_address(source)
    return None if address is None else _figures(address)


def hull_address(source: str) -> str | None:
    """Return the vehicle, as id, id@set or folder, of a hull's source; None for another model."""
    name, options = _parts(source)
    if name == "vehicle":
        name, options = options.get("id", ""), {"id": options.get("set", "")}
    elif name in LIBRARY or not is_vehicle(name):
        return None
    set_ = options.get("set", options.get("id", ""))
    return f"{name}@{set_}" if set_ else name


def _made_for(c: PlannedComponent) -> list[tuple[str, _Figures]]:
    """Return the figures that a component was made for, each with the start of a message."""
    if c.source.startswith("model:"):
        found = list(_declared_for(c.source))
        given = {"Kp", "Kd"} & c.start.keys()
        return [(w, f) for w, f in found if not (given and w.startswith("its gains"))]
    values = {n: v.start for n, v in c.description.variables.items()}
    places = inertia = None
    if "r" in values and "e" in values and c.description.variables["r"].shape[1:] == (3,):
        r, e = (_floats(values[n]) for n in "re")
        if r and len(r) == len(e):
            places = tuple((r[i : i + 3], e[i : i + 3]) for i in range(0, len(r), 3))
    if len(_floats(values.get("M_ff"))) == 6:
        inertia = _floats(values["M_ff"])
    elif len(M := _floats(values.get("M"))) == 36:
        inertia = M[::7]
    if places is None and inertia is None:
        return []
    return [("made for other figures", _Figures("", places, inertia))]


@kept_until_changed
def _declared_for(source: str) -> tuple[tuple[str, _Figures], ...]:
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
    if vehicle and (figures := _figures(vehicle)) is not None:
        used = _Figures(
            figures.address,
            places=figures.places if name in PLACES or name == "autopilot" else None,
            inertia=None if name in PLACES or name == "fins" else figures.inertia,
            fins=figures.fins if name in ("fins", "autopilot") else None,
        )
        found.append(("made for ", used))
    preset = str(accepted["id"].default) if "id" in accepted else ""
    of_preset = _figures(default) if name in GAINS and options.get("id", preset) == preset else None
    if of_preset is not None:
        gains = _Figures(of_preset.address, inertia=of_preset.inertia)
        found.append((f"its gains ({preset}) are made for ", gains))
    return tuple(found)


def _figures(address: str) -> _Figures | None:
    """Return the figures of a vehicle's files; None if they cannot be read."""
    from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry

    id, set_ = split_address(address)
    try:
        folder = vehicle_folder(id)
        numbers = {k: q.value for k, q in parameter_set(id, set_).quantities.items()}
        places: Places = ()
        if (folder / "thrusters.yaml").is_file():
            g = thruster_geometry(str(folder))
            places = tuple(
                (tuple(r), tuple(e)) for r, e in zip(g.r.tolist(), g.e.tolist(), strict=True)
            )
        fins: Places = ()
        if (folder / "fins.yaml").is_file():
            file = read_yaml(folder / "fins.yaml", "fins.schema.json")
            at = [tuple(float(x) for x in fin["r"]["value"]) for fin in file["fins"]]
            fins = tuple((r, ()) for r in at)
        vehicle_file(id)
        near = Path(id).absolute()
        if near.is_relative_to(Path.cwd()) and near.exists():  # shorter, and portable
            address = f"{near.relative_to(Path.cwd())}{f'@{set_}' if set_ else ''}"
        return _Figures(address, places, _diagonal(numbers), fins)
    except (UuvsimError, KeyError, OSError):
        return None


def _diagonal(numbers: Mapping[str, float]) -> tuple[float, ...]:
    """Return the diagonal of M_RB + M_A about CO; products with the CG's place are left out."""
    rigid = [numbers["m"]] * 3
    rigid += [numbers.get(f"I_b_{i}{i}", numbers.get(f"I_g_{i}{i}", 0.0)) for i in (1, 2, 3)]
    return tuple(x + numbers.get(f"M_A_{i}{i}", 0.0) for i, x in enumerate(rigid, 1))


def _numbers(c: PlannedComponent) -> dict[str, float]:
    parameters = c.description.of("parameter")
    return {v.name: x[0] for v in parameters if len(x := _floats(v.start)) == 1}


def _floats(value: Any) -> tuple[float, ...]:
    """Return the numbers of a start value, flat; none if it is no array of numbers."""
    from numpy import asarray

    try:
        return tuple(asarray(value, dtype=float).ravel().tolist()) if value is not None else ()
    except (TypeError, ValueError):
        return ()
