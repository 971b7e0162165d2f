"""Hydrodynamics in a robot description (plugins of uuv_simulator and gz-sim), converted to FRD.

uuv_simulator writes 6x6 matrices in FRD, added mass positive, damping negative; volume and centre
of buoyancy are geometry, in FLU. gz-sim writes SNAME's derivatives (negative) in the link's own
axes, FLU: an element that turns one of x, p into one of y, z, q, r changes its sign.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.description_bodies import Reader, child
from uuvsim_cosim.models.importing.xacro import local, place_of

if TYPE_CHECKING:
    from lxml.etree import _Element

__all__ = ["FLU_TO_FRD", "TURN", "Water", "water_of"]

Array = NDArray[np.float64]
FLU_TO_FRD = np.diag([1.0, -1.0, -1.0])
TURN = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
_SNAME = re.compile(r"([xyzkmn])(?:(Dot)([UVWPQR])|([UVWPQR])(?:abs([UVWPQR])|([UVWPQR]))?)$")


@dataclass
class Water:
    """Matrices (6, 6) in FRD, M_A and damping positive; None where the file has none of a kind."""

    source: str
    matrices: dict[str, Array] = field(default_factory=dict)  # M_A, D_l, D_q, D_u
    rho: float | None = None
    volume: float | None = None
    r_b: Array | None = None  # FRD
    size: Array | None = None  # length, breadth, height
    neutral: bool = False
    notes: list[str] = field(default_factory=list)


def water_of(read: Reader, root: _Element) -> Water | None:
    """Read the first hydrodynamic model that is there, None if there is none."""
    for element in root.iter():
        if local(element) == "hydrodynamic_model":
            return _uuv_simulator(read, element, root)
    for element in root.iter():
        words = f"{element.get('filename', '')} {element.get('name', '')}".lower()
        if local(element) == "plugin" and "hydrodynamics" in words:
            return _gz_sim(read, element)
    return None


def _uuv_simulator(read: Reader, model: _Element, root: _Element) -> Water:
    water = Water("uuv_simulator's hydrodynamic model")
    type_ = child(model, "type")
    if type_ is not None and (type_.text or "").strip() != "fossen":
        raise InputInvalid(
            place_of(read.path, type_),
            f"<type>: {(type_.text or '').strip()!r}",
            "fossen, whose matrices are in the file",
        )
    for tag, name, sign in (
        ("added_mass", "M_A", 1.0),
        ("linear_damping", "D_l", -1.0),
        ("quadratic_damping", "D_q", -1.0),
        ("linear_damping_forward_speed", "D_u", -1.0),
    ):
        element = child(model, tag)
        if element is None:
            continue
        matrix = np.eye(6)
        with read.gathered():
            values = read.numbers(element, element.text, *((36,) if name == "M_A" else (6, 36)))
            matrix = sign * (np.diag(values) if len(values) == 6 else values.reshape(6, 6))
        driving = [i + 1 for i in range(6) if matrix[i, i] < 0]
        if driving:
            water.notes.append(
                f"{place_of(read.path, element)}: <{tag}>: the diagonal elements {driving} "
                "have the sign that drives the vehicle; they are kept as they are"
            )
        water.matrices[name] = matrix
    link = model.getparent()
    assert link is not None  # <hydrodynamic_model> stands in a <link>
    volume, centre, box, neutral = (
        child(link, n) for n in ("volume", "center_of_buoyancy", "box", "neutrally_buoyant")
    )
    if volume is not None:
        with read.gathered():
            water.volume = read.number(volume)
            if not water.volume > 0:
                raise InputInvalid(
                    place_of(read.path, volume), f"<volume>: {water.volume:g} m3", "more than 0"
                )
    if centre is not None:
        with read.gathered():
            water.r_b = FLU_TO_FRD @ read.numbers(centre, centre.text, 3)
    if box is not None:
        sides = [s for n in ("length", "width", "height") if (s := child(box, n)) is not None]
        if len(sides) == 3:
            with read.gathered():
                water.size = np.array([read.number(s) for s in sides])
    water.neutral = neutral is not None and (neutral.text or "").strip() in ("1", "true")
    for element in root.iter():
        if local(element) == "fluid_density" and "$" not in (element.text or ""):
            with read.gathered():
                water.rho = read.number(element)
            break
    return water


def _gz_sim(read: Reader, plugin: _Element) -> Water:
    water = Water("gz-sim's hydrodynamics plugin")
    found = {name: np.zeros((6, 6)) for name in ("M_A", "D_l", "D_q")}
    seen: set[str] = set()
    omitted = []
    for element in plugin:
        match = _SNAME.match(local(element))
        if match is None:
            continue
        value = 0.0
        with read.gathered():
            value = read.number(element)
        force, dot, acceleration, velocity, *second = match.groups()
        name = "M_A" if dot else "D_q" if any(second) else "D_l"
        if name == "D_q" and velocity not in second:
            omitted.append(local(element))
        elif value:
            column = "UVWPQR".index(acceleration or velocity)
            found[name]["xyzkmn".index(force), column] -= value
            seen.add(name)
    for name in seen:
        matrix = TURN @ found[name] @ TURN
        if name == "M_A" and not np.allclose(matrix, matrix.T):
            water.notes.append(f"{read.path}: the added mass is not symmetric; it is kept as it is")
        water.matrices[name] = matrix
    if omitted:
        products = ", ".join(omitted)
        water.notes.append(f"{read.path}: left out, products of two velocities: {products}")
    density = child(plugin, "water_density")
    if density is not None:
        with read.gathered():
            water.rho = read.number(density)
    return water
