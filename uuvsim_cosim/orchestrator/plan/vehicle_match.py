"""Mismatches: components that are made for another vehicle, or for another set, than their hull.

Each component states the vehicle and the parameter set whose figures it has (`made_for` of its
description): a declaration by its option `vehicle`, a preset of gains by its file, an FMU of this
package by a file in it, a Python class by its attribute `vehicle`. Beside a hull of another vehicle
or set, it fits if the figures that it uses are the same:

- *places* of the thrusters (wrench, allocation, propeller) within 1 mm, directions within 1e-3;
- *inertia* with added mass and *damping* of each axis (controllers) within 1 %, *products of
  inertia* within 1 % of the axes' mean, *centres of gravity and of buoyancy* within 1 mm;
- *fins*, by the places of their file;
- *thrust* of thrusters at full command, against the thrusters of the hull's folder, within 10 %.

A component or a hull that states no vehicle (an FMU of another tool, a Python class) is compared by
its parameters of the same names (`r` and `e`, `M_ff` or `M`, and those of a hull): places as above,
inertia within a factor of 2.5. Published sets of one vehicle differ by up to 2.1 (yaw of the
BlueROV2 Heavy), so that less than this factor does not show that the vehicles differ.

Values that a user sets are not compared: they are deliberate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import combinations
from math import dist, sqrt
from pathlib import Path

from uuvsim_cosim.errors import Problem, UuvsimError
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.library import LIBRARY
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    split_address,
    vehicle_folder,
    vehicle_sets,
)
from uuvsim_cosim.orchestrator.plan.compared_figures import (
    MATRICES,
    NUMBERS,
    POINTS,
    Figures,
    Numbers,
    figures_of_component,
    floats,
    hull_figures,
    is_fmu,
    is_hull,
    with_set,
)
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = ["or_forced", "vehicle_mismatches"]

SAME = 0.01  # of inertia and damping
FACTOR = 2.5  # of an inertia, if the component or the hull states no vehicle
SAME_THRUST = 0.1
NEAR = 1e-3  # m of a place, and 1 of a direction
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
THRUSTERS = ("thruster", "thruster_t200", "thruster_jet", "propeller")


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


def or_forced(problems: Iterable[Problem]) -> list[Problem]:
    """Return the problems with the option that turns their refusal into a warning."""
    allowed = ", or --force (in Python: with_mismatches('warn'))"
    return [replace(p, expected=f"{p.expected}{allowed}") for p in problems]


def _of_level(name: str, members: list[PlannedComponent]) -> list[Problem]:
    hulls = [c for c in members if is_hull(c)]
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
            stated = with_set(c.description.made_for.get("figures", ""))
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
    for what, vehicle, figures in figures_of_component(c):
        if vehicle in of_hulls and vehicle and not is_fmu(c):
            continue  # the same files
        made = figures()
        differences = [_difference(made, hull_figures(h)) for h in hulls]
        if all(differences):
            yield _Mismatch(c.path, vehicle, differences[0], what)


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


def _difference(made: Figures, hull: Figures) -> str:
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
            if dist(r, r_hull) > NEAR:
                return f"{what} {i} at {_row(r)} m, not {_row(r_hull)} m"
            if dist(e, e_hull) > NEAR:
                return f"{what} {i} pushes along {_row(e)}, not {_row(e_hull)}"
    for key in NUMBERS:
        if key not in made.numbers or key not in hull.numbers:
            continue
        a, b = made.numbers[key], hull.numbers[key]
        if key in MATRICES:
            if found := _other_matrix(key, a, b, stated):
                return found
        elif stated and dist(a, b) > NEAR:
            return f"{POINTS[key]} at {_row(a)} m, not {_row(b)} m"
    known = made.places or made.numbers
    if stated and not known and _name(made.vehicle) != _name(hull.vehicle):
        return "nothing here shows that its figures are the same"
    return ""


def _other_matrix(key: str, own: Numbers, wanted: Numbers, stated: bool) -> str:
    """Return how a matrix differs from that of the hull; empty if it does not.

    The diagonal is compared first. Other elements are compared, of inertias, if both components
    state a vehicle: within `SAME` of the mean of the two diagonal elements.
    """
    words, *units = MATRICES[key]
    inertia = key in ("M_ff", "M")

    def differs(i: int, j: int, a: float, b: float, scale: float) -> str:
        if stated or i != j:
            fits = abs(a - b) <= SAME * scale
        else:
            fits = not inertia or b / FACTOR <= a <= FACTOR * b
        unit = units[(i > 2) + (j > 2)]
        axes = AXES[i] if i == j else f"{AXES[i]} with {AXES[j]}"
        return "" if fits else f"{words} of {axes} {a:.3g} {unit}, not {b:.3g} {unit}"

    one, other = _diagonal(own), _diagonal(wanted)
    for i, (a, b) in enumerate(zip(one, other, strict=True)):
        if found := differs(i, i, a, b, max(abs(a), abs(b))):
            return found
    if not (inertia and stated and len(own) == len(wanted) == 36):
        return ""
    for i, j in combinations(range(6), 2):
        a, b = own[6 * i + j], wanted[6 * i + j]
        if found := differs(i, j, a, b, sqrt(abs(other[i] * other[j]))):
            return found
    return ""


def _diagonal(matrix: Numbers) -> Numbers:
    return matrix[::7] if len(matrix) == 36 else matrix


def _row(vector: Iterable[float]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in vector) + ")"


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
        has: float | None = floats(f_max)[0]
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
