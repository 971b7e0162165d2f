"""Matrices of Fossen's equation from the parameters of a hull, and those parameters declared."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of, missing, near_names
from uuvsim_cosim.models.declaration.inertia import (
    elements,
    parameter_vector,
    rigid_mass,
    symmetric,
)
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import parameter_set, split_address

__all__ = ["declare_parameters", "mass_of_water", "nominal", "structure"]


def declare_parameters(
    m: Model, numbers: Mapping[str, float], surface: bool, sources: Mapping[str, str]
) -> dict[str, ca.SX]:
    """Declare the parameters of a hull, each with its unit and source; return their symbols."""
    wrong = [
        f"{n!r} is not a parameter of a hull; expected {near_names(n)}"
        for n in numbers
        if meaning_of(n) is None
    ]
    wrong += missing(numbers, surface)
    if wrong:
        raise ParameterInvalid(f"{m.name}: " + "; ".join(wrong))
    symbols: dict[str, ca.SX] = {}
    for name, value in numbers.items():
        meaning = meaning_of(name)
        if meaning is None or (name == "height" and not surface):
            continue
        if meaning.min is not None and not value >= meaning.min:
            raise ParameterInvalid(
                f"{m.name}.{name}", f"{value} {meaning.unit}", f"at least {meaning.min:g}"
            )
        words = meaning.words + (f" ({sources[name]})" if name in sources else "")
        symbols[name] = m.parameter(
            name, float(value), unit=meaning.unit, min=meaning.min, description=words
        )
    return symbols


def structure(p: Mapping[str, Number]) -> tuple[ca.SX, Number, Number, ca.SX, ca.SX, ca.SX, ca.SX]:
    """Return (M, W, B, r_g, r_b, D_l, D_q) of a hull's parameters, zeros structural."""
    r_g, r_b = parameter_vector(p, "g"), parameter_vector(p, "b")
    M = rigid_mass(p) + symmetric(p, "M_A")
    if "W" in p:
        W, B = p["W"], p["B"]
    else:
        W, B = p["m"] * p["g"], p["rho"] * p["g"] * p["nabla"]
    return M, W, B, r_g, r_b, elements(p, "D_l", 6), elements(p, "D_q", 6)


def mass_of_water(p: Mapping[str, ca.SX]) -> ca.SX:
    """Return the mass [kg] of the water that a submerged hull displaces: B / g, with g = W / m."""
    if "W" not in p:
        return p["rho"] * p["nabla"]
    weighs = p["W"] > 0.0
    return ca.if_else(weighs, p["m"] * p["B"] / ca.if_else(weighs, p["W"], 1.0), p["m"])


def nominal(vehicle: str) -> tuple[list[float], list[float], list[float]]:
    """Return the diagonals of M, D_l and D_q that a vehicle's parameter set lists."""
    values = {k: q.value for k, q in parameter_set(*split_address(vehicle)).quantities.items()}
    axes = range(1, 7)
    inertia = [
        values["m"]
        if i <= 3
        else values.get(f"I_b_{i - 3}{i - 3}", values.get(f"I_g_{i - 3}{i - 3}", 0.0))
        for i in axes
    ]
    mass = [rigid + values.get(f"M_A_{i}{i}", 0.0) for i, rigid in zip(axes, inertia, strict=True)]
    linear = [values.get(f"D_l_{i}{i}", 0.0) for i in axes]
    return mass, linear, [values.get(f"D_q_{i}{i}", 0.0) for i in axes]
