"""Disturbances at known times: a current that steps or ramps, thrusters that grow weak."""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip

__all__ = ["current_ramps", "thruster_faults"]


def current_ramps(events: int | str = 3) -> Model:
    """Add ramps to a current:  v_c = v + sum_k dv_k clip((t - t_k) / T_k, 0, 1).

    A T_k that is shorter than a communication step makes a step.
    """
    n = int(events)
    m = Model("current_ramps", f"Current with {n} ramps or steps on top, in NED")
    v = m.input("v", 3, unit="m/s", description="current without them, in n")
    dv = m.parameter("dv", ca.DM.zeros(n, 3).full(), unit="m/s", description="each one's rise in n")
    t = m.parameter("t", (0.0,) * n, (n,), unit="s", description="when each begins")
    T = m.parameter("T", (1.0,) * n, (n,), unit="s", min=1e-6, description="how long each lasts")
    rise = sum(dv[k, :].T * clip((m.t - t[k]) / T[k], 0.0, 1.0) for k in range(n))
    m.output("v_c", v + rise, unit="m/s", description="velocity of the water in NED")
    return m


def thruster_faults(thrusters: int | str = 8) -> Model:
    """Weaken thrusters:  thrust_i = e_i thrust_in_i  from t_i on, and thrust_in_i before."""
    n = int(thrusters)
    m = Model("thruster_faults", f"{n} thrusters, each of which may grow weak or fail")
    given = m.input("thrust_in", n, unit="N", description="as healthy thrusters give it")
    e = m.parameter(
        "efficiency", (1.0,) * n, (n,), unit="1", min=0, max=2, description="0: fails; 1: whole"
    )
    t = m.parameter("t", (0.0,) * n, (n,), unit="s", description="when each changes")
    now = ca.vertcat(*(ca.if_else(m.t >= t[i], e[i], 1.0) for i in range(n)))
    m.output("thrust", now * given, unit="N", description="as it reaches the hull")
    m.output("health", now, unit="1", description="share of the thrust that is left")
    return m
