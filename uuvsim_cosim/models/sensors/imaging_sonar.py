"""Imaging sonar: the echoes of a scene by beam and range, with speckle and noise, at its own rate.

fmus/runtime/worlds/uuv_sonar.h states the model of the echoes, sonar_geometry.py the arrays'. From
the pressure p of beam and bin, a complex number, the sonar shows the magnitude

    |p + n| G(r),   G = r^(tvg / 20) 10^(alpha r / 10),

with the receiver's noise n and the time-varying gain G, which makes up for what spreading and
absorption take. With tvg = 40, an echo's level does not depend on its range; a flat bottom's, whose
area in a beam grows with range, does not with 30. The instrument's axes: x ahead, between the
beams, y to starboard, along the array, z down. Beams run from port to starboard.
"""

from __future__ import annotations

from math import log, pi

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Model, is_on
from uuvsim_cosim.models.declaration.preset import Preset, preset
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.worlds.ground import Ground, ground_named
from uuvsim_cosim.models.worlds.rays import declare_others
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry, sonar_geometry
from uuvsim_cosim.models.worlds.sonar_image import Surfaces, sonar_image

__all__ = ["SONAR", "imaging_sonar", "sonar_of"]

SONAR = "p900"  # where none is named
MOST = 200_000  # pixels: they are discrete states of the component
SOUND_SPEED = 1500.0  # m/s, of a preset's resolution
GAINS = (0, 10, 20, 30, 40)
DB = log(10.0) / 20.0  # of pressure, per dB


def imaging_sonar(
    id: str = SONAR,
    scene: str = "flat",
    period: str = "0.2",
    beams: int | str = 16,
    bins: int | str = 24,
    columns: int | str = 0,
    rays: int | str = 32,
    shading: str = "hann",
    tvg: int | str = 40,
    range_max: float | str = 0,
    complex: bool | str = False,
    labels: bool | str = False,
    others: int | str = 0,
) -> Model:
    """Declare the forward-looking sonar of a preset, which pings every `period` seconds.

    `beams`, `bins` and `range_max` [m] replace the preset's numbers; 0: its own. With fewer beams
    than the preset has, each is as wide as the distance to the next. `columns` times `rays` are the
    rays of a ping; with 0 columns there are four within the width of a beam. `shading` of the array
    is none, hamming or hann. `tvg` is the gain over range: 0, 10, 20, 30 or 40 log r. With
    `complex` there are outputs of the pressure's parts, with `labels` of what each pixel shows.
    """
    p = preset("sensors", id, "imaging_sonar")
    m = Model("imaging_sonar", "Imaging sonar over a scene")
    power = int(tvg)
    if power not in GAINS:
        raise ParameterInvalid("imaging_sonar", f"tvg = {tvg}", ", ".join(map(str, GAINS)))
    g = sonar_of(p, beams, bins, columns, rays, shading, range_max)
    n_beams, pixels = len(g.bearings), len(g.bearings) * g.bins
    if pixels > MOST:
        raise ParameterInvalid(
            "imaging_sonar", f"{n_beams} beams of {g.bins} bins", f"at most {MOST} together"
        )
    eta, q = hull_pose(m)
    r, R_bs = mounting(m, p)
    frequency = p.parameter(m, "frequency", "Hz", "of the pulse", min=1.0)
    level = p.parameter(m, "source_level", "1", "dB re 1 uPa at 1 m")
    noise = p.parameter(m, "noise_level", "1", "dB re 1 uPa, at the output of a beam")
    c = m.parameter("sound_speed", SOUND_SPEED, unit="m/s", min=1.0, description="of the water")
    alpha = m.parameter(
        "absorption", 0.0, unit="1/m", min=0.0, description="of the water, dB/m one way"
    )
    least = m.parameter(
        "threshold",
        4.0,
        unit="1",
        min=0.0,
        description="least ratio of an echo's pressure to the noise",
    )
    moving = declare_others(m, others)
    ping = m.clock("ping", period)
    ground = ground_named(scene)
    show = is_on("complex", complex), is_on("labels", labels)
    image = sonar_image(
        ground, g, _lambert(ground, moving.numel() // 10), tvg=power // 10,
        n_moving=moving.numel() // 10, complex=show[0], labels=show[1],
    )  # fmt: skip
    Rnb = R(q)
    cell, nearest = g.step / g.fine, g.first - g.pad * g.step
    head = ca.vertcat(
        eta[:3] + ca.mtimes(Rnb, r),
        ca.vec(ca.mtimes(Rnb, R_bs).T),
        2.0 * frequency / c,
        1e-6 * ca.exp(DB * (level - 2.0 * alpha * (nearest + 0.5 * cell))),
        ca.exp(-2.0 * DB * alpha * cell),
        1e-6 * ca.exp(DB * noise),
        ca.exp(2.0 * DB * alpha * (g.first + 0.5 * g.step)),
        ca.exp(2.0 * DB * alpha * g.step),
        least,
    )
    values = image(ca.vertcat(head, m.normal(ping, 2), moving))
    order = f"{n_beams} beams from port to starboard, of {g.bins} bins"
    held_output(
        m,
        ping,
        "magnitude",
        values[:pixels],
        unit="Pa",
        description=f"of the pressure, with gain: {order}",
    )
    ranges = values[pixels : pixels + n_beams]
    held_output(
        m, ping, "range", ranges, unit="m", description="of each beam's strongest echo; 0: none"
    )
    mean, peak = values[pixels + n_beams], values[pixels + n_beams + 1]
    first = pixels + n_beams + 2
    for name, shown, unit in (
        ("real", show[0], "Pa"),
        ("imaginary", show[0], "Pa"),
        ("label", show[1], "1"),
    ):
        if shown:
            words = (
                f"part of the pressure: {order}"
                if unit == "Pa"
                else "of each pixel: 0 no echo, 1 seabed, 2 + i solid or mesh i"
            )
            held_output(m, ping, name, values[first : first + pixels], unit=unit, description=words)
            first += pixels
    held_output(m, ping, "mean", mean, unit="Pa", description="of the magnitudes")
    held_output(m, ping, "peak", peak, unit="Pa", description="greatest magnitude")
    validity_and_time(m, ping, ca.sum1(ranges) > 0.0, "any beam has an echo")
    p.complete()
    return m


def sonar_of(
    p: Preset,
    beams: int | str = 0,
    bins: int | str = 0,
    columns: int | str = 0,
    rays: int | str = 32,
    shading: str = "hann",
    range_max: float | str = 0,
) -> SonarGeometry:
    """Return the rays and beams of a preset; 0 stands for the preset's own number."""
    own = int(p.number("beams", "1"))
    n, swath, width = int(beams) or own, p.number("swath", "rad"), p.number("beam_width", "rad")
    p.has("bins"), p.has("range_max")
    return sonar_geometry(
        beams=n,
        swath=swath,
        beam_width=max(width, swath / n) if n < own else width,
        shading=shading,
        elevation=p.number("elevation", "rad"),
        bins=int(bins) or int(p.number("bins", "1")),
        range_min=p.number("range_min", "m"),
        range_max=float(range_max) or p.number("range_max", "m"),
        resolution=SOUND_SPEED / (2.0 * p.number("bandwidth", "Hz")),
        columns=int(columns),
        rays=int(rays),
    )


def _lambert(ground: Ground, movers: int) -> Surfaces:
    grazing = np.linspace(0.0, pi / 2, 91)
    sigma = np.round(np.array([[10 ** (-2.7)], [10 ** (-1.0)]]) * np.sin(grazing) ** 2, 12)
    solids = np.ones(len(ground.names) + movers, np.uint8)
    return Surfaces(sigma, np.zeros((0, 0), np.uint8), solids)
