"""Mismatches: components that are made for another vehicle, or for another set, than their hull.

Each component states the vehicle and the parameter set whose figures it has (`made_for` of its
description): a declaration by its option `vehicle`, a preset of gains by its file, an FMU of this
package by a file in it, a Python class by its attribute `vehicle`. Beside a hull of another vehicle
or set, it fits if the figures that it uses are the same:

- *places* of the thrusters (wrench, allocation, propeller) within 1 mm, directions within 1e-3;
- *inertia* with added mass and *damping* of each axis (controllers) within 1 %;
- *fins*, by the places of their file;
- *thrust* of thrusters at full command, against the thrusters of the hull's folder, within 10 %.

A component or a hull that states no vehicle (an FMU of another tool, a Python class) is compared by
its parameters of the same names (`r` and `e`, `M_ff` or `M`, and those of a hull): places as above,
inertia within a factor of 2.5. Published sets of one vehicle differ by up to 2.1 (yaw of the
BlueROV2 Heavy), so that less than this factor does not show that the vehicles differ.

Values that a user sets are not compared: they are deliberate.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import dist
from pathlib import Path
from typing import Any

from uuvsim_cosim.errors import Problem, UuvsimError
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_sets,
)
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["vehicle_mismatches"]

SAME = 0.01  # of inertia and damping
FACTOR = 2.5  # of an inertia, if the component or the hull states no vehicle
SAME_THRUST = 0.1
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
# The numbers of a hull by axis: the words of a message, and the units of force and moment.
NUMBERS = {
    "M_ff": ("inertia with added mass", "kg", "kg.m2"),
    "M": ("inertia with added mass about CO", "kg", "kg.m2"),
    "D_l": ("linear damping", "N.s/m", "N.m.s/rad"),
    "D_q": ("quadratic damping", "N.s2/m2", "N.m.s2/rad2"),
}
# What a declaration uses, by its name; other declarations use the numbers of the hull.
USES = {
    **dict.fromkeys(("allocation", "allocation_qp", "allocation_quadratic", "wrench"), ("places",)),
    **dict.fromkeys(("contact", "pool"), ("M_ff",)),
    **dict.fromkeys(("thruster", "thruster_t200", "thruster_jet"), ()),
    "propeller": ("places",),
    "fins": ("fins",),
    "autopilot": ("places", "fins", *NUMBERS),
}
THRUSTERS = ("thruster", "thruster_t200", "thruster_jet", "propeller")
GAINS = frozenset({"Kp", "Kd", "K_p", "K_d", "K"})  # a user who sets one of them sets the gains

Places = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]  # (r [m], e) of each


@dataclass(frozen=True)
class _Figures:
    """Figures of a vehicle, ``id@set`` or "" if it is not stated.

    `places` of thrusters and of fins by their words, `numbers` by the names of NUMBERS, each of
    the six axes. A figure that is not used, or not known, is left out.
    """

    vehicle: str
    places: Mapping[str, Places] = field(default_factory=dict)
    numbers: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    def used(self, names: Iterable[str]) -> _Figures:
        """Return the figures of these names alone."""
        kept = set(names)
        return _Figures(
            self.vehicle,
            {k: v for k, v in self.places.items() if k in kept},
            {k: v for k, v in self.numbers.items() if k in kept},
        )


@dataclass(frozen=True)
class _Mismatch:
    """A component that does not fit: the vehicle that it is made for, and the first difference.

    `vehicle` is empty if the component states none, `of` names a part of the component.
    """

    path: str
    vehicle: str
    difference: str
    of: str = ""
    is_thruster: bool = False


def vehicle_mismatches(name: str, components: Iterable[PlannedComponent]) -> list[Problem]:
    """Return a problem for each cause: components of one system made for one other vehicle.

    A component is compared with the hulls of its own (nested) system, and has to fit one of them.
    `name` is the system's, which may name its mission.
    """
    levels: dict[str, list[PlannedComponent]] = {}
    for c in components:
        levels.setdefault(c.path.rpartition(".")[0], []).append(c)
    return [p for members in levels.values() for p in _of_level(name, members)]


def _of_level(name: str, members: list[PlannedComponent]) -> list[Problem]:
    hulls = [c for c in members if _is_hull(c)]
    if not hulls:
        return []
    vehicle = hulls[0].description.made_for.get("hull", "")
    others = [c for c in members if c not in hulls]
    causes: dict[str, list[_Mismatch]] = {}
    for c in others:
        for found in _unfit(c, hulls):
            causes.setdefault(found.vehicle, []).append(found)
    for c in others:
        thrust = [_other_thrust(c, h.description.made_for.get("hull", "")) for h in hulls]
        if all(thrust):
            own = c.description.name
            is_thruster = own in THRUSTERS
            # Thrusters of another vehicle are there for the cause that is found already.
            of = [v for v in causes if v and (_full_thrust(v) or ("",))[0] == own]
            stated = _with_set(c.description.made_for.get("figures", ""))
            cause = next(iter(of), stated if stated in causes else f"model:{own}")
            found = _Mismatch(c.path, cause, thrust[0], is_thruster=is_thruster)
            causes.setdefault(cause, []).append(found)
    return [
        Problem(_places(found), *_words(made, found, hulls[0].path, vehicle, name, members))
        for made, found in causes.items()
    ]


def _words(
    made: str,
    found: list[_Mismatch],
    path: str,
    hull: str,
    name: str,
    members: list[PlannedComponent],
) -> tuple[str, str]:
    """Return what is there for one cause, and what is expected."""
    differences = "; ".join(dict.fromkeys(f.difference for f in found))
    here = f"but {path} is {_shown(hull, made) or 'another'}: {differences}"
    if not made.startswith("model:"):
        return f"made for {_shown(made, hull) or 'other figures'}, {here}", _resolved(
            name, members, hull
        )
    own, thrust = _full_thrust(hull) or ("", 0.0)
    if not found[0].is_thruster:
        return f"{made}, {here}", f"an allocation to model:{own}, or f_max = {thrust:.3g} N"
    expected = f"model:{own}, or `model: {made.removeprefix('model:')}` in the vehicle's"
    return f"{made}, {here}", f"{expected} thrusters.yaml and a system made from it"


def _places(found: list[_Mismatch]) -> str:
    """Return the names of components; of many thrusters, the first and the last one."""
    thrusters = [f.path for f in found if f.is_thruster]
    whole = {f.path for f in found if not f.of}
    others = (f.path + (f.of if f.path not in whole else "") for f in found if not f.is_thruster)
    some = thrusters if len(thrusters) < 3 else [f"{thrusters[0]} to {thrusters[-1]}"]
    return ", ".join(dict.fromkeys([*others, *some]))


def _unfit(c: PlannedComponent, hulls: list[PlannedComponent]) -> Iterator[_Mismatch]:
    """Yield what of a component is made for another vehicle, or set, than that of each hull."""
    of_hulls = [h.description.made_for.get("hull", "") for h in hulls]
    for what, vehicle, figures in _made_for(c):
        if vehicle in of_hulls and vehicle and not _is_fmu(c):
            continue  # the same files
        made = figures()
        differences = [_difference(made, _hull_figures(h)) for h in hulls]
        if all(differences):
            yield _Mismatch(c.path, vehicle, differences[0], what)


def _with_set(vehicle: str) -> str:
    """Return ``id@set`` of a vehicle, with its default set unless one is named."""
    id, set_ = split_address(vehicle)
    try:
        return f"{id}@{set_ or vehicle_sets(id)[0]}"
    except (UuvsimError, OSError):
        return vehicle


def _is_fmu(c: PlannedComponent) -> bool:
    return c.description.kind.startswith("FMI")


def _name(vehicle: str) -> str:
    """Return the name of a vehicle and its set; of a folder's path only the folder's name."""
    return vehicle.rpartition("/")[2]


def _shown(vehicle: str, other: str = "") -> str:
    """Return a vehicle as a message names it: without its default set, unless the other has it."""
    id, set_ = split_address(vehicle)
    near = Path(id).absolute()
    if near.is_relative_to(Path.cwd()) and near.exists():  # shorter, and portable
        id = str(near.relative_to(Path.cwd()))
    try:
        default = set_ == vehicle_sets(id)[0]
    except (UuvsimError, OSError):
        default = False
    same = split_address(_name(vehicle))[0] == split_address(_name(other))[0]
    return id if set_ is None or (default and not same) else f"{id}@{set_}"


def _resolved(name: str, members: Iterable[PlannedComponent], vehicle: str) -> str:
    """Return what resolves a mismatch with the hull of a `vehicle`: the mission that is flown now.

    A survey is one by its name or by its navigation. A system without guidance flies no mission.
    """
    if not vehicle:
        return "one for that hull"
    shown = _shown(vehicle)
    modules = [LIBRARY.get(c.description.name, "") for c in members]
    if "survey" in name or any(".navigation." in m for m in modules):
        return f"`uuvsim run survey --vehicle {shown}`"
    if any(".guidance." in m for m in modules):
        return f"`uuvsim run hold --vehicle {shown}`"
    return f"one with vehicle={shown}, as in model:wrench?vehicle={shown}"


def _difference(made: _Figures, hull: _Figures) -> str:
    """Return what differs between the figures of a component and of a hull; empty if they fit."""
    stated = bool(made.vehicle and hull.vehicle)
    for key, own in made.places.items():
        wanted = hull.places.get(key)
        if wanted is None:
            continue
        what = "fin" if key == "fins" else "thruster"
        if len(own) != len(wanted):
            return f"{len(own)} {what}{'s' * (len(own) != 1)}, not {len(wanted)}"
        for i, ((r, e), (r_hull, e_hull)) in enumerate(zip(own, wanted, strict=True), 1):
            if dist(r, r_hull) > 1e-3:
                return f"{what} {i} at {_row(r)} m, not {_row(r_hull)} m"
            if dist(e, e_hull) > 1e-3:
                return f"{what} {i} pushes along {_row(e)}, not {_row(e_hull)}"
    for key, (words, force, moment) in NUMBERS.items():
        if key not in made.numbers or key not in hull.numbers:
            continue
        for i, (a, b) in enumerate(zip(made.numbers[key], hull.numbers[key], strict=True)):
            if stated:
                fits = abs(a - b) <= SAME * max(abs(a), abs(b))
            else:
                fits = key not in ("M_ff", "M") or b / FACTOR <= a <= FACTOR * b
            if not fits:
                unit = force if i < 3 else moment
                return f"{words} of {AXES[i]} {a:.3g} {unit}, not {b:.3g} {unit}"
    known = made.places or made.numbers
    if stated and not known and _name(made.vehicle) != _name(hull.vehicle):
        return "nothing here shows that its figures are the same"
    return ""


def _row(vector: Iterable[float]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"


# ---- figures of components ----------------------------------------------------------------------


def _is_hull(c: PlannedComponent) -> bool:
    if "hull" in c.description.made_for:
        return True
    names = c.description.variables
    stated = c.source.startswith("model:") or c.description.made_for
    return not stated and {"eta", "nu"} <= names.keys() and "m" in _numbers(c)


def _hull_figures(c: PlannedComponent) -> _Figures:
    vehicle = c.description.made_for.get("hull", "")
    known = _figures(vehicle) if vehicle else None
    if known is not None and not _is_fmu(c):
        return known
    numbers = _of_hull(_numbers(c))
    return _Figures(vehicle, known.places if known else {}, numbers)


def _made_for(c: PlannedComponent) -> Iterator[tuple[str, str, Callable[[], _Figures]]]:
    """Yield what is made for a vehicle: words, the vehicle, and its figures when they are asked."""
    set_by_user = c.start.keys()
    left = {
        *(() if {"r", "e"} & set_by_user else ("places",)),
        *(() if {"M", "M_ff"} & set_by_user else ("M", "M_ff")),
        *(name for name in ("D_l", "D_q") if not {name, f"{name}_ff"} & set_by_user),
        "fins",
    }
    stated = c.description.made_for
    for what, address in stated.items():
        vehicle = _with_set(address)
        if what != "figures":
            if not GAINS & set_by_user:
                yield f" ({what})", vehicle, partial(_used, vehicle, tuple(NUMBERS))
            continue
        uses = left & {*USES.get(c.description.name, NUMBERS)}
        if c.description.kind == "python":
            uses = left & {"places", "fins", *NUMBERS}
        if not uses:
            continue

        def figures(vehicle: str = vehicle, uses: Iterable[str] = uses) -> _Figures:
            known = _known(vehicle).used(uses)
            if not _is_fmu(c):
                return known
            own = _own_figures(c).used(uses)  # an FMU holds the figures of its time
            return _Figures(vehicle, own.places or known.places, own.numbers or known.numbers)

        yield "", vehicle, figures
    own = _own_figures(c).used(left)
    if not stated and not c.source.startswith("model:") and (own.places or own.numbers):
        yield "", "", lambda: own


def _own_figures(c: PlannedComponent) -> _Figures:
    """Return the figures that an FMU or a Python class has as parameters."""
    v = c.description.variables
    values = {n: _floats(v[n].start) for n in ("r", "e") if n in v}
    places: dict[str, Places] = {}
    if len(values) == 2 and v["r"].shape[1:] == (3,):
        r, e = values["r"], values["e"]
        if r and len(r) == len(e):
            rows = range(0, len(r), 3)
            places["places"] = tuple((r[i : i + 3], e[i : i + 3]) for i in rows)
    numbers = {}
    for key in NUMBERS:
        for name in (key, f"{key}_ff"):
            given = _floats(v[name].start) if name in v else ()
            if len(given) == 36:
                numbers[key] = given[::7]
            elif len(given) == 6:
                numbers["M_ff" if key == "M" else key] = given
    return _Figures("", places, numbers)


def _known(vehicle: str) -> _Figures:
    return _figures(vehicle) or _Figures(vehicle)


def _used(vehicle: str, names: Iterable[str]) -> _Figures:
    return _known(vehicle).used(names)


@kept_until_changed
def _figures(vehicle: str) -> _Figures | None:
    """Return the figures of a vehicle's files; None if they cannot be read."""
    from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry

    id, set_ = split_address(vehicle)
    try:
        folder = vehicle_folder(id)
        places: dict[str, Places] = {"places": (), "fins": ()}
        if (folder / "thrusters.yaml").is_file():
            g = thruster_geometry(str(folder))
            rows = zip(g.r.tolist(), g.e.tolist(), strict=True)
            places["places"] = tuple((tuple(r), tuple(e)) for r, e in rows)
        if (folder / "fins.yaml").is_file():
            file = read_yaml(folder / "fins.yaml", "fins.schema.json")
            at = [tuple(float(x) for x in fin["r"]["value"]) for fin in file["fins"]]
            places["fins"] = tuple((r, ()) for r in at)
        listed = parameter_set(id, set_).quantities
        return _Figures(vehicle, places, _of_hull({k: q.value for k, q in listed.items()}))
    except (UuvsimError, KeyError, OSError):
        return None


def _of_hull(p: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
    """Return the diagonals of M, D_l and D_q; `M_ff` leaves out products with the CG's place."""
    if "m" not in p:
        return {}
    at = [p.get(f"{a}_g", 0.0) for a in "xyz"]
    square = sum(x * x for x in at)
    about = [p.get(f"I_b_{i}{i}", p.get(f"I_g_{i}{i}", 0.0)) for i in (1, 2, 3)]
    moved = [p["m"] * (square - x * x) for x in at]
    about_CO = [a + (b if f"I_g_{i}{i}" in p else 0.0) for i, (a, b) in
                enumerate(zip(about, moved, strict=True), 1)]  # fmt: skip
    added = [p.get(f"M_A_{i}{i}", 0.0) for i in range(1, 7)]
    return {
        "M_ff": tuple(a + b for a, b in zip([*[p["m"]] * 3, *about], added, strict=True)),
        "M": tuple(a + b for a, b in zip([*[p["m"]] * 3, *about_CO], added, strict=True)),
        "D_l": tuple(p.get(f"D_l_{i}{i}", 0.0) for i in range(1, 7)),
        "D_q": tuple(p.get(f"D_q_{i}{i}", 0.0) for i in range(1, 7)),
    }


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


# ---- thrust of thrusters ------------------------------------------------------------------------


def _other_thrust(c: PlannedComponent, vehicle: str) -> str:
    """Return how a thrust at full command differs from that of the hull's own; empty: it fits.

    The component is a thruster of this package, or the limits of an allocation. A vehicle whose
    thrusters.yaml names no model accepts any.
    """
    own, stated = c.description.name, c.description.made_for.get("figures", "")
    allocates = own.startswith("allocation")
    of_package = c.description.generation_tool.startswith("uuvsim-cosim")
    deliberate = c.start.keys() - {"u", "voltage", "f_max"}
    if not (vehicle and of_package and (allocates or own in THRUSTERS)) or deliberate:
        return ""
    wanted = _full_thrust(vehicle)
    if wanted is None or {"allocation": "thruster_t200"}.get(own, own) == wanted[0] != "propeller":
        return ""
    if allocates:
        f_max = c.start.get("f_max", c.description.variables["f_max"].start)
        has: float | None = _floats(f_max)[0]
    elif stated:
        has = (_full_thrust(stated) or (own, None))[1]
    else:
        has = _thrust_of(own)
    if has is None or abs(has - wanted[1]) <= SAME_THRUST * wanted[1]:
        return ""
    return f"{has:.3g} N at full command, not {wanted[1]:.3g} N (model:{wanted[0]})"


@kept_until_changed
def _full_thrust(vehicle: str) -> tuple[str, float] | None:
    """Return the model of a vehicle's thrusters and its thrust [N]; None if no file names one."""
    from uuvsim_cosim.models.actuators.thruster_geometry import thrusters_file
    from uuvsim_cosim.models.control.vehicle_design import full_command

    id, set_ = split_address(vehicle)
    try:
        file = thrusters_file(vehicle_folder(id) / "thrusters.yaml")
        if "model" not in file and parameter_set(id, set_).name not in file.get("sets", {}):
            return None
        return full_command(vehicle, file)[:2]
    except (UuvsimError, KeyError, OSError):
        return None


@kept_until_changed
def _thrust_of(model: str) -> float:
    """Return the thrust of a thruster's declaration at full command [N]."""
    from uuvsim_cosim.models.control.vehicle_design import full_command

    return full_command("", {"model": model})[1]
