"""A target that moves at constant speed and depth within an arena, and is reflected at its walls.

    p <- p + T V (cos psi, sin psi),   psi <- psi + T r

`motion` selects the source of the yaw rate r: ``random_heading``, a Gauss-Markov process;
``flee``, away from the nearest tracker and from walls, wandering while none is near; ``path``,
towards one waypoint after the other, in a loop. At a wall, or an obstacle, the heading is
mirrored. The speed is V at every instant.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.safe_math import atan2_or, clip, norm, saturate, wrap
from uuvsim_cosim.models.declaration.vectors import ETA
from uuvsim_cosim.models.hull.pool import declare_arena

__all__ = ["MOTIONS", "target"]

MOTIONS = ("random_heading", "flee", "path")
WAYPOINTS = 16
TURN_GAIN = 4.0  # rad/s of yaw rate for a radian of heading error, before r_max


def target(
    motion: str = "random_heading",
    trackers: int | str = 1,
    obstacles: int | str = 0,
    period: str = "0.02",
    heading_period: str = "0.1",
) -> Model:
    """Declare a target; `trackers` is the number of those that it flees from."""
    if motion not in MOTIONS:
        raise ParameterInvalid("target", f"motion {motion!r}", f"one of {', '.join(MOTIONS)}")
    m = Model("target", f"Target of constant speed and depth ({motion.replace('_', ' ')})")
    V = m.parameter("speed", 0.15, unit="m/s", min=0, description="of the target")
    p_0 = m.parameter("position_0", (0, 0, 0.55), unit="m", description="at the start, in NED")
    psi_0 = m.parameter("psi_0", 0.0, unit="rad", description="heading at the start")
    margin = m.parameter("margin", 0.2, unit="m", min=0, description="kept from the walls")
    origin, size, cylinders = declare_arena(m, int(obstacles))
    room = 0.5 * size[:2] - margin
    room = ca.if_else(room > 0.0, room, 0.0)
    steer = m.clock("steer", heading_period)
    move = m.clock("move", period)
    T = float(move.period)

    p = m.discrete("p", p_0[:2], unit="m", description="N, E")
    psi = m.discrete("psi", wrap(psi_0), unit="rad", description="heading")
    if motion == "path":
        r = _towards_waypoints(m, move, p, psi, V * T)
    else:
        r = _wander(m, steer)
        if motion == "flee":
            r = _flee(m, int(trackers), p - origin[:2], room, psi, r, origin)

    heading = psi + T * r
    ahead = p - origin[:2] + T * V * ca.vertcat(ca.cos(heading), ca.sin(heading))
    for x, y, width, _ in cylinders:
        away = ahead - (ca.vertcat(x, y) - origin[:2])
        normal = atan2_or(away[1], away[0], 0.0)
        inward = ca.logic_and(norm(away) < width + margin, ca.cos(heading - normal) < 0.0)
        inward = ca.logic_and(inward, width > 0.0)
        heading = ca.if_else(inward, math.pi + 2.0 * normal - heading, heading)
    if cylinders:
        ahead = p - origin[:2] + T * V * ca.vertcat(ca.cos(heading), ca.sin(heading))
    beyond = ca.fabs(ahead) > room
    inside = ca.if_else(ahead > 0.0, 2.0 * room - ahead, -2.0 * room - ahead)
    inside = ca.if_else(beyond, inside, ahead)
    heading = ca.if_else(_leaves(beyond[0], ahead[0], ca.cos(heading)), math.pi - heading, heading)
    heading = ca.if_else(_leaves(beyond[1], ahead[1], ca.sin(heading)), -heading, heading)
    m.update(move, p, origin[:2] + saturate(inside, room))
    m.update(move, psi, wrap(heading))

    position = ca.vertcat(p, p_0[2])
    velocity = ca.vertcat(V * ca.cos(psi), V * ca.sin(psi), 0.0)
    m.output("position", position, unit="m", discrete=True, description="in NED")
    m.output("velocity", velocity, unit="m/s", discrete=True, description="in NED")
    m.output(
        "eta",
        ca.vertcat(position, 0.0, 0.0, psi),
        unit=ETA,
        discrete=True,
        description="N E D [m], phi theta psi [rad]",
    )
    return m


def _leaves(beyond: ca.SX, ahead: ca.SX, direction: ca.SX) -> ca.SX:
    return ca.logic_and(beyond, ahead * direction > 0.0)


def _wander(m: Model, clock: Clock) -> ca.SX:
    """Return a yaw rate that wanders: Gauss-Markov, stationary from the start."""
    sigma = m.parameter("sigma_r", 0.4, unit="rad/s", min=0, description="deviation of yaw rate")
    tau = m.parameter("tau_r", 2.0, unit="s", min=1e-3, description="its correlation time")
    T = float(clock.period)
    phi = m.derived("phi", ca.exp(-T / tau))
    drive = m.derived("drive", ca.sqrt(1.0 - ca.exp(-2.0 * T / tau)))
    started = m.discrete("started", unit="1", description="0 before the first sample")
    x = m.discrete("x", unit="1", description="yaw rate over its deviation")
    w = m.normal(clock)
    m.update(clock, x, ca.if_else(started > 0.5, phi * x + drive * w, w))
    m.update(clock, started, 1.0)
    return sigma * x


def _flee(
    m: Model, n: int, p: ca.SX, room: ca.SX, psi: ca.SX, wandering: ca.SX, origin: ca.SX
) -> ca.SX:
    """Return the yaw rate that turns away from the nearest tracker, and from walls."""
    if not 1 <= n <= 8:
        raise ParameterInvalid("target", f"{n} trackers", "1 to 8")
    fright = m.parameter("fright", 1.2, unit="m", min=0, description="flees within this distance")
    shy = m.parameter("shy", 0.5, unit="m", min=1e-3, description="turns from walls within this")
    r_max = _r_max(m)
    nearest, distance = ca.SX.zeros(2), ca.SX(1e9)
    for i in range(1, n + 1):
        other = m.input(f"tracker_{i}", 3, unit="m", description="position in NED")
        away = p - (other[:2] - origin[:2])
        d = norm(away)
        closer = d < distance
        nearest = ca.if_else(closer, away, nearest)
        distance = ca.if_else(closer, d, distance)
    walls = clip(1.0 - (room + p) / shy, 0.0, 1.0) - clip(1.0 - (room - p) / shy, 0.0, 1.0)
    wanted = nearest / ca.if_else(distance > 1e-6, distance, 1.0) + 1.5 * walls
    psi_d = atan2_or(wanted[1], wanted[0], psi)
    return ca.if_else(distance < fright, saturate(TURN_GAIN * wrap(psi_d - psi), r_max), wandering)


def _towards_waypoints(m: Model, clock: Clock, p: ca.SX, psi: ca.SX, stride: ca.SX) -> ca.SX:
    """Return the yaw rate that leads to the next waypoint, and count those that are reached."""
    points = m.parameter(
        "waypoints",
        np.zeros((WAYPOINTS, 2)),
        unit="m",
        description="N and E, flown again and again",
    )
    count = m.parameter(
        "count", 1, unit="1", type="Int32", min=1, max=WAYPOINTS, description="of waypoints meant"
    )
    radius = m.parameter("radius", 0.2, unit="m", min=0, description="a waypoint counts as reached")
    r_max = _r_max(m)
    at = m.discrete("at", unit="1", description="waypoint ahead, from 0")
    ahead = points[0, :].T
    for i in range(1, WAYPOINTS):
        ahead = ca.if_else(ca.fabs(at - i) < 0.5, points[i, :].T, ahead)
    away = ahead - p
    following = ca.if_else(at + 1.5 > count, 0.0, at + 1.0)
    m.update(clock, at, ca.if_else(norm(away) < radius + stride, following, at))
    psi_d = atan2_or(away[1], away[0], psi)
    return saturate(TURN_GAIN * wrap(psi_d - psi), r_max)


def _r_max(m: Model) -> ca.SX:
    return m.parameter("r_max", 1.0, unit="rad/s", min=0, description="limit of the yaw rate")
