"""Ocean current: the relative velocity nu_r of the hull, a current that meanders, and its ramps.

A current v_c in `n` is uniform in space and does not rotate. Held constant over a step it still
accelerates in the rotating body frame:

    nu_c = (R^T v_c, 0),   d(nu_c)/dt = (-S(omega) R^T v_c, 0),   nu_r = nu - nu_c.

The term R^T dv_c/dt is left out: v_c is an input, and piecewise constant.
"""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip

__all__ = ["current_gauss_markov", "current_ramps", "nu_c", "nu_c_dot"]


def nu_c(Rnb: ca.SX, v_c: ca.SX) -> ca.SX:
    """Return nu_c (6) in `b` of the current v_c (3) [m/s] in `n`."""
    return ca.vertcat(ca.mtimes(Rnb.T, v_c), ca.SX.zeros(3))


def nu_c_dot(omega: ca.SX, v_c_b: ca.SX) -> ca.SX:
    """Return d(nu_c)/dt (6) in `b`, of omega [rad/s] and the current v_c_b (3) [m/s] in `b`."""
    return ca.vertcat(-ca.cross(omega, v_c_b), ca.SX.zeros(3))


def current_gauss_markov(
    speed: float = 0.2,
    direction: float = 0.5,
    sigma: float = 0.05,
    tau: float = 60.0,
    sigma_direction: float = 0.2,
    tau_direction: float = 120.0,
    period: str = "0.1",
) -> Model:
    """Speed and direction meander about their means, each a first-order Gauss-Markov process.

    x_{k+1} = phi x_k + sigma sqrt(1 - phi²) w_k,  phi = exp(-T / tau): exact for every T, so
    that the statistics do not depend on it. It starts in its stationary distribution.
    """
    m = Model("current_gauss_markov", "Water current that meanders (Gauss-Markov), in NED")
    T = float(Fraction(period))
    V = m.parameter("speed", speed, unit="m/s", description="mean speed of the water")
    beta = m.parameter(
        "direction", direction, unit="rad", description="mean direction it flows to, from N to E"
    )
    v_D = m.parameter("v_D", 0.0, unit="m/s", description="mean velocity downwards")
    s_V = m.parameter("sigma", sigma, unit="m/s", min=0, description="deviation of the speed")
    T_V = m.parameter("tau", tau, unit="s", min=1e-3, description="correlation time of the speed")
    s_b = m.parameter(
        "sigma_direction", sigma_direction, unit="rad", min=0, description="and of the direction"
    )
    T_b = m.parameter("tau_direction", tau_direction, unit="s", min=1e-3, description="its time")
    phi = m.derived("phi", ca.vertcat(ca.exp(-T / T_V), ca.exp(-T / T_b)))
    drive = m.derived(
        "drive", ca.sqrt(1.0 - ca.vertcat(ca.exp(-2 * T / T_V), ca.exp(-2 * T / T_b)))
    )

    sample = m.clock("sample", period)
    w = m.normal(sample, 2)
    started = m.discrete("started", unit="1", description="0 before the first sample")
    x = m.discrete("x", (0.0, 0.0), unit="1", description="deviations in units of their sigma")
    m.update(sample, x, ca.if_else(started > 0.5, phi * x + drive * w, w))
    m.update(sample, started, 1.0)

    U = V + s_V * x[0]
    angle = beta + s_b * x[1]
    m.output(
        "v_c",
        ca.vertcat(U * ca.cos(angle), U * ca.sin(angle), v_D),
        unit="m/s",
        description="velocity of the water in NED",
        discrete=True,
    )
    return m


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
