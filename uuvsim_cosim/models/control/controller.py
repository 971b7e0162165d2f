"""PID in six degrees of freedom with feed-forward, integrals held in NED, and anti-windup.

    tau = Kp e + z + Kd (nu_d - nu) + M nu_d_dot + C(nu_d) nu_d + D_l nu_d + D_q |nu_d| nu_d

e is the error of eta in body axes, nu_d is turned into them: so C(nu_d) nu_d counters the Munk
moment of a hull that tilts while it moves. The force integral lives in NED, because a
current's push keeps its direction there while the vehicle turns; its limit, and
back-calculation from the saturated tau, stop it from winding up.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.control.control_law import attitude_error, feed_forward, loop_inputs
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import NU, NU_DOT, TAU, per
from uuvsim_cosim.models.hull.coriolis import coriolis

__all__ = ["controller"]


def controller(
    id: str = "bluerov2_pid", vehicle: str = "bluerov2_heavy", period: str = "0.02"
) -> Model:
    """Declare the PID of a preset, with the feed-forward of a vehicle's nominal parameters."""
    p = preset("controllers", id, "controller")
    m = Model("controller", "PID in six degrees of freedom with feed-forward")
    eta_d, nu_d, eta, nu = loop_inputs(m)
    gain = {
        name: p.parameter(m, name, unit, about, 6, min=0)
        for name, unit, about in (
            ("Kp", per("N/m", "N.m/rad"), "of the error of eta"),
            ("Ki", per("N/m/s", "N.m/rad/s"), "of its integral"),
            ("Kd", per("N.s/m", "N.m.s/rad"), "of the error of nu"),
            ("tau_max", TAU, "limit of tau_d"),
            ("tau_i_max", TAU, "limit of the integrals"),
        )
    }
    M, D_l, D_q = feed_forward(m, vehicle)
    T_ff = p.parameter(m, "T_ff", "s", "lag of M_ff", min=1e-3)
    sample = m.clock("sample", period)
    T = float(sample.period)

    R = R_zyx(eta[3], eta[4], eta[5])
    R_d = R_zyx(eta_d[3], eta_d[4], eta_d[5])
    error = ca.vertcat(ca.mtimes(R.T, eta_d[:3] - eta[:3]), attitude_error(eta, eta_d))
    nu_b = ca.vertcat(
        ca.mtimes(R.T, ca.mtimes(R_d, nu_d[:3])), ca.mtimes(R.T, ca.mtimes(R_d, nu_d[3:]))
    )

    started = m.discrete("started", unit="1")
    before = m.discrete("nu_d_before", (0,) * 6, unit=NU)
    nu_d_dot = m.discrete("nu_d_dot", (0,) * 6, unit=NU_DOT, description="smoothed")
    z = m.discrete("z", (0,) * 6, unit=TAU, description="integrals: force in n, moment in b")
    blend = T / (T_ff + T)
    slope = ca.if_else(started > 0.5, (nu_d - before) / T, ca.SX.zeros(6))
    acceleration = nu_d_dot + blend * (slope - nu_d_dot)

    def in_body(x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.mtimes(R.T, x[:3]), x[3:])

    def in_ned(x: ca.SX) -> ca.SX:
        return ca.vertcat(ca.mtimes(R, x[:3]), x[3:])

    tau = (
        gain["Kp"] * error
        + in_body(z)
        + gain["Kd"] * (nu_b - nu)
        + M * acceleration
        + D_l * nu_b
        + D_q * abs_(nu_b) * nu_b
        + coriolis(ca.diag(M), nu_b)
    )
    tau_d = saturate(tau, gain["tau_max"])
    tracking = gain["Ki"] / (gain["Kp"] + 1e-9) * (tau_d - tau)
    grown = z + T * in_ned(gain["Ki"] * error + tracking)
    m.update(sample, started, 1.0)
    m.update(sample, before, nu_d)
    m.update(sample, nu_d_dot, acceleration)
    m.update(sample, z, saturate(grown, gain["tau_i_max"]))
    held_output(
        m, sample, "tau_d", tau_d, unit=TAU, start=(0,) * 6, description="X Y Z [N], K M N [N.m]"
    )
    return m
