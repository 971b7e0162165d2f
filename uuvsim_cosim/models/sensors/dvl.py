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
from uuvsim_cosim.models.declaration.model import Clock, Model, is_on
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.safe_math import abs_, clip
from uuvsim_cosim.models.declaration.sampled import held_output, only_when
from uuvsim_cosim.models.declaration.vectors import NU
from uuvsim_cosim.models.hull.coriolis import inverse
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, output_when, validity_and_time
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

    With `track` "both", it also has water track and an input `v_c`. With `aperiodic`, the ping
    interval follows the range, and the instants are rounded up to multiples of `period`, for
    example "0.01". With a `scene`, it measures ranges to the scene instead of a plane, and to
    `others` further vehicles.
    """
    if track not in ("bottom", "both"):
        raise ParameterInvalid("dvl", f"track = {track!r}", "bottom or both")
    p = preset("sensors", id, "dvl")
    over = "scene" if scene else "flat bottom"
    m = Model("dvl", f"Doppler velocity log: four beams, bottom track over a {over}")
    eta, q = hull_pose(m)
    nu = m.input("nu", 6, unit=NU, description="of CO in b [m/s, rad/s]")
    if not scene:
        bottom = m.parameter("bottom_depth", 25.0, unit="m", description="depth of the flat bottom")
    tilt = p.parameter(m, "tilt", "rad", "beam from axis")
    azimuth = p.parameter(m, "azimuth", "rad", "of each beam", 4)
    r, R_bs = mounting(m, p)
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
    output_when(
        m, ping, enough, "velocity", v_b, unit="m/s", start=(0, 0, 0),
        description="of the DVL itself, body axes",
    )  # fmt: skip
    count = ca.if_else(enough, ca.sum1(ok), 1.0)
    mean = ca.cos(tilt) * ca.sum1(ok * distance) / count
    output_when(
        m, ping, enough, "altitude", mean, unit="m",
        description="along the DVL's axis, mean of valid beams",
    )  # fmt: skip
    validity_and_time(m, ping, enough, "three beams or more")
    if track == "both":
        _water_track(m, ping, p, D, R_bs, ca.mtimes(Rnb, R_bs), v_s, height)
    if is_on("aperiodic", aperiodic):
        # The next ping waits until the last one's echo has come back.
        low = p.parameter(m, "period_min", "s", "from ping to ping, near the bottom", min=1e-3)
        words = "from ping to ping at the longest range, and without an echo"
        high = p.parameter(m, "period_max", "s", words, min=1e-3)
        c = m.parameter("c", 1500.0, unit="m/s", min=1.0, description="speed of sound")
        following = m.discrete("t_next", unit="s", description="earliest instant of the next ping")
        farthest = distance[0]
        for i in range(1, 4):
            farthest = ca.if_else(distance[i] > farthest, distance[i], farthest)
        wait = ca.if_else(enough, clip(2.0 * farthest / c, low, high), high)
        m.update(ping, following, m.t + wait)
        only_when(ping, m.t >= following - 1e-9)
    p.complete(optional=("sigma_water", "layer", "period_min", "period_max"))
    return m


def _water_track(
    m: Model, ping: Clock, p: Preset, D: ca.SX, R_bs: ca.SX, R_ns: ca.SX, v: ca.SX, height: ca.SX
) -> None:
    """Declare the velocity through the water in a layer below the sensor."""
    v_c = m.input("v_c", 3, unit="m/s", description="current in n, taken as that of the layer")
    sigma = p.parameter(m, "sigma_water", "m/s", "noise of a beam in water track", min=0)
    layer = p.parameter(m, "layer", "m", "begin and end, below", 2, min=0)
    beams = ca.mtimes(D.T, v - ca.mtimes(R_ns.T, v_c)) + sigma * m.normal(ping, 4)
    there = ca.logic_and(height > 0.0, layer[1] <= 0.8 * height)
    through = ca.mtimes(R_bs, _least_squares(D, beams, ca.SX.ones(4)))
    output_when(
        m, ping, there, "velocity_water", through, unit="m/s", start=(0, 0, 0),
        description="through the water, body axes",
    )  # fmt: skip
    held_output(
        m, ping, "valid_water", there, unit="1", type="Boolean", description="the layer is clear"
    )


def _beams(
    m: Model, ping: Clock, p: Preset, v: ca.SX, down: ca.SX, height: ca.SX, seen: ca.SX | None
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Return each beam's velocity, range, and 1 where it has an echo, all with noise.

    `seen` are the ranges and the cosines of the incidence over a scene, None over a plane.
    """
    sigma_v = p.parameter(m, "sigma_v", "m/s", "noise of a beam", min=0)
    relative = p.parameter(
        m, "sigma_v_relative", "1", "and its part that grows with the beam's velocity", min=0
    )
    sigma_r = p.parameter(m, "sigma_range", "m", "range noise", min=0)
    low = p.parameter(m, "range_min", "m", "of a beam", min=0)
    high = p.parameter(m, "range_max", "m", "of a beam", min=0)
    incidence = p.parameter(
        m, "incidence_max", "rad", "of a beam on the bottom, from its normal", min=0, max=1.5707
    )
    lost = p.parameter(m, "dropout", "1", "by chance", min=0, max=1)
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
