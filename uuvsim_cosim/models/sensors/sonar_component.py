"""What the components of sonars share: inputs, parameters, the images of a ping, and their outputs.

fmus/runtime/worlds/uuv_sonar.h states the model of the echoes, sonar_geometry.py the arrays'. From
the pressure p of beam and bin, a complex number, a sonar shows the magnitude

    |p + n| G(r),   G = r^(tvg / 20) 10^(alpha r / 10),

with the receiver's noise n and the time-varying gain G, which makes up for what spreading and
absorption take. With tvg = 40, an echo's level does not depend on its range; that of a flat bottom,
whose area in a beam grows with range, does not with 30.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import log

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.acoustics.absorption import ainslie_mccolm, francois_garrison
from uuvsim_cosim.models.acoustics.materials import material, scene_materials, strength_table
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Clock, Model, is_on
from uuvsim_cosim.models.declaration.preset import Preset
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.worlds.ground import ground_named, scene_named
from uuvsim_cosim.models.worlds.rays import MOVING, declare_others
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry, sonar_geometry
from uuvsim_cosim.models.worlds.sonar_image import Surfaces, sonar_image

__all__ = ["SonarOptions", "declare_sonar", "sonar_of", "surfaces_of"]

MOST = 200_000  # pixels: they are discrete states of the component
SOUND_SPEED = 1500.0  # m/s, of a preset's resolution
GAINS = (0, 10, 20, 30, 40)
DB = log(10.0) / 20.0  # of pressure, per dB
FORMULAS = {"francois_garrison": francois_garrison, "ainslie_mccolm": ainslie_mccolm}
NO_HEAD = ca.DM.eye(3)


@dataclass(frozen=True)
class SonarOptions:
    """Options that all sonars have, as text or number.

    `scene`, `period` [s] and `others` are those of every sensor. `tvg` is the gain over range: 0,
    10, 20, 30 or 40 log r. With `complex` there are outputs of the pressure's parts, with `labels`
    of what each pixel shows. `seabed` is the material where the scene states none, `solid` that of
    solids, meshes and other vehicles that state none; `law` is the one of their backscatter: auto,
    apl_uw or lambert. `absorption` of the water is a number [dB/m], or the formula that computes it
    for 10 degC, salinity 35, the depth 10 m and pH 8: francois_garrison or ainslie_mccolm.
    """

    scene: str
    period: str
    tvg: int | str
    complex: bool | str
    labels: bool | str
    seabed: str
    solid: str
    law: str
    absorption: float | str
    others: int | str


def sonar_of(
    p: Preset,
    beams: int | str = 0,
    bins: int | str = 0,
    columns: int | str = 0,
    rays: int | str = 32,
    shading: str = "hann",
    range_max: float | str = 0,
) -> SonarGeometry:
    """Return the rays and beams of a preset; 0 stands for the preset's own number.

    With fewer beams than the preset has, each is as wide as the distance to the next.
    """
    own = int(p.number("beams", "1")) if p.has("beams") else 1
    swath = p.number("swath", "rad") if p.has("swath") else 0.0
    n, width = int(beams) or own, p.number("beam_width", "rad")
    p.has("bins"), p.has("range_max")
    return sonar_geometry(
        beams=n,
        swath=swath,
        beam_width=max(width, swath / n) if 0 < n < own else width,
        shading=shading,
        elevation=p.number("elevation", "rad"),
        bins=int(bins) or int(p.number("bins", "1")),
        range_min=p.number("range_min", "m"),
        range_max=float(range_max) or p.number("range_max", "m"),
        resolution=SOUND_SPEED / (2.0 * p.number("bandwidth", "Hz")),
        columns=int(columns),
        rays=int(rays),
    )


def surfaces_of(
    scene: str, seabed: str, solid: str, law: str, frequency: float, movers: int
) -> tuple[Surfaces, tuple[str, ...]]:
    """Return the backscatter of a scene, and what was assumed; `movers` are of `solid` too."""
    for name in filter(None, (seabed, solid)):  # also one that this scene does not need
        material(name)
    found = scene_materials(scene_named(scene), seabed, solid)
    names = list(dict.fromkeys([*found.names, *([solid] if movers else [])]))
    table = strength_table(names, frequency, SOUND_SPEED, law)
    others = np.full(movers, names.index(solid) if movers else 0)
    solids = np.concatenate([found.solids, found.meshes, others]).astype(np.uint8)
    layer = found.terrain if found.terrain.any() else np.zeros((0, 0), np.uint8)
    surfaces = Surfaces(np.round(table.sigma, 12), layer, solids)
    return surfaces, (*found.assumptions, *table.assumptions)


def declare_sonar(
    m: Model,
    p: Preset,
    g: SonarGeometry,
    given: SonarOptions,
    beams: str,
    heads: Callable[[Clock], Sequence[ca.SX | ca.DM]] = lambda _: [NO_HEAD],
) -> Model:
    """Declare a sonar, whose image is one of the geometry's beams for each of `heads`.

    `heads` returns the rotations of the arrays, from their axes to those of the preset, in a ping;
    `beams` says in words what the beams are.
    """
    power = int(given.tvg)
    if power not in GAINS:
        raise ParameterInvalid(m.name, f"tvg = {given.tvg}", ", ".join(map(str, GAINS)))
    show = is_on("complex", given.complex), is_on("labels", given.labels)
    eta, q = hull_pose(m)
    r, R_bs = mounting(m, p)
    frequency = p.parameter(m, "frequency", "Hz", "of the pulse", min=1.0)
    level = p.parameter(m, "source_level", "1", "dB re 1 uPa at 1 m")
    noise = p.parameter(m, "noise_level", "1", "dB re 1 uPa, at the output of a beam")
    c = m.parameter("sound_speed", SOUND_SPEED, unit="m/s", min=1.0, description="of the water")
    lost, source = _absorption(m.name, given.absorption, p.number("frequency", "Hz"))
    alpha = m.parameter(
        "absorption", lost, unit="1/m", min=0.0, description=f"of the water, dB/m one way; {source}"
    )
    words = "least ratio of an echo's pressure to the noise"
    least = m.parameter("threshold", 4.0, unit="1", min=0.0, description=words)
    moving = declare_others(m, given.others)
    movers = moving.numel() // MOVING
    surfaces, assumed = surfaces_of(
        given.scene, given.seabed, given.solid, given.law, p.number("frequency", "Hz"), movers
    )
    m.description = "; ".join([m.description, *assumed])
    ping = m.clock("ping", given.period)
    turned = heads(ping)
    n_beams, pixels = len(g.bearings), len(g.bearings) * g.bins
    total = len(turned) * pixels * (1 + 2 * show[0] + show[1])
    if total > MOST:
        counted = f"{len(turned) * n_beams} beams of {g.bins} bins, {total} values of a ping"
        raise ParameterInvalid(m.name, counted, f"at most {MOST}, as an instance keeps them all")
    image = sonar_image(
        ground_named(given.scene), g, surfaces, tvg=power // 10, n_moving=movers,
        complex=show[0], labels=show[1],
    )  # fmt: skip
    Rnb = R(q)
    cell, nearest = g.step / g.fine, g.first - g.pad * g.step
    place = eta[:3] + ca.mtimes(Rnb, r)
    numbers = ca.vertcat(
        2.0 * frequency / c,
        1e-6 * ca.exp(DB * (level - 2.0 * alpha * (nearest + 0.5 * cell))),
        ca.exp(-2.0 * DB * alpha * cell),
        1e-6 * ca.exp(DB * noise),
        ca.exp(2.0 * DB * alpha * (g.first + 0.5 * g.step)),
        ca.exp(2.0 * DB * alpha * g.step),
        least,
    )
    seen = []
    for head in turned:
        axes = ca.vec(ca.mtimes(ca.mtimes(Rnb, R_bs), head).T)
        draws = m.normal(ping, 2)
        seen.append(image(ca.vertcat(place, axes, numbers, draws, moving)))

    def plane(first: int, n: int) -> ca.SX:
        return ca.vertcat(*(values[first : first + n] for values in seen))

    order = f"{beams}, of {g.bins} bins"
    held_output(
        m, ping, "magnitude", plane(0, pixels), unit="Pa",
        description=f"of the pressure, with gain: {order}",
    )  # fmt: skip
    ranges = plane(pixels, n_beams)
    held_output(
        m, ping, "range", ranges, unit="m", description="of each beam's strongest echo; 0: none"
    )
    held_output(
        m, ping, "echo", plane(pixels + n_beams, n_beams), unit="Pa",
        description="magnitude of each beam's strongest echo, with gain",
    )  # fmt: skip
    first = pixels + 2 * n_beams
    mean, peak = plane(first, 1), plane(first + 1, 1)
    first += 2
    for name in ("real", "imaginary") if show[0] else ():
        text = f"{name} part of the pressure, with gain: {order}"
        held_output(m, ping, name, plane(first, pixels), unit="Pa", description=text)
        first += pixels
    if show[1]:
        text = f"0 no echo, 1 seabed, 2 + i solid or mesh i: {order}"
        held_output(m, ping, "label", plane(first, pixels), unit="1", description=text)
    held_output(
        m, ping, "mean", ca.sum1(mean) / len(turned), unit="Pa", description="of the magnitudes"
    )
    held_output(m, ping, "peak", ca.mmax(peak), unit="Pa", description="greatest magnitude")
    for name in ("magnitude", "real", "imaginary", "label"):
        m.only_arrays |= {name, f"{name}_held"} & m.variables.keys()
    validity_and_time(m, ping, ca.sum1(ranges) > 0.0, "any beam has an echo")
    p.complete()
    return m


def _absorption(name: str, given: float | str, frequency: float) -> tuple[float, str]:
    """Return the absorption [dB/m] of an option, and where it is from."""
    if given in FORMULAS:
        water = {"temperature": 10.0, "salinity": 35.0, "depth": 10.0, "pH": 8.0}
        alpha = float(FORMULAS[str(given)](frequency, **water))
        return round(alpha, 9), f"{given}, 10 degC, salinity 35, 10 m, pH 8"
    try:
        alpha = float(given)
    except ValueError:
        alpha = -1.0
    if not 0.0 <= alpha < float("inf"):
        known = ", ".join(FORMULAS)
        raise InputInvalid(name, f"absorption = {given}", f"a number [dB/m], 0 or more, or {known}")
    return alpha, "as the option states"
