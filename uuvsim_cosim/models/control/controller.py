"""PID in six degrees of freedom with feed-forward, integrals held in NED, and anti-windup.

    tau = Kp e + z + Kd (nu_d - nu) + M nu_d_dot + C(nu_d) nu_d + D_l nu_d + D_q |nu_d| nu_d

e is the error of eta in body axes, nu_d is turned into them: so C(nu_d) nu_d counters the Munk
moment of a hull that tilts while it moves. The force integral lives in NED, because a
current's push keeps its direction there while the vehicle turns; its limit, and
back-calculation from the saturated tau, stop it from winding up.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.angle import wrap
from uuvsim_cosim.models.declaration.kinematics import R_zyx
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA, INERTIA, NU, NU_DOT, TAU, per
from uuvsim_cosim.models.hull.coriolis import coriolis
from uuvsim_cosim.models.hull.matrices import nominal

__all__ = ["attitude_error", "controller"]


def controller(
    id: str = "bluerov2_pid", vehicle: str = "bluerov2_heavy", period: str = "0.02"
) -> Model:
    """Declare the PID of a preset, with the feed-forward of a vehicle's nominal parameters."""
    p = preset("controllers", id, "controller")
    mass, linear, quadratic = nominal(vehicle)
    m = Model("controller", "PID in six degrees of freedom with feed-forward")
    eta_d = m.input("eta_d", 6, unit=ETA, description="wanted N E D phi theta psi")
    nu_d = m.input("nu_d", 6, unit=NU, description="wanted, in axes of eta_d")
    eta = m.input("eta", 6, unit=ETA, description="estimate of N E D phi theta psi")
    nu = m.input("nu", 6, unit=NU, description="estimate, in b")
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
    M = m.parameter("M_ff", mass, unit=INERTIA, description="diagonal of M_RB + M_A")
    D_l = m.parameter(
        "D_l_ff", linear, unit=per("N.s/m", "N.m.s/rad"), description="linear damping, diagonal"
    )
    D_q = m.parameter(
        "D_q_ff",
        quadratic,
        unit=per("N.s2/m2", "N.m.s2/rad2"),
        description="quadratic damping, diagonal",
    )
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


def attitude_error(eta: ca.SX, eta_d: ca.SX) -> ca.SX:
    """Return the attitude error in body axes: T(Theta)^-1 (Theta_d - Theta), shortest way."""
    d = wrap(eta_d[3:] - eta[3:])
    phi, theta = eta[3], eta[4]
    return ca.vertcat(
        d[0] - ca.sin(theta) * d[2],
        ca.cos(phi) * d[1] + ca.cos(theta) * ca.sin(phi) * d[2],
        -ca.sin(phi) * d[1] + ca.cos(theta) * ca.cos(phi) * d[2],
    )
