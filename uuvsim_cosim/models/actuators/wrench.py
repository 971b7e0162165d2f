"""The wrench: thrusts at their places become the generalised force on the hull."""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.vectors import TAU

__all__ = ["wrench"]


def wrench(vehicle: str = "bluerov2_heavy", contact: bool | str = False) -> Model:
    """Declare  tau = sum_i (e_i, r_i x e_i) thrust_i  about CO in b, without reaction torques.

    With `contact`, the input of that name is a generalised force in b that is added.
    """
    geometry = thruster_geometry(vehicle)
    n = len(geometry.names)
    m = Model("wrench", f"Generalised force of the {n} thrusters of {vehicle}")
    order = "; ".join(f"{i} {name}" for i, name in enumerate(geometry.names, 1))
    thrust = m.input("thrust", n, unit="N", description=f"of thruster {order}")
    current = m.input("current", n, unit="A", description="of each thruster")
    r = m.parameter("r", geometry.r, unit="m", description="positions from CO in b")
    e = m.parameter("e", geometry.e, unit="1", description="directions of positive thrust in b")
    T = m.derived(
        "T",
        ca.horzcat(*(ca.vertcat(e[i, :].T, ca.cross(r[i, :].T, e[i, :].T)) for i in range(n))),
    )
    tau = ca.mtimes(T, thrust)
    if is_on("contact", contact):
        tau += m.input("contact", 6, unit=TAU, description="of walls and floor, about CO in b")
    m.output("tau", tau, unit=TAU, description="X Y Z [N], K M N [N.m] in b")
    m.output("current_total", ca.sum1(current), unit="A", description="of all thrusters")
    return m
