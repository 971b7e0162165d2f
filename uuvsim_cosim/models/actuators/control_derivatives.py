"""Control derivatives as printed: products of velocities, deflections and of the slipstream.

    force = sum over terms of  value · (two of u v w p q r) · (deflections) · epsilon
    epsilon = (sqrt(1 + C_t |eta| eta) - 1) / (sqrt(1 + C_t) - 1) - 1,   eta = k_u n / u

epsilon is 0 where the propeller drives the hull at its steady speed, more where it pushes harder
(Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), 327-339). Such sums are fits for motion ahead;
`fins.py` holds at any angle and astern, but knows no slipstream.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    line_of,
    read_yaml,
    vehicle_folder,
)
from uuvsim_cosim.models.declaration.safe_math import abs_, safe_sqrt

__all__ = ["control_force"]

VELOCITIES, FORCES = "uvwpqr", "XYZKMN"
SLOWEST = 0.05  # m/s, below which eta counts as at this speed


def control_force(
    m: Model, vehicle: str, names: tuple[str, ...], nu_r: ca.SX, delta: ca.SX
) -> ca.SX:
    """Declare the terms of folder/control.yaml; give their force (6) about CO in b.

    `names` are those of the fins, in the order of `delta` [rad]. Where a term has a slipstream an
    input n, the propeller's speed, is declared.
    """
    path = vehicle_folder(vehicle) / "control.yaml"
    if not path.is_file():
        raise ParameterInvalid("form=derivatives", f"{vehicle!r} has none", f"a file {path}")
    data = read_yaml(path, "control.schema.json")
    factors: dict[str, ca.SX] = {x: nu_r[i] for i, x in enumerate(VELOCITIES)}
    factors |= {name: delta[i] for i, name in enumerate(names)}
    if "slipstream" in data:
        factors["slipstream"] = _slipstream(m, data["slipstream"], nu_r[0])
    tau = ca.SX.zeros(6)
    problems = []
    values, sources = [], []
    for i, term in enumerate(data["terms"]):
        line, of = line_of(data, ["terms", i]), [str(x) for x in term["of"]]
        unknown = [x for x in of if x not in factors]
        moving = [x for x in of if x in VELOCITIES]
        if unknown or len(moving) != 2:
            expected = ", ".join(factors)
            problems.append(f"{path}:{line}: of: {of}; expected two velocities, from {expected}")
            continue
        unit = _unit(str(term["force"]), moving)
        try:
            values.append(in_unit(float(term["value"]), str(term["unit"]), unit))
        except ValueError as error:
            problems.append(f"{path}:{line}: {term['name']}: {error}")
        sources.append((str(term["name"]), str(term["force"]), of))
    if problems:
        raise ParameterInvalid.of(problems)
    order = "; ".join(f"{i} {name} in {force}" for i, (name, force, _) in enumerate(sources, 1))
    k = m.parameter("k", values, unit="1", description=f"coefficients, in SI: {order}")
    for i, (_, force, of) in enumerate(sources):
        product = k[i]
        for x in of:
            product = product * factors[x]
        tau[FORCES.index(force)] += product
    return tau


def _unit(force: str, moving: list[str]) -> str:
    top = "N" if force in "XYZ" else "N.m"
    turns = sum(x in "pqr" for x in moving)
    return f"{top}.s2/" + ("m2", "(m.rad)", "rad2")[turns]


def _slipstream(m: Model, data: Mapping[str, Any], u: ca.SX) -> ca.SX:
    n = m.input("n", unit="rad/s", description="speed of the propeller, for its slipstream")
    k_u, C_t = (
        m.parameter(
            name,
            in_unit(float(data[name]["value"]), str(data[name]["unit"]), unit),
            unit=unit,
            description=f"{words} ({data[name]['source']})",
        )
        for name, unit, words in (
            ("k_u", "m/rad", "eta = k_u n / u"),
            ("C_t", "1", "thrust loading at eta = 1"),
        )
    )
    u_safe = ca.if_else(abs_(u) > SLOWEST, u, ca.if_else(u < 0.0, -SLOWEST, SLOWEST))
    eta = k_u * n / u_safe
    root = safe_sqrt(1.0 + C_t * abs_(eta) * eta) - 1.0
    return root / (ca.sqrt(1.0 + C_t) - 1.0) - 1.0
