"""Leak sensor: a probe at the bottom of a hull that floods through a hole, where it has one.

Water of volume V shares the hull with the air that it compresses,

    dV/dt = C_d A sqrt(2 max(p_out - p_in, 0) / rho),   p_in = p_atm V_air / (V_air - V),
    p_out = p_atm + rho g depth of the hole,

from t_leak on, and the probe is wet from V_probe on. It is the fault and its sensor in one: without
a hole (A = 0) the sensor stays dry.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import clip, safe_sqrt
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, validity_and_time

__all__ = ["leak"]


def leak(id: str = "sos", period: str = "0.1") -> Model:
    """Declare the leak sensor of a preset, read every `period` seconds."""
    p = preset("sensors", id, "leak")
    m = Model("leak", "Leak sensor, and the hole that it is there for")
    eta, q = hull_pose(m)
    r = m.parameter("r_hole", (0, 0, 0), unit="m", description="the hole from CO, body axes")
    A = m.parameter("A_hole", 0.0, unit="m2", min=0, description="area of the hole; 0: none")
    t_leak = m.parameter("t_leak", 0.0, unit="s", min=0, description="when it opens")
    C_d = m.parameter("C_d", 0.6, unit="1", min=0, max=1, description="of a sharp-edged hole")
    rho = m.parameter("rho", 1025.0, unit="kg/m3", min=1, description="density of the water")
    g = m.parameter("g", 9.81, unit="m/s2", min=0, description="acceleration of gravity")
    p_atm = m.parameter("p_atm", 101325.0, unit="Pa", min=1, description="air as it was sealed")
    V_air = p.parameter(m, "V_air", "m3", "air in the dry hull", min=1e-6)
    V_probe = p.parameter(m, "V_probe", "m3", "that wets the probe", min=0)
    V = m.state("V", unit="m3", description="water inside")
    depth = eta[2] + ca.dot(R(q)[2, :].T, r)
    p_in = p_atm * V_air / (V_air - clip(V, 0.0, 0.999 * V_air))
    p_out = p_atm + rho * g * clip(depth, 0.0, 12000.0)
    flow = C_d * A * safe_sqrt(2.0 * clip(p_out - p_in, 0.0, 1e9) / rho)
    m.der(V, ca.if_else(ca.logic_and(m.t >= t_leak, 0.999 * V_air > V), flow, 0.0 * flow))
    m.output("volume", V, unit="m3", description="water inside; the truth, not a reading")
    m.output("mass", rho * V, unit="kg", description="of that water")
    sample = m.clock("sample", period)
    wet = ca.logic_and(V > 0.0, V_probe <= V)
    held_output(m, sample, "leak", wet, unit="1", type="Boolean", description="the probe is wet")
    validity_and_time(m, sample)
    p.complete()
    return m
