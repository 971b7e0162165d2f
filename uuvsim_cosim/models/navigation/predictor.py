"""Predictor of the position of a moving object from late, rare and noisy fixes.

A Kalman filter of constant velocity, the same for N and E, driven by white acceleration of density
q. A position is new when its sample time t_s has changed; over the time T since the last one

    P <- F P F' + q [T³/3, T²/2; T²/2, T],   F = [1, T; 0, 1],
    k = P_1 / (P_11 + sigma²),  x <- F x + k (z - x_1),  P <- P - k P_1'

and the output at any time t is  x_1 + (t - t_s) x_2,  with t - t_s at most `age_max`. For D, the
last position holds. A position beyond `gate` standard deviations is accepted and restarts the
velocity estimate.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip, norm
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST

__all__ = ["predictor"]


def predictor(period: str = "0.02") -> Model:
    """Declare the filter, which looks for a new position every `period` seconds."""
    m = Model("predictor", "Kalman filter that carries late positions of a target on to now")
    z = m.input("position", 3, unit="m", description="that came last, in NED")
    t_s = m.input("t_sample", unit="s", start=BEFORE_FIRST, description="of it; -1: none yet")
    p_0 = m.parameter("position_0", (0, 0, 0), unit="m", description="shown before the first one")
    sigma = m.parameter("sigma", 0.007, unit="m", min=1e-6, description="deviation of N and of E")
    # A target at 0.15 m/s whose yaw rate wanders by 0.4 rad/s for 2 s at a time.
    q = m.parameter("q", 0.0144, unit="m2/s3", min=0, description="density of acceleration")
    v_0 = m.parameter("v_0", 0.15, unit="m/s", min=0, description="deviation of the first velocity")
    age_max = m.parameter("age_max", 2.0, unit="s", min=0, description="it is carried on for")
    gate = m.parameter("gate", 6.0, unit="1", min=1, description="deviations that are believed")

    p = m.discrete("p", p_0, unit="m", description="filtered, at the last sample time")
    v = m.discrete("v", (0, 0), unit="m/s", description="velocity N, E")
    P = m.discrete("P", (0, 0, 0), unit="1", description="P_11, P_12, P_22")
    t_k = m.discrete("t_k", BEFORE_FIRST, unit="s", description="the last sample time")
    look = m.clock("look", period)

    new = t_s > t_k + 1e-9
    first = t_k < 0.0
    T = ca.if_else(first, 0.0, t_s - t_k)
    P_11 = P[0] + 2.0 * T * P[1] + T**2 * P[2] + q * T**3 / 3.0
    P_12 = P[1] + T * P[2] + q * T**2 / 2.0
    P_22 = P[2] + q * T
    expected = p[:2] + T * v
    innovation = z[:2] - expected
    S = P_11 + sigma**2
    lost = ca.logic_or(first, norm(innovation) ** 2 > gate**2 * S)
    k = ca.vertcat(P_11, P_12) / S
    values: tuple[tuple[ca.SX, ca.SX, ca.SX], ...] = (
        (p, ca.vertcat(expected + k[0] * innovation, z[2]), z),
        (v, v + k[1] * innovation, ca.SX.zeros(2)),
        (
            P,
            ca.vertcat(P_11 - k[0] * P_11, P_12 - k[0] * P_12, P_22 - k[1] * P_12),
            ca.vertcat(sigma**2, 0.0, v_0**2),
        ),
    )
    for state, filtered, begun in values:
        m.update(look, state, ca.if_else(new, ca.if_else(lost, begun, filtered), state))
    m.update(look, t_k, ca.if_else(new, t_s, t_k))

    age = ca.if_else(t_k < 0.0, 0.0, clip(m.t - t_k, 0.0, age_max))
    now = ca.vertcat(p[:2] + age * v, p[2])
    m.output("now", now, unit="m", description="position now, in NED")
    m.output("velocity", ca.vertcat(v, 0.0), unit="m/s", discrete=True, description="in NED")
    m.output("age", age, unit="s", description="of the last position")
    return m
