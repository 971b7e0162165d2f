"""Altimeter: one acoustic beam along z of the sensor, over a plane bottom or a scene.

The first echo comes from the part of the beam that meets the bottom most squarely: with theta the
angle of the axis from the vertical and beta half the beam's width,

    range = height / cos(max(theta - beta, 0)) + noise,

lost beyond its range, where theta - beta is too flat, by chance, or out of the water. Over a scene
the echo is the nearest of 17 rays' within the beam, its axis and two rings of eight at beta / 2 and
beta, of which each counts where its own incidence is not too flat.
"""

from __future__ import annotations

from math import cos, pi, sin

import casadi as ca

from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import abs_, atan2_or, norm
from uuvsim_cosim.models.declaration.sampled import BEFORE_FIRST, held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, output_when
from uuvsim_cosim.models.sensors.sensor_error import uniform
from uuvsim_cosim.models.worlds.rays import declare_others, rays

__all__ = ["altimeter"]


def altimeter(
    id: str = "ping", period: str = "0.1", scene: str = "", others: int | str = 0
) -> Model:
    """Declare the altimeter of a preset, which pings every `period` seconds.

    With a `scene` it ranges over that instead of a plane, and sees `others` further vehicles.
    """
    p = preset("sensors", id, "altimeter")
    m = Model("altimeter", f"Single-beam altimeter over a {'scene' if scene else 'plane bottom'}")
    eta, q = hull_pose(m)
    if not scene:
        bottom = m.input(
            "bottom_depth", unit="m", start=25.0, description="depth of the bottom below the sensor"
        )
    r, R_bs = mounting(m, p)
    words = {
        "beam_width": ("rad", "full width of the beam"),
        "range_min": ("m", "no echo nearer"),
        "range_max": ("m", "no echo farther"),
        "sigma_range": ("m", "constant part of the range's noise"),
        "sigma_range_relative": ("1", "and the part that grows with range"),
        "incidence_max": ("rad", "of the beam's edge on the bottom, from its normal"),
        "dropout": ("1", "probability that a ping is lost"),
    }
    width, low, high, sigma, relative, flat, lost = p.parameters(m, words).values()
    moving = declare_others(m, others) if scene else ca.SX(0, 1)
    ping = m.clock("ping", period)
    Rnb = R(q)
    axis = ca.mtimes(Rnb, R_bs[:, 2])  # of the beam, in n
    off = atan2_or(norm(axis[:2]), axis[2], 0.0) - 0.5 * width
    off = ca.if_else(off > 0.0, off, 0.0)
    depth = eta[2] + ca.dot(Rnb[2, :].T, r)
    if scene:
        place, R_ns = eta[:3] + ca.mtimes(Rnb, r), ca.mtimes(Rnb, R_bs)
        distance, steep = _nearest(scene, place, R_ns, high, width, flat, moving)
    else:
        steep = off < flat
        height = bottom - depth
        distance = height / ca.if_else(steep, ca.cos(off), 1.0)
    heard = ca.logic_and(ca.logic_and(distance >= low, distance <= high), depth > 0.0)
    ok = ca.logic_and(ca.logic_and(steep, heard), uniform(m, ping) > lost)
    w = m.normal(ping)
    reading = abs_(distance + ca.sqrt(sigma**2 + (relative * distance) ** 2 + 1e-30) * w)
    output_when(m, ping, ok, "altitude", reading, unit="m", description="range of the last echo")
    held_output(m, ping, "valid", ok, unit="1", type="Boolean", description="this ping had an echo")
    output_when(
        m, ping, ok, "t_sample", m.t, unit="s", start=BEFORE_FIRST,
        description="of the last echo; -1 before",
    )  # fmt: skip
    p.complete()
    return m


def _nearest(
    scene: str, place: ca.SX, R_ns: ca.SX, high: ca.SX, width: ca.SX, flat: ca.SX, moving: ca.SX
) -> tuple[ca.SX, ca.SX]:
    """Return the range of the nearest echo within the beam, and 1 where there is one."""
    rings = [(0.0, 1), (0.25, 8), (0.5, 8)]  # of the whole width from the axis, rays
    directions = [
        ca.vertcat(
            ca.sin(part * width) * cos(2 * pi * i / n),
            ca.sin(part * width) * sin(2 * pi * i / n),
            ca.cos(part * width),
        )
        for part, n in rings
        for i in range(n)
    ]
    n = len(directions)
    d = ca.vec(ca.mtimes(R_ns, ca.horzcat(*directions)))
    seen = rays(scene, n, moving.numel() // 10)(ca.vertcat(place, high, moving, d))
    nearest, least = ca.SX(0.0), ca.cos(flat)
    for i in range(n):
        echo = ca.logic_and(seen[i] > 0.0, seen[n + i] >= least)
        nearer = ca.logic_or(nearest <= 0.0, seen[i] < nearest)
        nearest = ca.if_else(ca.logic_and(echo, nearer), seen[i], nearest)
    return nearest, nearest > 0.0
