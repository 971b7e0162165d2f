"""Allocation of a generalised force to thruster commands: three methods.

`allocation`: weighted pseudo-inverse,

    f = W T' (T W T' + epsilon I)^-1 tau,   W = diag(health),   u_i = thrust curve^-1 (f_i)

minimises f' W^-1 f (Fossen 2021, 2nd ed., section 11.2.2). A thruster with health 0 gets no thrust.
epsilon, 1e-9 of the force terms, keeps thrusts bounded if the other thrusters cannot make a
component of tau. If one thrust exceeds its limit, all are scaled by one factor, so that tau keeps
its direction.

`allocation_qp`: a quadratic programme, the nearest force within the limits of the thrusters,

    min over f of  (T f - tau)' W (T f - tau) / 2 + epsilon f'f / 2,
    such that      -h_i f_min <= f_i <= h_i f_max

with W = diag(weight) and h the health (Fossen 2021, 2nd ed., chapter 11: constrained allocation).
`allocation` scales all thrusts by one factor; this method distributes the share of a saturated or
lost thruster to the others. It starts at the pseudo-inverse and minimises over one thrust after the
other, `sweeps` times, with overrelaxation by 1.3. Every step lowers the cost, so it can stop at any
step. Five sweeps miss the exact force by 0.1 % on average and by 1.2 % at worst.

`allocation_quadratic`: a fixed pseudo-inverse for thrusters with quadratic thrust, few operations,

    f = T^+ tau,   T^+ = T' (T T')^-1,   u_i = sign(f_i) sqrt(|f_i| / f_max)

like `allocation` with healthy thrusters and a thrust curve without a dead band. T^+ depends on
parameters alone. If one thrust exceeds f_max, all are scaled by one factor. Below 1e-3 of f_max the
curve is a line, because the slope of the root at 0 is infinite.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.thruster import largest_thrust
from uuvsim_cosim.models.actuators.thruster_geometry import Geometry, thruster_geometry
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import abs_, clip
from uuvsim_cosim.models.declaration.vectors import TAU
from uuvsim_cosim.models.hull.coriolis import inverse
from uuvsim_cosim.models.intrinsics.table import table1

__all__ = ["allocation", "allocation_qp", "allocation_quadratic", "command_of_thrust"]

ARM = 0.2  # m: an error of 1 N.m weighs as much as one of 1 / ARM N
EPSILON = 1e-3  # of the squared thrusts in the cost
BEYOND = 1.3  # of the best step
LINEAR = 1e-3  # of f_max: below it the command is linear in the thrust


def command_of_thrust(thruster: str, voltage: float) -> tuple[list[float], list[float]]:
    """Return the steady thrust [N] and the command u over it, rising, at a voltage.

    Within the dead band one command stands for no thrust, 0; from there the curve leads
    straight to the first rows that push.
    """
    bench = read_bench(thruster)
    low, high = bench.voltage[0], bench.voltage[-1]
    if not low <= voltage <= high:
        raise ParameterInvalid(thruster, f"{voltage} V", f"{low} to {high} V, the bench's")
    u, table = bench.over_u(bench.thrust)
    thrust = np.array([np.interp(voltage, bench.voltage, column) for column in table.T])
    pushes = np.abs(thrust) > 1e-9
    reverse, forward = pushes & (u < 0), pushes & (u > 0)
    rows = np.concatenate([thrust[reverse], [0.0], thrust[forward]])
    return rows.tolist(), np.concatenate([u[reverse], [0.0], u[forward]]).tolist()


@dataclass(frozen=True)
class _Thrusters:
    """Symbols of an allocation to thrusters with a bench: wanted force, health, limits, T."""

    tau_d: ca.SX  # (6,)
    health: ca.SX  # (n,)
    f_max: ca.SX  # N, forward
    f_min: ca.SX  # N, backward, positive
    T: ca.SX  # (6, n)
    curve: Callable[[ca.SX], ca.SX]  # u of a thrust


def _configuration(m: Model, geometry: Geometry) -> ca.SX:
    """Declare positions and directions as parameters; return T (6, n): force per unit thrust."""
    r = m.parameter("r", geometry.r, unit="m", description="positions from CO in b")
    e = m.parameter("e", geometry.e, unit="1", description="directions of positive thrust in b")
    columns = [
        ca.vertcat(e[i, :].T, ca.cross(r[i, :].T, e[i, :].T)) for i in range(len(geometry.names))
    ]
    return ca.densify(ca.horzcat(*columns))


def _thrusters(m: Model, geometry: Geometry, thruster: str, voltage: float) -> _Thrusters:
    """Declare the inputs and the limits of thrusters, all alike, at a supply voltage [V]."""
    n = len(geometry.names)
    thrusts, commands = command_of_thrust(thruster, voltage)
    tau_d = m.input("tau_d", 6, unit=TAU, description="wanted force about CO in b [N, N.m]")
    health = m.input(
        "health", n, unit="1", start=(1.0,) * n, min=0, max=1, description="0: failed; 1: whole"
    )
    T = _configuration(m, geometry)
    f_max = m.parameter("f_max", thrusts[-1], unit="N", min=1e-6, description="largest forward")
    f_min = m.parameter("f_min", -thrusts[0], unit="N", min=1e-6, description="largest backward")
    return _Thrusters(tau_d, health, f_max, f_min, T, table1(thrusts, commands))


def _declare_commands(m: Model, geometry: Geometry, commands: list[ca.SX]) -> None:
    words = "; ".join(f"{i} {x}" for i, x in enumerate(geometry.names, 1))
    m.output("u", ca.vertcat(*commands), unit="1", description=words)


def _pseudo_inverse(T: ca.SX, WT: ca.SX) -> ca.SX:
    """Return W T' (T W T' + epsilon I)^-1."""
    return ca.mtimes(WT, inverse(ca.mtimes(T, WT) + 1e-9 * ca.SX.eye(6)))


def allocation(
    vehicle: str = "bluerov2_heavy", thruster: str = "t200", voltage: float | str = 16.0
) -> Model:
    """Declare the allocation for a vehicle's thrusters at a nominal supply voltage."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    m = Model("allocation", f"Weighted pseudo-inverse allocation to {n} thrusters of {vehicle}")
    x = _thrusters(m, geometry, thruster, float(voltage))
    T = m.derived("T", x.T)
    all_whole = m.derived("pseudo_inverse", _pseudo_inverse(T, T.T))
    damaged = ca.SX(0.0)
    for i in range(n):
        damaged = ca.logic_or(damaged, x.health[i] != 1.0)
    WT = ca.mtimes(ca.diag(clip(x.health, 0.0, 1.0)), T.T)
    weighted = ca.mtimes(_pseudo_inverse(T, WT), x.tau_d)
    f = ca.if_else(damaged, weighted, ca.mtimes(all_whole, x.tau_d))
    scale = ca.SX(1.0)
    for i in range(n):
        load = ca.if_else(f[i] < 0, -f[i] / x.f_min, f[i] / x.f_max)
        scale = ca.if_else(load > scale, load, scale)
    f = f / scale
    _declare_commands(m, geometry, [x.curve(f[i]) for i in range(n)])
    m.output("f", f, unit="N", description="thrust that is expected of each thruster")
    m.output("saturation", 1.0 / scale, unit="1", description="1: tau_d is met; less: scaled by it")
    return m


def allocation_qp(
    vehicle: str = "bluerov2_heavy",
    thruster: str = "t200",
    voltage: float | str = 16.0,
    sweeps: int | str = 5,
) -> Model:
    """Declare the allocation for a vehicle's thrusters at a nominal supply voltage."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    m = Model("allocation_qp", f"Quadratic programme for {n} thrusters of {vehicle}")
    x = _thrusters(m, geometry, thruster, float(voltage))
    weight = m.parameter(
        "weight",
        (1.0,) * 3 + (ARM**-2,) * 3,
        unit=("1/N2",) * 3 + ("1/(N2.m2)",) * 3,
        min=1e-9,
        description="of errors of force and of moment",
    )
    T = m.derived("T", x.T)
    TW = ca.mtimes(T.T, ca.diag(weight))
    cost = ca.mtimes(TW, T) + EPSILON * ca.SX.eye(n)
    H = m.derived("H", ca.densify(cost))
    start = m.derived("start", ca.densify(ca.mtimes(inverse(cost), TW)))
    share = clip(x.health, 0.0, 1.0)
    wanted = ca.mtimes(TW, x.tau_d)
    whole = ca.mtimes(start, x.tau_d)
    low, high = [-share[i] * x.f_min for i in range(n)], [share[i] * x.f_max for i in range(n)]
    f = [clip(whole[i], low[i], high[i]) for i in range(n)]
    for _ in range(int(sweeps)):
        for i in range(n):
            slope = wanted[i] - sum(H[i, j] * f[j] for j in range(n))
            f[i] = clip(f[i] + BEYOND * slope / H[i, i], low[i], high[i])
    thrust = ca.vertcat(*f)
    made = ca.mtimes(T, thrust)
    size = ca.dot(x.tau_d, weight * x.tau_d)
    met = ca.if_else(
        size > 1e-9, ca.dot(made, weight * x.tau_d) / ca.if_else(size > 1e-9, size, 1.0), 1.0
    )
    _declare_commands(m, geometry, [x.curve(f[i]) for i in range(n)])
    m.output("f", thrust, unit="N", description="thrust that is expected of each thruster")
    m.output("saturation", met, unit="1", description="share of tau_d that is met; 1: all")
    return m


def allocation_quadratic(vehicle: str = "pool8", thruster: str = "pool8_jet") -> Model:
    """Declare the allocation for a vehicle's thrusters, all alike, named by their preset."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    m = Model("allocation_quadratic", f"Fixed pseudo-inverse to {n} quadratic thrusters")
    tau_d = m.input("tau_d", 6, unit=TAU, description="wanted force about CO in b [N, N.m]")
    T = _configuration(m, geometry)
    f_max = m.parameter(
        "f_max", largest_thrust(thruster), unit="N", min=1e-6, description="largest, either way"
    )
    f = ca.mtimes(m.derived("T_inv", _pseudo_inverse(T, T.T)), tau_d) / f_max
    largest = ca.SX(1.0)
    for i in range(n):
        load = abs_(f[i])
        largest = ca.if_else(load > largest, load, largest)
    f = f / largest
    size = abs_(f)
    root = ca.sqrt(clip(size, LINEAR, 1.0))
    signed = ca.if_else(f < 0.0, -root, root)
    u = ca.if_else(size < LINEAR, f / LINEAR**0.5, signed)  # odd and continuous
    _declare_commands(m, geometry, [u])
    m.output("saturation", 1.0 / largest, unit="1", description="1: tau_d is met; less: scaled")
    return m
