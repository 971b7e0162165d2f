"""Fins: servos turn them, and the flow at each fin makes lift and drag at any angle of attack.

A fin at r turns about its hinge a by the angle delta (right-handed), and with it its chord c and
its normal n. The flow at the fin is  v = v_r + omega x r,  with the components  A = v·c,  B = v·n:

    V² = A² + B²,   sin(alpha) = B / V,   s = sin(alpha) held within ±sin(alpha_stall)
    lift = 1/2 rho S C_L_alpha s A   across the flow, along  (B c - A n)
    drag = 1/2 rho S (C_D_0 + C_D_n sin²(alpha)) V   against it, along  -(A c + B n)

Lift does no work, vanishes broadside (A = 0), changes its sign with B, and is as large astern as
ahead; beyond the stall angle it does not grow. Drag only brakes. If a hull's own coefficients
include its fins at delta = 0, that part is subtracted, and only the effect of steering remains.

Options, off by default: `limits` bounds the rate of each servo. `faults` gives each fin the
parameters `stuck` (1: the fin keeps its angle) and `health` (factor of the effect of its
deflection; 0: none), which are tunable at run time.

form="derivatives" uses control derivatives as they are published: products of velocities,
deflections and the slipstream factor epsilon,

    force = sum over terms of  value · (two of u v w p q r) · (deflections) · epsilon
    epsilon = (sqrt(1 + C_t |eta| eta) - 1) / (sqrt(1 + C_t) - 1) - 1,   eta = k_u n / u

epsilon is 0 at the steady speed that belongs to the propeller's speed, and greater if the propeller
pushes harder (Healey and Lienard 1993, IEEE J. Oceanic Eng. 18(3), 327-339). These sums are fits
for motion ahead. Lift and drag as above are valid at any angle and astern, but have no slipstream.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.files_read import shared_until_changed
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    line_of,
    read_yaml,
    vehicle_folder,
)
from uuvsim_cosim.models.declaration.safe_math import abs_, clip, norm, safe_sqrt, saturate
from uuvsim_cosim.models.declaration.vectors import NU, TAU

__all__ = ["FinGeometry", "fin_force", "fin_geometry", "fins"]

Array = NDArray[np.float64]
VELOCITIES, FORCES = "uvwpqr", "XYZKMN"
SLOWEST = 0.05  # m/s, below which eta counts as at this speed
_FIGURES = {
    "rho": ("kg/m3", 0.0, "density of the water"),
    "S": ("m2", 0.0, "area of one fin"),
    "C_L_alpha": ("1", 0.0, "slope of its lift coefficient, per rad"),
    "C_D_0": ("1", 0.0, "its drag coefficient along the flow"),
    "C_D_n": ("1", 0.0, "and what broadside adds to it"),
    "alpha_stall": ("rad", 1e-3, "angle of attack beyond which lift stops growing"),
    "delta_max": ("rad", 0.0, "largest deflection"),
    "T_delta": ("s", 4e-3, "time constant of the servo"),
}


@dataclass(frozen=True)
class FinGeometry:
    """n fins: names, positions r and hinges a (n, 3) in b, figures each (n,), what the hull has."""

    names: tuple[str, ...]
    r: Array
    a: Array
    figures: dict[str, Array]
    sources: dict[str, str]
    in_hull: bool


def fins(
    vehicle: str = "remus100",
    contact: bool | str = False,
    limits: bool | str = False,
    faults: bool | str = False,
    form: str = "lift",
) -> Model:
    """Declare the fins of a vehicle, folder/fins.yaml: commands in rad, generalised force out.

    With `contact` there is an input of that name, a generalised force in b that is added: that of
    a propeller or a wrench, so that one connection leads on to the hull. form="derivatives" takes
    the sums that are printed, of folder/control.yaml, in place of lift and drag.
    """
    if form not in ("lift", "derivatives"):
        raise ParameterInvalid(f"form={form!r}", "lift or derivatives")
    g = fin_geometry(vehicle)
    n = len(g.names)
    m = Model("fins", f"Fins of {vehicle}: servos, lift and drag at any angle", h_max=0.01)
    order = "; ".join(f"{i} {name}" for i, name in enumerate(g.names, 1))
    u = m.input("u", n, unit="rad", description=f"wanted deflections: {order}")
    nu_r = m.input("nu_r", 6, unit=NU, description="of the hull, relative to the water")
    r = m.parameter("r", g.r, unit="m", description="positions from CO in b")
    a = m.parameter("a", g.a, unit="1", description="hinges in b; right-handed is positive")
    p = {
        name: m.parameter(
            name, g.figures[name], unit=unit, min=low, description=f"{words} ({g.sources[name]})"
        )
        for name, (unit, low, words) in _FIGURES.items()
    }
    delta = m.state("deflection", np.zeros(n), unit="rad", description="of each fin")
    rates = [(saturate(u[i], p["delta_max"][i]) - delta[i]) / p["T_delta"][i] for i in range(n)]
    health = None
    if is_on("limits", limits):
        fastest = m.parameter(
            "delta_rate", 1.0, unit="rad/s", min=0, description="fastest turning (assumption)"
        )
        rates = [saturate(rate, fastest) for rate in rates]
    if is_on("faults", faults):
        stuck = m.parameter("stuck", np.zeros(n), unit="1", min=0, max=1, description="1: it stays")
        health = m.parameter("health", np.ones(n), unit="1", min=0, max=1, description="0: lost")
        rates = [(1.0 - stuck[i]) * rate for i, rate in enumerate(rates)]
    m.der(delta, ca.vertcat(*rates))
    tau = ca.SX.zeros(6)
    forces = []
    if form == "derivatives":
        turned = delta if health is None else health * delta
        tau += _control_force(m, vehicle, g.names, nu_r, turned)
    for i in range(n if form == "lift" else 0):
        at, hinge = r[i, :].T, a[i, :].T
        figures = {name: value[i] for name, value in p.items()}
        force = fin_force(nu_r, at, hinge, delta[i], figures)
        if g.in_hull:
            force -= fin_force(nu_r, at, hinge, 0.0, figures)
        if health is not None:
            force = health[i] * force
        forces.append(force)
        tau += ca.vertcat(force, ca.cross(at, force))
    if is_on("contact", contact):
        tau += m.input("contact", 6, unit=TAU, description="of the propeller, about CO in b")
    m.output("tau", tau, unit=TAU, description="X Y Z [N], K M N [N.m] in b")
    if forces:
        each = ca.vertcat(*forces)
        m.output("force", each, unit="N", description="X Y Z of each fin, one by one")
    m.output("delta", delta, unit="rad", description="deflection of each fin")
    return m


def fin_force(nu_r: ca.SX, r: ca.SX, a: ca.SX, delta: Number, p: Mapping[str, Number]) -> ca.SX:
    """Return the force (3) [N] in b of one fin at r with hinge a, turned by delta [rad]."""
    v = nu_r[:3] + ca.cross(nu_r[3:], r)
    ahead = ca.vertcat(1.0 - a[0] * a[0], -a[0] * a[1], -a[0] * a[2])
    c_0 = ahead / norm(ahead)  # the chord: x as far as it is across the hinge
    n_0 = ca.cross(a, c_0)
    c = ca.cos(delta) * c_0 + ca.sin(delta) * n_0
    n = ca.cos(delta) * n_0 - ca.sin(delta) * c_0
    A, B = ca.dot(v, c), ca.dot(v, n)
    V = norm(ca.vertcat(A, B))
    flows = V > 1e-12
    sine = ca.if_else(flows, B / ca.if_else(flows, V, 1.0), 0.0)
    s = saturate(sine, ca.sin(clip(p["alpha_stall"], 0.0, 0.5 * np.pi)))
    q_S = 0.5 * p["rho"] * p["S"]
    lift = q_S * p["C_L_alpha"] * s * A
    drag = q_S * (p["C_D_0"] + p["C_D_n"] * sine * sine) * V
    return lift * (B * c - A * n) - drag * (A * c + B * n)


@shared_until_changed
def fin_geometry(vehicle: str) -> FinGeometry:
    """Read the fins of a vehicle, by its id or its folder."""
    path = vehicle_folder(vehicle) / "fins.yaml"
    if not path.is_file():
        raise ParameterInvalid(f"there are no fins of {vehicle!r}", f"a file {path}")
    return read_fins(path)


def read_fins(path: Path) -> FinGeometry:
    """Read a file of fins; raises ParameterInvalid with the line of every mistake."""
    data = read_yaml(path, "fins.schema.json")
    items, common = data["fins"], data["figures"]
    problems: list[str] = []

    def read(entry: Mapping[str, Any], name: str, unit: str, line: int) -> list[float]:
        value = entry["value"] if isinstance(entry["value"], list) else [entry["value"]]
        try:
            return [in_unit(float(x), str(entry["unit"]), unit) for x in value]
        except ValueError as error:
            problems.append(f"{path}:{line}: {name}: {error}")
            return [0.0] * len(value)

    place = [line_of(data, ["fins", i]) for i in range(len(items))]
    r = np.array([read(f["r"], "r", "m", k) for f, k in zip(items, place, strict=True)])
    a = np.array([read(f["a"], "a", "1", k) for f, k in zip(items, place, strict=True)])
    for hinge, line in zip(a, place, strict=True):
        if abs(np.linalg.norm(hinge) - 1.0) > 1e-6 or abs(hinge[0]) > 0.9:
            problems.append(f"{path}:{line}: a = {hinge}; expected length 1, and across x")
    figures: dict[str, Array] = {}
    sources: dict[str, str] = {}
    for name, (unit, low, _) in _FIGURES.items():
        values = []
        for fin, line in zip(items, place, strict=True):
            if name not in fin and name not in common:
                problems.append(f"{path}:{line}: {name} is missing; expected it here or in figures")
                continue
            entry = fin.get(name, common.get(name))
            values += read(entry, name, unit, line)
            if values[-1] < low:
                problems.append(f"{path}:{line}: {name} {values[-1]:g}; expected at least {low:g}")
            sources.setdefault(name, str(entry["source"]))
        figures[name] = np.array(values)
    if problems:
        raise ParameterInvalid.of(dict.fromkeys(problems))
    names = tuple(str(f["name"]) for f in items)
    return FinGeometry(names, r, a, figures, sources, bool(data["undeflected_in_hull"]))


def _control_force(
    m: Model, vehicle: str, names: tuple[str, ...], nu_r: ca.SX, delta: ca.SX
) -> ca.SX:
    """Declare the terms of folder/control.yaml; return their force (6) about CO in b.

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
        per = ("m2", "(m.rad)", "rad2")[sum(x in "pqr" for x in moving)]
        unit = ("N.s2/" if str(term["force"]) in "XYZ" else "N.m.s2/") + per
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
