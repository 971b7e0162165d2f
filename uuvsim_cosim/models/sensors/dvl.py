"""Doppler velocity log: four Janus beams over a flat bottom or a scene, and their velocity.

Beam i points along d_i = (sin t cos a_i, sin t sin a_i, cos t) in sensor axes, z down. It
measures the velocity of the sensor along itself, positive towards the bottom,

    v_i = d_i · R_bs^T (v + omega x r) + noise,   range_i = height / (R R_bs d_i)_z,

and is lost beyond its range, at flat incidence, or by chance. Over a scene a beam's range and
incidence are those of a ray along it; the layer of water track ends over the shortest of them.
Velocity solves
min sum_i valid_i (d_i · v - v_i)², given three beams or more.

Water track sees v - R_bs^T R^T v_c instead, where its layer below the sensor ends above 80 % of
the height. An aperiodic DVL pings again when the last echo has come back,

    t_next = t + min(max(2 range / c, T_min), T_max),   T_max without an echo,

at the first tick of the clock from then on.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.safe_math import abs_, clip
from uuvsim_cosim.models.declaration.sampled import held_output, only_when, sample_time
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.hull.coriolis import inverse
from uuvsim_cosim.models.sensors.mounting import Pose, mounting
from uuvsim_cosim.models.sensors.sensor_error import uniform
from uuvsim_cosim.models.worlds.rays import declare_others, rays

__all__ = ["beam_directions", "dvl"]


def beam_directions(tilt: ca.SX, azimuth: ca.SX) -> ca.SX:
    """Return D (3, n): unit vectors of the beams in sensor axes; angles in rad."""
    return ca.horzcat(
        *(
            ca.vertcat(
                ca.sin(tilt) * ca.cos(azimuth[i]), ca.sin(tilt) * ca.sin(azimuth[i]), ca.cos(tilt)
            )
            for i in range(4)
        )
    )


def dvl(
    id: str = "a50_class",
    period: str = "0.2",
    track: str = "bottom",
    aperiodic: bool | str = False,
    scene: str = "",
    others: int | str = 0,
) -> Model:
    """Declare the DVL of a preset, which pings every `period` seconds.

    With `track` "both" it has water track as well, and an input `v_c`. With `aperiodic` its pings
    follow the range, and `period` is what their instants are rounded up to: "0.01", say. With a
    `scene` it ranges over that instead of a plane, and sees `others` further vehicles.
    """
    if track not in ("bottom", "both"):
        raise ParameterInvalid("dvl", f"track = {track!r}", "bottom or both")
    p = preset("sensors", id, "dvl")
    over = "scene" if scene else "flat bottom"
    m = Model("dvl", f"Doppler velocity log: four beams, bottom track over a {over}")
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    nu = m.input("nu", 6, unit=NU, description="of CO in b [m/s, rad/s]")
    if not scene:
        bottom = m.parameter("bottom_depth", 25.0, unit="m", description="depth of the flat bottom")
    tilt = m.parameter("tilt", p.number("tilt", "rad"), unit="rad", description="beam from axis")
    azimuth = m.parameter(
        "azimuth", p.vector("azimuth", "rad", 4), unit="rad", description="of each beam"
    )
    r, R_bs = mounting(m, Pose(p.vector("r_s", "m", 3), p.vector("Theta_s", "rad", 3)))
    D = m.derived("D", beam_directions(tilt, azimuth))

    ping = m.clock("ping", period)
    v_s = ca.mtimes(R_bs.T, nu[:3] + ca.cross(nu[3:], r))
    Rnb = R(q)
    down = ca.mtimes(D.T, ca.mtimes(R_bs.T, Rnb[2, :].T))  # (R R_bs d_i)_z
    seen: ca.SX | None = None
    if scene:
        moving = declare_others(m, others)
        d = ca.mtimes(ca.mtimes(Rnb, R_bs), D)
        head = ca.vertcat(eta[:3] + ca.mtimes(Rnb, r), 1e4, moving, ca.vec(d))
        seen = rays(scene, 4, moving.numel() // 10)(head)
        height = down * seen[:4]  # of each beam; negative where it meets nothing
    else:
        height = bottom - eta[2] - ca.dot(Rnb[2, :].T, r)
    velocity, distance, ok = _beams(m, ping, p, ca.mtimes(D.T, v_s), down, height, seen)
    if scene:
        height = ca.mmin(height)

    held_output(
        m, ping, "beam_velocity", velocity, unit="m/s", start=(0,) * 4, description="along beams"
    )
    held_output(m, ping, "range", distance, unit="m", description="along each beam")
    held_output(m, ping, "beam_valid", ok, unit="1", description="1: a bottom echo; 0: none")
    enough = ca.sum1(ok) > 2.5
    v_b = ca.mtimes(R_bs, _least_squares(D, velocity, ok))
    last = m.discrete("velocity_held", (0, 0, 0), unit="m/s")
    m.update(ping, last, ca.if_else(enough, v_b, last))
    m.output(
        "velocity", last, unit="m/s", description="of the DVL itself, body axes", discrete=True
    )
    altitude = m.discrete("altitude_held", unit="m")
    count = ca.if_else(enough, ca.sum1(ok), 1.0)
    mean = ca.cos(tilt) * ca.sum1(ok * distance) / count
    m.update(ping, altitude, ca.if_else(enough, mean, altitude))
    m.output(
        "altitude", altitude, unit="m", description="along the DVL's axis, mean of valid beams",
        discrete=True,
    )  # fmt: skip
    held_output(
        m, ping, "valid", enough, unit="1", type="Boolean", description="three beams or more"
    )
    sample_time(m, ping)
    if track == "both":
        _water_track(m, ping, p, D, R_bs, ca.mtimes(Rnb, R_bs), v_s, height)
    if aperiodic not in (False, "false", "False", "0"):
        _ping_again(m, ping, p, distance, enough)
    p.complete(optional=("sigma_water", "layer", "period_min", "period_max"))
    return m


def _water_track(
    m: Model, ping: Clock, p: Preset, D: ca.SX, R_bs: ca.SX, R_ns: ca.SX, v: ca.SX, height: ca.SX
) -> None:
    """Declare the velocity through the water in a layer below the sensor."""
    v_c = m.input("v_c", 3, unit="m/s", description="current in n, taken as that of the layer")
    sigma = m.parameter(
        "sigma_water",
        p.number("sigma_water", "m/s"),
        unit="m/s",
        min=0,
        description="noise of a beam in water track",
    )
    layer = m.parameter(
        "layer", p.vector("layer", "m", 2), unit="m", min=0, description="begin and end, below"
    )
    beams = ca.mtimes(D.T, v - ca.mtimes(R_ns.T, v_c)) + sigma * m.normal(ping, 4)
    there = ca.logic_and(height > 0.0, layer[1] <= 0.8 * height)
    through = ca.mtimes(R_bs, _least_squares(D, beams, ca.SX.ones(4)))
    last = m.discrete("velocity_water_held", (0, 0, 0), unit="m/s")
    m.update(ping, last, ca.if_else(there, through, last))
    m.output(
        "velocity_water", last, unit="m/s", description="through the water, body axes",
        discrete=True,
    )  # fmt: skip
    held_output(
        m, ping, "valid_water", there, unit="1", type="Boolean", description="the layer is clear"
    )


def _ping_again(m: Model, ping: Clock, p: Preset, distance: ca.SX, heard: ca.SX) -> None:
    """Let pings happen only when the last one's echo has come back."""
    low = m.parameter(
        "period_min",
        p.number("period_min", "s"),
        unit="s",
        min=1e-3,
        description="from ping to ping, near the bottom",
    )
    high = m.parameter(
        "period_max",
        p.number("period_max", "s"),
        unit="s",
        min=1e-3,
        description="from ping to ping at the longest range, and without an echo",
    )
    c = m.parameter("c", 1500.0, unit="m/s", min=1.0, description="speed of sound")
    following = m.discrete("t_next", unit="s", description="earliest instant of the next ping")
    farthest = distance[0]
    for i in range(1, 4):
        farthest = ca.if_else(distance[i] > farthest, distance[i], farthest)
    wait = ca.if_else(heard, clip(2.0 * farthest / c, low, high), high)
    m.update(ping, following, m.t + wait)
    only_when(ping, m.t >= following - 1e-9)


def _beams(
    m: Model, ping: Clock, p: Preset, v: ca.SX, down: ca.SX, height: ca.SX, seen: ca.SX | None
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return each beam's velocity, range, and 1 where it has an echo, all with noise.

    `seen` are the ranges and the cosines of the incidence over a scene, None over a plane.
    """
    sigma_v = m.parameter(
        "sigma_v", p.number("sigma_v", "m/s"), unit="m/s", min=0, description="noise of a beam"
    )
    relative = m.parameter(
        "sigma_v_relative",
        p.number("sigma_v_relative", "1"),
        unit="1",
        min=0,
        description="and its part that grows with the beam's velocity",
    )
    sigma_r = m.parameter(
        "sigma_range", p.number("sigma_range", "m"), unit="m", min=0, description="range noise"
    )
    low = m.parameter(
        "range_min", p.number("range_min", "m"), unit="m", min=0, description="of a beam"
    )
    high = m.parameter(
        "range_max", p.number("range_max", "m"), unit="m", min=0, description="of a beam"
    )
    incidence = m.parameter(
        "incidence_max",
        p.number("incidence_max", "rad"),
        unit="rad",
        min=0,
        max=1.5707,
        description="of a beam on the bottom, from its normal",
    )
    lost = m.parameter(
        "dropout", p.number("dropout", "1"), unit="1", min=0, max=1, description="by chance"
    )
    w = m.normal(ping, 8)
    if seen is None:
        steep = down > ca.cos(incidence)
        distance = ca.if_else(steep, height / ca.if_else(steep, down, 1.0), 0.0)
    else:
        steep = seen[4:] > ca.cos(incidence)
        distance = ca.if_else(ca.logic_and(steep, seen[:4] > 0.0), seen[:4], 0.0)
    heard = ca.logic_and(distance >= low, distance <= high)
    ok = ca.logic_and(ca.logic_and(steep, heard), uniform(m, ping, 4) >= lost)
    velocity = v + ca.sqrt(sigma_v**2 + (relative * v) ** 2 + 1e-30) * w[:4]
    zero = ca.SX.zeros(4)
    return (
        ca.if_else(ok, velocity, zero),
        ca.if_else(ok, abs_(distance + sigma_r * w[4:]), zero),
        ca.if_else(ok, zero + 1.0, zero),
    )


def _least_squares(D: ca.SX, v: ca.SX, ok: ca.SX) -> ca.SX:
    """Solve for the velocity (3) of the valid beams; a ridge of 1e-9 keeps it finite."""
    weighted = ca.mtimes(D, ca.diag(ok))
    normal = ca.mtimes(weighted, D.T) + 1e-9 * ca.SX.eye(3)
    return ca.mtimes(inverse(normal), ca.mtimes(weighted, v))
