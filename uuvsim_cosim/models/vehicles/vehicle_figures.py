"""Figures derived from a vehicle's parameters: balance, speeds, periods, derivatives.

All figures result from the equations that are simulated, submerged, not from single coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.analysis.operating_point import Coordinates
from uuvsim_cosim.models.declaration.hull_parameters import meaning_of
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    parameter_set,
    read_yaml,
    split_address,
    vehicle_folder,
    vehicle_sets,
)
from uuvsim_cosim.models.hull.coriolis import coriolis
from uuvsim_cosim.models.hull.matrices import structure
from uuvsim_cosim.models.vehicles.closed_forms import total_mass

__all__ = [
    "Ambiguous",
    "Oscillation",
    "VehicleFigures",
    "ambiguous_numbers",
    "submerged_force",
    "vehicle_figures",
]

Array = NDArray[np.float64]
FASTEST = 30.0  # m/s or rad/s: beyond, there is no terminal speed


@dataclass(frozen=True)
class Oscillation:
    """A turn about one axis at rest: undamped period [s] and damping ratio; 0 s: none."""

    period: float
    damping: float


@dataclass(frozen=True)
class VehicleFigures:
    """Figures of one parameter set in SI; vectors about CO in b."""

    mass: float
    weight: float
    buoyancy: float
    r_g: Array
    r_b: Array
    M: Array
    drift: float  # m/s, terminal w by weight less buoyancy; nan if there is none
    forces: tuple[float, float]  # N, or N.m, of `speeds`
    speeds: Array  # (6, 2), terminal speed along each axis by each of `forces`
    roll: Oscillation
    pitch: Oscillation
    U: float  # m/s, of what follows
    derivatives: Array  # (6, 6), of the hydrodynamic force by velocity at U
    lateral: NDArray[np.complex128]  # 1/s, poles of sway and yaw at U
    vertical: NDArray[np.complex128]  # 1/s, poles of heave and pitch at U


@dataclass(frozen=True)
class Ambiguous:
    """A number that has several published values."""

    name: str
    unit: str
    values: tuple[tuple[float, str], ...]  # each with the sets that have it


def vehicle_figures(address: str, U: float) -> VehicleFigures:
    """Work out the figures of a vehicle's parameter set, at U [m/s] where speed matters."""
    numbers = {k: q.value for k, q in parameter_set(*split_address(address)).quantities.items()}
    model = declare(address, surface=False)
    at = Coordinates(model)
    _, jacobians = at.functions
    M = total_mass(model)
    force = submerged_force(at, M)
    rigid = structure({k: v for k, v in numbers.items() if not k.startswith("M_A_")})
    M_RB, W, B, r_g, r_b = (np.array(ca.DM(ca.evalf(ca.densify(ca.SX(v))))) for v in rigid[:5])
    x_0, u_0 = _level(at)

    def terminal(axis: int, push: float) -> float:
        from scipy.optimize import brentq

        unit = np.eye(6)[axis]
        rest = push + (0.0 if axis == 2 else -force(np.zeros(6))[axis])

        def net(speed: float) -> float:
            return float(force(speed * unit)[axis]) + rest

        if abs(net(0.0)) < 1e-12:
            return 0.0
        end = float(np.copysign(FASTEST, net(0.0)))
        return float(brentq(net, 0.0, end)) if net(0.0) * net(end) < 0 else float("nan")

    weight = float(W.item())
    pushes = (0.01 * weight, 0.1 * weight)
    floating = force(np.zeros(6))[2]
    speeds = np.array(
        [[terminal(i, F - (floating if i == 2 else 0.0)) for F in pushes] for i in range(6)]
    )
    A_0 = np.array(jacobians(x_0, u_0)[0])
    x_U = x_0.copy()
    x_U[6] = U
    A_U = np.array(jacobians(x_U, u_0)[0])
    v = ca.SX.sym("nu", 6)  # d(C_RB(nu) nu)/dnu is no hydrodynamics
    of_coriolis = ca.Function("J", [v], [ca.densify(ca.jacobian(coriolis(ca.DM(M_RB), v), v))])
    return VehicleFigures(
        mass=float(numbers["m"]),
        weight=weight,
        buoyancy=float(B.item()),
        r_g=r_g.ravel(),
        r_b=r_b.ravel(),
        M=M,
        drift=terminal(2, 0.0),
        forces=pushes,
        speeds=speeds,
        roll=_oscillation(A_0, 3),
        pitch=_oscillation(A_0, 4),
        U=U,
        derivatives=M @ A_U[6:12, 6:12] + np.array(of_coriolis(x_U[6:12])),
        lateral=np.linalg.eigvals(A_U[np.ix_([7, 11], [7, 11])]).astype(complex),
        vertical=np.linalg.eigvals(A_U[np.ix_([8, 10, 4], [8, 10, 4])]).astype(complex),
    )


def submerged_force(hull: Coordinates, M: Array) -> Callable[[Array], Array]:
    """Return the force on a hull as a function of nu (6,): [N, N.m] about CO in b.

    The hull is level, 50 m deep, in still water, and no actuator pushes. `M` (6, 6) is its mass
    with added mass; the force is M d(nu)/dt, so that weight, buoyancy, damping and Coriolis terms
    are in it.
    """
    x_0, u_0 = _level(hull)

    def force(nu: Array) -> Array:
        x = x_0.copy()
        x[6:12] = nu
        return np.asarray(M @ np.array(hull.functions[0](x, u_0)[0]).ravel()[6:12])

    return force


def _level(hull: Coordinates) -> tuple[Array, Array]:
    """Return x and u of a hull at rest, level, 50 m deep."""
    x, u = hull.point(None)
    x[2:] = 0.0
    x[2] = 50.0
    return x, u


def _oscillation(A: Array, angle: int) -> Oscillation:
    """Read d²a/dt² = -w² a - 2 zeta w da/dt of one angle, the other axes free to give way."""
    rate = angle + 6
    stiffness, loss = -A[rate, angle], -A[rate, rate]
    if not stiffness > 0:
        return Oscillation(0.0, 0.0)
    w = float(np.sqrt(stiffness))
    return Oscillation(2.0 * np.pi / w, float(loss / (2.0 * w)))


def ambiguous_numbers(id: str) -> Iterator[Ambiguous]:
    """Yield each parameter of which a vehicle's sets, or its published values, differ."""
    found: dict[str, list[tuple[float, str]]] = {}
    units: dict[str, str] = {}
    for name in vehicle_sets(id):
        for key, quantity in parameter_set(id, name).quantities.items():
            found.setdefault(key, []).append((quantity.value, name))
            units.setdefault(key, quantity.unit)
    path = vehicle_folder(id) / "published.yaml"
    if path.is_file():
        for key, entries in read_yaml(path, "published.schema.json")["parameters"].items():
            for entry in entries:
                meaning = meaning_of(str(key))
                unit = str(entry["unit"]) if meaning is None else meaning.unit
                value = in_unit(float(entry["value"]), str(entry["unit"]), unit)
                found.setdefault(str(key), []).append((value, "published.yaml"))
                units.setdefault(str(key), unit)
    for key in sorted(found):
        values: dict[float, list[str]] = {}
        for value, where in found[key]:
            values.setdefault(value, []).append(where)
        if len(values) > 1:
            named = tuple(
                (v, ", ".join(dict.fromkeys(w for w in places if w != "published.yaml")))
                for v, places in sorted(values.items())
            )
            yield Ambiguous(key, units[key], named)
