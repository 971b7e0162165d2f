"""Figures of components and of vehicles that a check of the plan compares.

A component of this package states the vehicle whose figures it has (`made_for` of its description);
the figures are then those of the vehicle's files. An FMU holds the figures of the time when it was
built, and a Python class or an FMU of another tool has parameters of the same names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.files_read import kept_until_changed
from uuvsim_cosim.models.declaration.parameter_files import (
    parameter_set,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_sets,
)
from uuvsim_cosim.orchestrator.plan.plan import PlannedComponent

__all__ = [
    "MATRICES",
    "NUMBERS",
    "POINTS",
    "Figures",
    "Numbers",
    "Places",
    "figures_of_component",
    "floats",
    "hull_figures",
    "is_fmu",
    "is_hull",
    "scalars",
    "with_set",
]

# The symmetric matrices of a hull, 36 numbers or the 6 of the diagonal: the words of a message, and
# the units of the elements that couple forces, forces with moments, and moments.
MATRICES = {
    "M_ff": ("inertia with added mass", "kg", "kg.m", "kg.m2"),
    "M": ("inertia with added mass about CO", "kg", "kg.m", "kg.m2"),
    "D_l": ("linear damping", "N.s/m", "N.s", "N.m.s/rad"),
    "D_q": ("quadratic damping", "N.s2/m2", "N.s2/m", "N.m.s2/rad2"),
}
POINTS = {"r_g": "centre of gravity", "r_b": "centre of buoyancy"}  # in b, from CO [m]
NUMBERS = ("M_ff", "r_g", "r_b", "M", "D_l", "D_q")  # in the order of comparison
# What a declaration uses, by its name; other declarations use the numbers of the hull.
USES = {
    **dict.fromkeys(("allocation", "allocation_qp", "allocation_quadratic", "wrench"), ("places",)),
    **dict.fromkeys(("contact", "pool"), ("M_ff",)),
    **dict.fromkeys(("thruster", "thruster_t200", "thruster_jet"), ()),
    "propeller": ("places",),
    "fins": ("fins",),
    "autopilot": ("places", "fins", *NUMBERS),
}
GAINS = frozenset({"Kp", "Kd", "K_p", "K_d", "K"})  # a user who sets one of them sets the gains

Numbers = tuple[float, ...]
Places = tuple[tuple[tuple[float, ...], tuple[float, ...]], ...]  # (r [m], e) of each


@dataclass(frozen=True)
class Figures:
    """Figures of a vehicle, ``id@set`` or "" if it is not stated.

    `places` are those of thrusters and of fins by their words, and `numbers` those of `MATRICES`
    and `POINTS`. A figure that is not used, or not known, is left out.
    """

    vehicle: str
    places: Mapping[str, Places] = field(default_factory=dict)
    numbers: Mapping[str, Numbers] = field(default_factory=dict)

    def used(self, names: Iterable[str]) -> Figures:
        """Return the figures of these names alone."""
        kept = set(names)
        return Figures(
            self.vehicle,
            {k: v for k, v in self.places.items() if k in kept},
            {k: v for k, v in self.numbers.items() if k in kept},
        )


def with_set(vehicle: str) -> str:
    """Return ``id@set`` of a vehicle, with its default set unless one is named."""
    id, set_ = split_address(vehicle)
    try:
        return f"{id}@{set_ or vehicle_sets(id)[0]}"
    except (UuvsimError, OSError):
        return vehicle


def is_fmu(c: PlannedComponent) -> bool:
    """Return whether a component is an FMU, of whatever tool."""
    return c.description.kind.startswith("FMI")


def is_hull(c: PlannedComponent) -> bool:
    """Return whether a component is a hull: it states so, or it has a hull's variables."""
    if "hull" in c.description.made_for:
        return True
    names = c.description.variables
    stated = c.source.startswith("model:") or c.description.made_for
    return not stated and {"eta", "nu"} <= names.keys() and "m" in scalars(c)


def hull_figures(c: PlannedComponent) -> Figures:
    """Return the figures of a hull, of its vehicle's files or of its parameters."""
    vehicle = c.description.made_for.get("hull", "")
    known = _figures(vehicle) if vehicle else None
    if known is not None and not is_fmu(c):
        return known
    numbers = _matrices_and_points(scalars(c))
    return Figures(vehicle, known.places if known else {}, numbers)


def figures_of_component(c: PlannedComponent) -> Iterator[tuple[str, str, Callable[[], Figures]]]:
    """Yield what of a component is made for a vehicle: words, the vehicle, and a call for figures.

    Figures that the user has set are left out.
    """
    set_by_user = c.start.keys()
    left = {
        *(() if {"r", "e"} & set_by_user else ("places",)),
        *(() if {"M", "M_ff"} & set_by_user else ("M", "M_ff")),
        *(name for name in POINTS if name not in set_by_user),
        *(name for name in ("D_l", "D_q") if not {name, f"{name}_ff"} & set_by_user),
        "fins",
    }
    stated = c.description.made_for
    for what, address in stated.items():
        vehicle = with_set(address)
        if what != "figures":
            if not GAINS & set_by_user:
                yield f" ({what})", vehicle, partial(_used, vehicle, NUMBERS)
            continue
        uses = left & {*USES.get(c.description.name, NUMBERS)}
        if c.description.kind == "python":
            uses = left & {"places", "fins", *NUMBERS}
        if not uses:
            continue

        def figures(vehicle: str = vehicle, uses: Iterable[str] = uses) -> Figures:
            known = _known(vehicle).used(uses)
            if not is_fmu(c):
                return known
            own = _own_figures(c).used(uses)  # an FMU holds the figures of its time
            return Figures(vehicle, own.places or known.places, own.numbers or known.numbers)

        yield "", vehicle, figures
    own = _own_figures(c).used(left)
    if not stated and not c.source.startswith("model:") and (own.places or own.numbers):
        yield "", "", lambda: own


def _own_figures(c: PlannedComponent) -> Figures:
    """Return the figures that an FMU or a Python class has as parameters."""
    v = c.description.variables
    values = {n: floats(v[n].start) for n in ("r", "e") if n in v}
    places: dict[str, Places] = {}
    if len(values) == 2 and v["r"].shape[1:] == (3,):
        r, e = values["r"], values["e"]
        if r and len(r) == len(e):
            rows = range(0, len(r), 3)
            places["places"] = tuple((r[i : i + 3], e[i : i + 3]) for i in rows)
    numbers = {}
    for key in MATRICES:
        for name in (key, f"{key}_ff"):
            given = floats(v[name].start) if name in v else ()
            if len(given) in (6, 36):
                numbers["M_ff" if key == "M" and len(given) == 6 else key] = given
    return Figures("", places, numbers)


def _known(vehicle: str) -> Figures:
    return _figures(vehicle) or Figures(vehicle)


def _used(vehicle: str, names: Iterable[str]) -> Figures:
    return _known(vehicle).used(names)


@kept_until_changed
def _figures(vehicle: str) -> Figures | None:
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
        return Figures(
            vehicle, places, _matrices_and_points({k: q.value for k, q in listed.items()})
        )
    except (UuvsimError, KeyError, OSError):
        return None


def _matrices_and_points(p: Mapping[str, float]) -> dict[str, tuple[float, ...]]:
    """Return the matrices and points of a hull; `M_ff` is M with the CG at CO."""
    if "m" not in p:
        return {}
    import casadi as ca
    import numpy as np

    from uuvsim_cosim.models.declaration.inertia import (
        elements,
        parameter_vector,
        rigid_mass,
        symmetric,
    )

    added = symmetric(p, "M_A")
    at_CO = {k: v for k, v in p.items() if not k.endswith("_g")}
    found = {
        "M_ff": rigid_mass(at_CO) + added,
        "M": rigid_mass(p) + added,
        "D_l": elements(p, "D_l", 6),
        "D_q": elements(p, "D_q", 6),
        "r_g": parameter_vector(p, "g"),
        "r_b": parameter_vector(p, "b"),
    }
    return {k: tuple(np.array(ca.evalf(v)).ravel().tolist()) for k, v in found.items()}


def scalars(c: PlannedComponent) -> dict[str, float]:
    """Return the scalar parameters of a component, as its description states them."""
    parameters = c.description.of("parameter")
    return {v.name: x[0] for v in parameters if len(x := floats(v.start)) == 1}


def floats(value: Any) -> tuple[float, ...]:
    """Return the numbers of a start value, flat; none if it is no array of numbers."""
    from numpy import asarray

    try:
        return tuple(asarray(value, dtype=float).ravel().tolist()) if value is not None else ()
    except (TypeError, ValueError):
        return ()
