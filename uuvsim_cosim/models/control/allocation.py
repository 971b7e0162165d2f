"""Allocation of a generalised force to thruster commands by weighted pseudo-inverse.

    f = W T' (T W T' + epsilon I)^-1 tau,   W = diag(health),   u_i = thrust curve^-1 (f_i)

minimises f' W^-1 f (Fossen 2021, 2nd ed., section 11.2.2). A thruster of health 0 gets nothing;
epsilon, 1e-9 of the force terms, keeps what the others cannot make from blowing up. Where one
thrust exceeds its limit, all are scaled by one factor, so that tau keeps its direction.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.actuators.bench_rows import read_bench
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import TAU
from uuvsim_cosim.models.hull.coriolis import inverse
from uuvsim_cosim.models.intrinsics.table import table1

__all__ = ["allocation", "command_of_thrust"]


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


def _pseudo_inverse(T: ca.SX, WT: ca.SX) -> ca.SX:
    """Return W T' (T W T' + epsilon I)^-1."""
    return ca.mtimes(WT, inverse(ca.mtimes(T, WT) + 1e-9 * ca.SX.eye(6)))


def allocation(
    vehicle: str = "bluerov2_heavy", thruster: str = "t200", voltage: float | str = 16.0
) -> Model:
    """Declare the allocation for a vehicle's thrusters at a nominal supply voltage."""
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    thrusts, commands = command_of_thrust(thruster, float(voltage))
    curve = table1(thrusts, commands)
    m = Model("allocation", f"Weighted pseudo-inverse allocation to {n} thrusters of {vehicle}")
    tau_d = m.input("tau_d", 6, unit=TAU, description="wanted force about CO in b [N, N.m]")
    health = m.input(
        "health", n, unit="1", start=(1.0,) * n, min=0, max=1, description="0: failed; 1: whole"
    )
    r = m.parameter("r", geometry.r, unit="m", description="positions from CO in b")
    e = m.parameter("e", geometry.e, unit="1", description="directions of positive thrust in b")
    f_max = m.parameter("f_max", thrusts[-1], unit="N", min=1e-6, description="largest forward")
    f_min = m.parameter("f_min", -thrusts[0], unit="N", min=1e-6, description="largest backward")
    T = m.derived(
        "T",
        ca.densify(
            ca.horzcat(*(ca.vertcat(e[i, :].T, ca.cross(r[i, :].T, e[i, :].T)) for i in range(n)))
        ),
    )
    all_whole = m.derived("pseudo_inverse", _pseudo_inverse(T, T.T))
    damaged = ca.SX(0.0)
    for i in range(n):
        damaged = ca.logic_or(damaged, health[i] != 1.0)
    WT = ca.mtimes(ca.diag(clip(health, 0.0, 1.0)), T.T)
    f = ca.if_else(damaged, ca.mtimes(_pseudo_inverse(T, WT), tau_d), ca.mtimes(all_whole, tau_d))
    scale = ca.SX(1.0)
    for i in range(n):
        load = ca.if_else(f[i] < 0, -f[i] / f_min, f[i] / f_max)
        scale = ca.if_else(load > scale, load, scale)
    f = f / scale
    u = ca.vertcat(*(curve(f[i]) for i in range(n)))
    m.output(
        "u", u, unit="1", description="; ".join(f"{i} {x}" for i, x in enumerate(geometry.names, 1))
    )
    m.output("f", f, unit="N", description="thrust that is expected of each thruster")
    m.output("saturation", 1.0 / scale, unit="1", description="1: tau_d is met; less: scaled by it")
    return m
