"""Sonars that build an image of many pings: mechanically scanning, and side-scan.

Each ping is computed from the vehicle's pose at that time, so that its motion during a scan is in
the image.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sonar_component import SonarOptions, declare_sonar, sonar_of

__all__ = ["SCANNING", "SIDE_SCAN", "scanning_sonar", "side_scan_sonar"]

SCANNING, SIDE_SCAN = "ping360", "side_scan_class"  # where none is named


def scanning_sonar(
    id: str = SCANNING,
    scene: str = "flat",
    period: str = "0.1",
    bins: int | str = 100,
    columns: int | str = 0,
    rays: int | str = 64,
    shading: str = "hann",
    range_max: float | str = 0,
    sector: float | str = 360,
    step: float | str = 0,
    tvg: int | str = 40,
    complex: bool | str = False,
    labels: bool | str = False,
    seabed: str = "sand",
    solid: str = "steel",
    law: str = "auto",
    absorption: float | str = "francois_garrison",
    others: int | str = 0,
    frequency: float | str = 0,
    water: str = "parameters",
    profile: str = "",
    segments: int | str = 8,
    surface_bounce: float | str = "off",
    bottom_bounce: float | str = "off",
) -> Model:
    """Declare the scanning sonar of a preset, whose head turns by a step after each ping.

    The head begins at the port end of the `sector` [deg], turns by `step` [deg; 0: the preset's],
    and begins anew after the starboard end. The output `bearing` is that of the ping that is shown,
    about z of the instrument from its x to its y. The other options are those of `imaging_sonar`.
    """
    p = preset("sensors", id, "scanning_sonar")
    m = Model("scanning_sonar", "Mechanically scanning sonar over a scene")
    g = sonar_of(p, 1, bins, columns, rays, shading, range_max, frequency)
    given = SonarOptions(
        scene, period, tvg, complex, labels, seabed, solid, law, absorption, others, frequency,
        water, profile, segments, surface_bounce, bottom_bounce,
    )  # fmt: skip
    turn, wide = float(step) * pi / 180.0 or p.number("step", "rad"), float(sector) * pi / 180.0
    p.has("step")
    if not 0.0 < turn <= wide <= 2.0 * pi + 1e-9:
        what = f"a step of {turn * 180.0 / pi:g} deg in a sector of {float(sector):g} deg"
        raise ParameterInvalid(m.name, what, "a step above 0 within a sector of at most 360 deg")
    pings = max(1, round(wide / turn))

    def heads(ping: Clock) -> Sequence[ca.SX]:
        number = m.discrete("number", 0.0, unit="1", description="of the next ping in the scan")
        m.update(ping, number, ca.if_else(number >= pings - 1.5, 0.0, number + 1.0))
        bearing = (number + 0.5) * turn - 0.5 * pings * turn
        held_output(
            m, ping, "bearing", bearing, unit="rad", description="of the beam, from x towards y"
        )
        c, s = ca.cos(bearing), ca.sin(bearing)
        return [ca.vertcat(ca.horzcat(c, -s, 0), ca.horzcat(s, c, 0), ca.horzcat(0, 0, 1))]

    return declare_sonar(m, p, g, given, "one beam", heads)


def side_scan_sonar(
    id: str = SIDE_SCAN,
    scene: str = "flat",
    period: str = "0.1",
    bins: int | str = 100,
    columns: int | str = 0,
    rays: int | str = 96,
    shading: str = "hann",
    range_max: float | str = 0,
    tvg: int | str = 30,
    complex: bool | str = False,
    labels: bool | str = False,
    seabed: str = "sand",
    solid: str = "steel",
    law: str = "auto",
    absorption: float | str = "francois_garrison",
    others: int | str = 0,
    frequency: float | str = 0,
    water: str = "parameters",
    profile: str = "",
    segments: int | str = 8,
    surface_bounce: float | str = "off",
    bottom_bounce: float | str = "off",
) -> Model:
    """Declare the side-scan sonar of a preset: one beam to port, one to starboard.

    Its arrays lie along x of the instrument. Each beam looks `depression` below the horizontal. The
    rows of its waterfall are the pings. The options are those of `imaging_sonar`.
    """
    p = preset("sensors", id, "side_scan_sonar")
    m = Model("side_scan_sonar", "Side-scan sonar over a scene")
    g = sonar_of(p, 1, bins, columns, rays, shading, range_max, frequency)
    given = SonarOptions(
        scene, period, tvg, complex, labels, seabed, solid, law, absorption, others, frequency,
        water, profile, segments, surface_bounce, bottom_bounce,
    )  # fmt: skip
    down = p.number("depression", "rad")

    def heads(_: Clock) -> Sequence[ca.DM]:
        c, s = cos(down), sin(down)
        port = np.array([[0.0, 1.0, 0.0], [-c, 0.0, s], [s, 0.0, c]])  # columns: its x, y and z
        starboard = np.array([[0.0, -1.0, 0.0], [c, 0.0, -s], [s, 0.0, c]])
        return [ca.DM(port), ca.DM(starboard)]

    return declare_sonar(m, p, g, given, "beams to port and to starboard", heads)
