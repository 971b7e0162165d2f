"""Trajectory through waypoints from rest to rest with least jerk.

Each leg turns first, then moves, both by the polynomial that minimises the integral of jerk²,

    s(x) = 10 x³ - 15 x⁴ + 6 x⁵,   x = (t - t_0) / T,   T = max(L / speed, sqrt(5.774 L / a))

whose largest rate is 1.875 / T and largest acceleration 5.774 / T² (Flash and Hogan 1985;
trajectory tracking: Fossen 2021, 2nd ed., chapter 12). It does not wait: a vehicle that lags is
behind, unlike `guidance`. The bow looks along the level part of a leg.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import atan2_or, clip, norm, safe_sqrt, wrap
from uuvsim_cosim.models.guidance.line_of_sight import declare_follower, declare_wanted, row_of

__all__ = ["trajectory"]

FIGURES = {
    "speed": ("m/s", "mean speed along a leg; its largest is 1.875 times it"),
    "acceleration": ("m/s2", "largest acceleration along a leg"),
    "r_max": ("rad/s", "mean yaw rate of a turn"),
    "r_dot_max": ("rad/s2", "largest yaw acceleration"),
}


def trajectory(
    id: str = "trajectory",
    period: str = "0.02",
    waypoints: Sequence[Sequence[float]] | None = None,
) -> Model:
    """Declare the trajectory of a preset; without waypoints, a lawn-mower pattern of four legs."""
    p = preset("controllers", id, "trajectory")
    m = Model("trajectory", "Trajectory of least jerk through waypoints, from rest to rest")
    eta, table, count, figure = declare_follower(
        m, p, FIGURES, waypoints, "estimate: where it begins, and no more"
    )
    sample = m.clock("sample", period)
    step = float(sample.period)
    started = m.discrete("started", unit="1")
    index = m.discrete("index", unit="1", description="of the waypoint ahead, from 0")
    A_k = m.discrete("A", (0, 0, 0), unit="m", description="where the leg began")
    psi_k = m.discrete("psi_A", unit="rad", description="heading with which it began")
    clock = m.discrete("clock", unit="s", description="since the leg began")
    done = m.discrete("done_held", unit="1")

    running = started > 0.5
    A = ca.if_else(running, A_k, eta[:3])
    psi_A = ca.if_else(running, psi_k, eta[5])
    B = row_of(table, index).T
    leg = B - A
    psi_B = ca.if_else(norm(leg[:2]) > 0.1, atan2_or(leg[1], leg[0], psi_A), psi_A)
    turn = wrap(psi_B - psi_A)
    T_turn = _duration(ca.fabs(turn), figure["r_max"], figure["r_dot_max"], step)
    T_move = _duration(norm(leg), figure["speed"], figure["acceleration"], step)
    s_psi, r = _least_jerk(clock, T_turn)
    s, rate = _least_jerk(clock - T_turn, T_move)
    psi = wrap(psi_A + turn * s_psi)
    v_n = leg * rate
    c, si = ca.cos(psi), ca.sin(psi)
    last = index >= count - 1
    over = clock >= T_turn + T_move
    onward = ca.logic_and(over, ca.logic_not(last))

    m.update(sample, started, 1.0)
    m.update(sample, index, ca.if_else(onward, index + 1.0, index))
    m.update(sample, A_k, ca.if_else(onward, B, A))
    m.update(sample, psi_k, ca.if_else(onward, psi_B, psi_A))
    m.update(sample, clock, ca.if_else(onward, 0.0, ca.if_else(over, clock, clock + step)))
    m.update(sample, done, ca.if_else(ca.logic_and(over, last), 1.0, done))
    nu_d = ca.vertcat(c * v_n[0] + si * v_n[1], c * v_n[1] - si * v_n[0], v_n[2], 0, 0, turn * r)
    declare_wanted(m, sample, ca.vertcat(A + leg * s, 0, 0, psi), nu_d, index, done)
    return m


def _duration(way: ca.SX, speed: ca.SX, acceleration: ca.SX, least: float) -> ca.SX:
    by_speed, by_force = way / speed, safe_sqrt(5.774 * way / acceleration)
    longer = ca.if_else(by_speed > by_force, by_speed, by_force)
    return ca.if_else(longer > least, longer, least)


def _least_jerk(t: ca.SX, T: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return s and ds/dt at t of 0 … T; at rest before and after."""
    x = clip(t / T, 0.0, 1.0)
    return x**3 * (10.0 + x * (6.0 * x - 15.0)), 30.0 * x * x * (1.0 - x) ** 2 / T
