"""Altimeter: one acoustic beam along z of the sensor, over a plane bottom.

The first echo comes from the part of the beam that meets the bottom most squarely: with theta the
angle of the axis from the vertical and beta half the beam's width,

    range = height / cos(max(theta - beta, 0)) + noise,

lost beyond its range, where theta - beta is too flat, by chance, or out of the water.
"""

from __future__ import annotations

import casadi as ca

from uuvsim_cosim.models.kinematics import R
from uuvsim_cosim.models.model import Model
from uuvsim_cosim.models.mounting import Pose, mounting
from uuvsim_cosim.models.preset import preset
from uuvsim_cosim.models.safe_math import abs_, atan2_or, norm
from uuvsim_cosim.models.sampled import held_output
from uuvsim_cosim.models.sensor_error import uniform
from uuvsim_cosim.models.vectors import ETA

__all__ = ["altimeter"]


def altimeter(id: str = "ping", period: str = "0.1") -> Model:
    """Declare the altimeter of a preset, which pings every `period` seconds."""
    p = preset("sensors", id, "altimeter")
    m = Model("altimeter", "Single-beam altimeter over a plane bottom")
    eta = m.input("eta", 6, unit=ETA, description="of the hull: N E D [m], phi theta psi [rad]")
    q = m.input("q", 4, unit="1", start=(1, 0, 0, 0), description="attitude of the hull")
    bottom = m.input(
        "bottom_depth", unit="m", start=25.0, description="depth of the bottom below the sensor"
    )
    r, R_bs = mounting(m, Pose(p.vector("r_s", "m", 3), p.vector("Theta_s", "rad", 3)))
    words = {
        "beam_width": ("rad", "full width of the beam"),
        "range_min": ("m", "no echo nearer"),
        "range_max": ("m", "no echo farther"),
        "sigma_range": ("m", "constant part of the range's noise"),
        "sigma_range_relative": ("1", "and the part that grows with range"),
        "incidence_max": ("rad", "of the beam's edge on the bottom, from its normal"),
        "dropout": ("1", "probability that a ping is lost"),
    }
    width, low, high, sigma, relative, flat, lost = (
        m.parameter(name, p.number(name, unit), unit=unit, min=0, description=text)
        for name, (unit, text) in words.items()
    )
    ping = m.clock("ping", period)
    Rnb = R(q)
    axis = ca.mtimes(Rnb, R_bs[:, 2])  # of the beam, in n
    off = atan2_or(norm(axis[:2]), axis[2], 0.0) - 0.5 * width
    off = ca.if_else(off > 0.0, off, 0.0)
    depth = eta[2] + ca.dot(Rnb[2, :].T, r)
    steep = off < flat
    height = bottom - depth
    distance = height / ca.if_else(steep, ca.cos(off), 1.0)
    heard = ca.logic_and(ca.logic_and(distance >= low, distance <= high), depth > 0.0)
    ok = ca.logic_and(ca.logic_and(steep, heard), uniform(m, ping) > lost)
    w = m.normal(ping)
    reading = abs_(distance + ca.sqrt(sigma**2 + (relative * distance) ** 2 + 1e-30) * w)
    held = m.discrete("altitude_held", unit="m")
    m.update(ping, held, ca.if_else(ok, reading, held))
    m.output("altitude", held, unit="m", description="range of the last echo", discrete=True)
    held_output(m, ping, "valid", ok, unit="1", type="Boolean", description="this ping had an echo")
    taken = m.discrete("t_sample_held", -1.0, unit="s")
    m.update(ping, taken, ca.if_else(ok, m.t, taken))
    m.output("t_sample", taken, unit="s", description="of the last echo; -1 before", discrete=True)
    p.complete()
    return m
