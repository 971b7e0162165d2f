"""Hydrodynamics in a robot description (plugins of uuv_simulator and gz-sim), converted to FRD.

uuv_simulator writes 6x6 matrices in FRD, added mass positive, damping negative; volume and centre
of buoyancy are geometry, in FLU. gz-sim writes SNAME's derivatives (negative) in the link's own
axes, FLU: an element that turns one of x, p into one of y, z, q, r changes its sign.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.importing.description_bodies import child, gathered, numbers
from uuvsim_cosim.models.importing.description_file import place_of
from uuvsim_cosim.models.importing.xacro_text import local

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


def water_of(path: Path, root: _Element, problems: list[str]) -> Water | None:
    """Read the first hydrodynamic model that is there, None if there is none.

    What is wrong is added to `problems`.
    """
    for element in root.iter():
        if local(element) == "hydrodynamic_model":
            return _uuv_simulator(path, element, root, problems)
    for element in root.iter():
        words = f"{element.get('filename', '')} {element.get('name', '')}".lower()
        if local(element) == "plugin" and "hydrodynamics" in words:
            return _gz_sim(path, element, problems)
    return None


def _matrix(path: Path, element: _Element, counts: tuple[int, ...]) -> Array:
    values = numbers(path, element, element.text, counts)
    return np.diag(values) if len(values) == 6 else values.reshape(6, 6)


def _uuv_simulator(path: Path, model: _Element, root: _Element, problems: list[str]) -> Water:
    water = Water("uuv_simulator's hydrodynamic model")
    kind = child(model, "type")
    if kind is not None and (kind.text or "").strip() != "fossen":
        raise InputInvalid(
            place_of(path, kind),
            f"<type>: {(kind.text or '').strip()!r}",
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
        with gathered(problems):
            matrix = sign * _matrix(path, element, (36,) if name == "M_A" else (6, 36))
        driving = [i + 1 for i in range(6) if matrix[i, i] < 0]
        if driving:
            water.notes.append(
                f"{place_of(path, element)}: <{tag}>: the diagonal elements {driving} "
                "have the sign "
                "that drives the vehicle; they are kept as they are"
            )
        water.matrices[name] = matrix
    link = model.getparent()
    assert link is not None  # <hydrodynamic_model> stands in a <link>
    place = {
        n: child(link, n) for n in ("volume", "box", "center_of_buoyancy", "neutrally_buoyant")
    }
    if place["volume"] is not None:
        with gathered(problems):
            water.volume = float(numbers(path, place["volume"], place["volume"].text, 1)[0])
            if not water.volume > 0:
                raise InputInvalid(
                    place_of(path, place["volume"]), f"<volume>: {water.volume:g} m3", "more than 0"
                )
    if place["center_of_buoyancy"] is not None:
        at = place["center_of_buoyancy"]
        with gathered(problems):
            water.r_b = FLU_TO_FRD @ numbers(path, at, at.text, 3)
    if place["box"] is not None:
        names = ("length", "width", "height")
        sides = [s for n in names if (s := child(place["box"], n)) is not None]
        if len(sides) == len(names):
            with gathered(problems):
                water.size = np.array([numbers(path, s, s.text, 1)[0] for s in sides])
    neutral = place["neutrally_buoyant"]
    water.neutral = neutral is not None and (neutral.text or "").strip() in ("1", "true")
    with gathered(problems):
        water.rho = _density(path, root, "fluid_density")
    return water


def _density(path: Path, root: _Element, tag: str) -> float | None:
    for element in root.iter():
        if local(element) == tag and "$" not in (element.text or ""):
            return float(numbers(path, element, element.text, 1)[0])
    return None


def _gz_sim(path: Path, plugin: _Element, problems: list[str]) -> Water:
    water = Water("gz-sim's hydrodynamics plugin")
    found = {name: np.zeros((6, 6)) for name in ("M_A", "D_l", "D_q")}
    seen: set[str] = set()
    omitted = []
    for element in plugin:
        name = local(element)
        match = _SNAME.match(name)
        if match is None:
            continue
        value = 0.0
        with gathered(problems):
            value = float(numbers(path, element, element.text, 1)[0])
        i = "xyzkmn".index(match[1])
        if match[2]:
            kind, j = "M_A", "UVWPQR".index(match[3])
        elif match[5] or match[6]:
            j = "UVWPQR".index(match[4])
            kind = "D_q"
            if (match[5] or match[6]) != match[4]:
                omitted.append(name)
                continue
        else:
            kind, j = "D_l", "UVWPQR".index(match[4])
        if value:
            found[kind][i, j] -= value
            seen.add(kind)
    for kind in seen:
        matrix = TURN @ found[kind] @ TURN
        if kind == "M_A" and not np.allclose(matrix, matrix.T):
            water.notes.append(f"{path}: the added mass is not symmetric; it is kept as it is")
        water.matrices[kind] = matrix
    if omitted:
        water.notes.append(f"{path}: left out, products of two velocities: {', '.join(omitted)}")
    density = child(plugin, "water_density")
    if density is not None:
        with gathered(problems):
            water.rho = float(numbers(path, density, density.text, 1)[0])
    return water
