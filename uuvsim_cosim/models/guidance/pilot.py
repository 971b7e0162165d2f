"""Pilot: a policy's surge acceleration and yaw rate become a force.

At every sample of period T, with M and D the diagonals of the vehicle's own figures:

    u_d <- clip(u_d + T a, u_max),                  a' = what that changed, over T
    r_d <- r_d + T k_r (omega - r_d)
    X = M_11 (a' + k_u (u_d - u) + z_u) + D_11(u_d) u_d
    Y = M_11 u_d r_d - M_22 k_v v                   what a turn needs; sway is damped
    Z = M_33 (w_z² (depth - D) - 2 zeta w_z w + z_D)
    K = M_44 (-w_trim² phi - 2 zeta w_trim p),      M alike
    N = M_66 (dr_d/dt + k_r (r_d - r) + z_r) + D_66(r_d) r_d

z are limited integrals. A policy therefore drives a vehicle with its lags and limits, not a point.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from uuvsim_cosim.models.control.control_law import feed_forward
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.declaration.vectors import ETA, NU, TAU

__all__ = ["Wanted", "declare_pilot", "pilot"]

# Of the clock, the parameters by name and u_d: the surge acceleration and yaw rate wanted.
Wanted = Callable[[Clock, dict[str, ca.SX], ca.SX], tuple[ca.SX, ca.SX]]

NUMBERS = (
    ("u_max", "m/s", "limit of the wanted surge speed, either way"),
    ("a_max", "m/s2", "limit of a"),
    ("omega_max", "rad/s", "limit of omega"),
    ("k_u", "1/s", "bandwidth of surge speed"),
    ("k_v", "1/s", "bandwidth of sway damping"),
    ("k_r", "1/s", "bandwidth of yaw rate"),
    ("k_i", "1/s", "rate of the integrals"),
    ("w_z", "rad/s", "natural frequency of depth"),
    ("w_trim", "rad/s", "natural frequency of roll and pitch"),
    ("zeta", "1", "damping ratio of depth, roll and pitch"),
)
INTEGRALS = ("m/s2", "m/s2", "rad/s2")


def pilot(id: str = "tracking_pilot", vehicle: str = "pool8", period: str = "0.02") -> Model:
    """Declare the pilot of a preset, with the nominal figures of a vehicle."""
    m = Model("pilot", "Surge acceleration and yaw rate become a generalised force")
    a = m.input("a", unit="m/s2", description="wanted surge acceleration; beyond a_max: a_max")
    omega = m.input("omega", unit="rad/s", description="wanted yaw rate; beyond: omega_max")
    eta = m.input("eta", 6, unit=ETA, description="estimate of N E D phi theta psi")
    nu = m.input("nu", 6, unit=NU, description="estimate, in b")
    declare_pilot(m, id, vehicle, period, eta, nu, lambda *_: (a, omega))
    return m


def declare_pilot(
    m: Model, id: str, vehicle: str, period: str, eta: ca.SX, nu: ca.SX, wanted: Wanted
) -> None:
    """Declare all of a pilot but its inputs: at each sample it follows what `wanted` gives."""
    preset_ = preset("controllers", id, "pilot")
    p = {name: preset_.parameter(m, name, unit, words, min=0) for name, unit, words in NUMBERS}
    depth = m.parameter("depth", 0.5, unit="m", description="D to keep")
    i_max = preset_.parameter(
        m, "i_max", INTEGRALS, "limits of the integrals of surge, depth and yaw rate", 3, min=0
    )
    M, D_l, D_q = feed_forward(m, vehicle)
    sample = m.clock("sample", period)
    T = float(sample.period)

    def drag(i: int, x: ca.SX) -> ca.SX:
        return (D_l[i] + D_q[i] * abs_(x)) * x

    before = m.discrete("u_d", unit="m/s", description="wanted surge speed")
    turning = m.discrete("r_d", unit="rad/s", description="wanted yaw rate, smoothed")
    z = m.discrete("z", (0,) * 3, unit=INTEGRALS, description="integrals")
    a, omega = wanted(sample, p, before)
    u_d = saturate(before + T * saturate(a, p["a_max"]), p["u_max"])
    r_d_dot = p["k_r"] * (saturate(omega, p["omega_max"]) - turning)
    r_d = turning + T * r_d_dot
    e = ca.vertcat(
        p["k_u"] * (u_d - nu[0]), p["w_z"] ** 2 * (depth - eta[2]), p["k_r"] * (r_d - nu[5])
    )
    trim = -(p["w_trim"] ** 2) * eta[3:5] - 2.0 * p["zeta"] * p["w_trim"] * nu[3:5]
    tau_d = ca.vertcat(
        M[0] * ((u_d - before) / T + e[0] + z[0]) + drag(0, u_d),
        M[0] * u_d * r_d - M[1] * p["k_v"] * nu[1],
        M[2] * (e[1] - 2.0 * p["zeta"] * p["w_z"] * nu[2] + z[1]),
        M[3:5] * trim,
        M[5] * (r_d_dot + e[2] + z[2]) + drag(5, r_d),
    )
    m.update(sample, before, u_d)
    m.update(sample, turning, r_d)
    m.update(sample, z, saturate(z + T * p["k_i"] * e, i_max))
    held_output(
        m, sample, "tau_d", tau_d, unit=TAU, start=(0,) * 6, description="X Y Z [N], K M N [N.m]"
    )
    nu_d = ca.vertcat(before, ca.SX.zeros(4), turning)
    m.output("nu_d", nu_d, unit=NU, discrete=True, description="what is followed, in b")
