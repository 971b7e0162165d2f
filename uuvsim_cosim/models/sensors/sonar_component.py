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
from math import asin, log, pi, sin
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid, ParameterInvalid
from uuvsim_cosim.models.acoustics.absorption import absorption, absorption_range
from uuvsim_cosim.models.acoustics.materials import (
    material,
    reflection_table,
    scene_materials,
    strength_table,
)
from uuvsim_cosim.models.acoustics.reflection import coherent_share
from uuvsim_cosim.models.declaration.kinematics import R
from uuvsim_cosim.models.declaration.model import Clock, Model, is_on
from uuvsim_cosim.models.declaration.preset import Preset
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.sensors.sensor import hull_pose, mounting, validity_and_time
from uuvsim_cosim.models.worlds.ground import ground_named, scene_named
from uuvsim_cosim.models.worlds.rays import MOVING, declare_others
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry, sonar_geometry
from uuvsim_cosim.models.worlds.sonar_image import ANGLES, Surfaces, sonar_image
from uuvsim_cosim.models.worlds.sonar_path import (
    STRAIGHT,
    SonarPaths,
    profile_levels,
    profile_of_text,
)

__all__ = ["SonarOptions", "declare_sonar", "paths_of", "sonar_of", "surfaces_of"]

MOST = 200_000  # pixels: they are discrete states of the component
SOUND_SPEED = 1500.0  # m/s, of a preset's resolution
GAINS = (0, 10, 20, 30, 40)
DB = log(10.0) / 20.0  # of pressure, per dB
FORMULAS = ("francois_garrison", "ainslie_mccolm")
WATERS = ("parameters", "inputs")
MOST_SEGMENTS = 1000
NO_HEAD = ca.DM.eye(3)


@dataclass(frozen=True)
class SonarOptions:
    """Options that all sonars have, as text or number.

    `scene`, `period` [s] and `others` are those of every sensor. `tvg` is the gain over range: 0,
    10, 20, 30 or 40 log r. With `complex` there are outputs of the pressure's parts, with `labels`
    of what each pixel shows. `seabed` is the material where the scene states none, `solid` that of
    solids, meshes and other vehicles that state none; `law` is the one of their backscatter: auto,
    apl_uw or lambert.

    `absorption` of the water is a number [dB/m], or the formula that computes it from the
    parameters temperature, salinity, depth and pH: francois_garrison or ainslie_mccolm. With
    `water` "inputs", temperature and salinity are inputs, and the depth is that of the instrument.
    `frequency` [Hz] replaces the preset's; widths of beams, backscatter and absorption change with
    it.

    `profile` is the speed of sound by depth, ``0:1500,20:1490`` [m, m/s], which bends the rays; in
    a layer with a gradient, a chord is as long as the greatest range divided by `segments`. With
    `surface_bounce` and `bottom_bounce`, rays are reflected once at the surface of the water and at
    the seabed: off, or the rms height of the roughness [m], 0 for a smooth one.
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
    frequency: float | str
    water: str
    profile: str
    segments: int | str
    surface_bounce: float | str
    bottom_bounce: float | str


def sonar_of(
    p: Preset,
    beams: int | str = 0,
    bins: int | str = 0,
    columns: int | str = 0,
    rays: int | str = 32,
    shading: str = "hann",
    range_max: float | str = 0,
    frequency: float | str = 0,
) -> SonarGeometry:
    """Return the rays and beams of a preset; 0 stands for the preset's own number.

    With fewer beams than the preset has, each is as wide as the distance to the next. At another
    `frequency` [Hz], the arrays are as long as at the preset's own, so that widths change.
    """
    longer = p.number("frequency", "Hz") / _frequency(p, frequency)

    def wide(name: str) -> float:
        own = p.number(name, "rad")
        edge = sin(own / 2.0) * longer
        if not edge < 1.0:
            found = f"frequency {_frequency(p, frequency):g} Hz"
            expected = f"a frequency at which its array of {own:g} rad still forms a beam"
            raise ParameterInvalid(f"sonar.{name}", found, expected)
        return own if longer == 1.0 else 2.0 * asin(edge)

    own = int(p.number("beams", "1")) if p.has("beams") else 1
    swath = p.number("swath", "rad") if p.has("swath") else 0.0
    n, width = int(beams) or own, wide("beam_width")
    p.has("bins"), p.has("range_max")
    return sonar_geometry(
        beams=n,
        swath=swath,
        beam_width=max(width, swath / n) if 0 < n < own else width,
        shading=shading,
        elevation=wide("elevation"),
        bins=int(bins) or int(p.number("bins", "1")),
        range_min=p.number("range_min", "m"),
        range_max=float(range_max) or p.number("range_max", "m"),
        resolution=SOUND_SPEED / (2.0 * p.number("bandwidth", "Hz")),
        columns=int(columns),
        rays=int(rays),
    )


def surfaces_of(
    scene: str, seabed: str, solid: str, law: str, frequency: float, movers: int
) -> tuple[Surfaces, tuple[str, ...], tuple[str, ...]]:
    """Return the backscatter of a scene, its materials, and what was assumed.

    `movers` are of the material `solid` too.
    """
    for name in filter(None, (seabed, solid)):  # also one that this scene does not need
        material(name)
    found = scene_materials(scene_named(scene), seabed, solid)
    names = list(dict.fromkeys([*found.names, *([solid] if movers else [])]))
    table = strength_table(names, frequency, SOUND_SPEED, law)
    others = np.full(movers, names.index(solid) if movers else 0)
    solids = np.concatenate([found.solids, found.meshes, others]).astype(np.uint8)
    layer = found.terrain if found.terrain.any() else np.zeros((0, 0), np.uint8)
    surfaces = Surfaces(np.round(table.sigma, 12), layer, solids)
    return surfaces, tuple(names), (*found.assumptions, *table.assumptions)


def _frequency(p: Preset, given: float | str) -> float:
    """Return the frequency [Hz] of an option, 0 for the preset's own."""
    try:
        number = float(given)
    except ValueError:
        number = -1.0
    if not 0.0 <= number < float("inf"):
        raise InputInvalid("sonar", f"frequency = {given}", "a number [Hz], 0 for the preset's own")
    return number or p.number("frequency", "Hz")


def paths_of(
    given: SonarOptions, names: Sequence[str], frequency: float, farthest: float
) -> tuple[SonarPaths, tuple[str, ...]]:
    """Return what bends and reflects the rays by the options, and what was assumed.

    `names` are the materials of the scene, `farthest` [m] is the range of the rays. Raises
    InputInvalid for an option that cannot be read.
    """
    if str(given.profile) == "" and {str(given.surface_bounce), str(given.bottom_bounce)} == {
        "off"
    }:
        return STRAIGHT, ()
    level, assumed = STRAIGHT.level, []
    try:
        segments = int(given.segments)
    except ValueError:
        segments = 0
    if not 1 <= segments <= MOST_SEGMENTS:
        raise InputInvalid("sonar", f"segments = {given.segments}", f"1 to {MOST_SEGMENTS}")
    if str(given.profile):
        level = profile_levels(profile_of_text(str(given.profile)))
        ground = ground_named(given.scene)
        bed = float(np.nanmax(ground.z)) if ground.z.size else level[-1, 0]
        if level[0, 0] > 0.0:
            assumed.append(f"speed of sound above {level[0, 0]:g} m: {level[0, 1]:g} m/s")
        if level[-1, 0] < bed:
            assumed.append(f"speed of sound below {level[-1, 0]:g} m: {level[-1, 1]:g} m/s")
    grazing = np.arcsin(np.arange(ANGLES + 1) / ANGLES)
    k = 2.0 * pi * frequency / SOUND_SPEED
    surface, bottom = STRAIGHT.surface, STRAIGHT.bottom
    height = _roughness("surface_bounce", given.surface_bounce)
    if height is not None:
        surface = _squared(-coherent_share(grazing, height, k))
    height = _roughness("bottom_bounce", given.bottom_bounce)
    if height is not None:
        smooth = reflection_table(names, grazing, SOUND_SPEED)
        bottom = _squared(smooth * coherent_share(grazing, height, k))
        assumed.append("the seabed reflects as a fluid, without shear waves")
    return SonarPaths(level, farthest / segments, surface, bottom), tuple(assumed)


def _squared(coefficient: NDArray[Any]) -> NDArray[np.float32]:
    """Return the parts of the squares, which a path out and back has; rounded, see the geometry."""
    both = np.asarray(coefficient, complex) ** 2
    return np.round(np.stack([both.real, both.imag], axis=-1), 6).astype(np.float32)


def _roughness(name: str, given: float | str) -> float | None:
    """Return the rms height [m] of an option; None for "off"."""
    if str(given) == "off":
        return None
    try:
        height = float(given)
    except ValueError:
        height = -1.0
    if not 0.0 <= height < float("inf"):
        expected = "off, or the rms height of the roughness [m], 0 or more"
        raise InputInvalid("sonar", f"{name} = {given}", expected)
    return height


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
    f = _frequency(p, given.frequency)
    frequency = m.parameter(
        "frequency", f, unit="Hz", min=f, max=f, tunable=False,
        description="of the pulse; another one is the option frequency=HZ of the source",
    )  # fmt: skip
    level = p.parameter(m, "source_level", "1", "dB re 1 uPa at 1 m")
    noise = p.parameter(m, "noise_level", "1", "dB re 1 uPa, at the output of a beam")
    words = "that the instrument assumes; beams and backscatter are those of 1500 m/s"
    c = m.parameter("sound_speed", SOUND_SPEED, unit="m/s", min=1.0, description=words)
    place = eta[:3] + ca.mtimes(R(q), r)
    ping = m.clock("ping", given.period)
    alpha = _absorption(m, given, f, ping, place[2])
    words = "least ratio of an echo's pressure to the noise"
    least = m.parameter("threshold", 4.0, unit="1", min=0.0, description=words)
    moving = declare_others(m, given.others)
    movers = moving.numel() // MOVING
    surfaces, names, assumed = surfaces_of(
        given.scene, given.seabed, given.solid, given.law, f, movers
    )
    paths, also = paths_of(given, names, f, g.first + (g.bins + g.pad) * g.step)
    m.description = "; ".join([m.description, *assumed, *also])
    turned = heads(ping)
    n_beams, pixels = len(g.bearings), len(g.bearings) * g.bins
    total = len(turned) * pixels * (1 + 2 * show[0] + show[1])
    if total > MOST:
        counted = f"{len(turned) * n_beams} beams of {g.bins} bins, {total} values of a ping"
        raise ParameterInvalid(m.name, counted, f"at most {MOST}, as an instance keeps them all")
    image = sonar_image(
        ground_named(given.scene), g, surfaces, tvg=power // 10, n_moving=movers,
        complex=show[0], labels=show[1], paths=paths,
    )  # fmt: skip
    Rnb = R(q)
    cell, nearest = g.step / g.fine, g.first - g.pad * g.step
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
        seen.append(image(ca.vertcat(place, axes, numbers, draws, c, moving)))

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


def _absorption(
    m: Model, given: SonarOptions, frequency: float, ping: Clock, depth: ca.SX
) -> ca.SX:
    """Declare the water of a sonar at a depth [m]; return its absorption [dB/m]."""
    formula = str(given.absorption)
    if given.water not in WATERS:
        raise InputInvalid(m.name, f"water = {given.water}", " or ".join(WATERS))
    if formula not in FORMULAS:
        if given.water != "parameters":
            found = f"water = {given.water} and absorption = {given.absorption}"
            raise InputInvalid(m.name, found, f"a formula: {' or '.join(FORMULAS)}")
        return m.parameter(
            "absorption", _number(m.name, given.absorption), unit="1/m", min=0.0,
            description="of the water, dB/m one way; as the option states",
        )  # fmt: skip
    valid = absorption_range(formula, frequency)

    def water(name: str, value: float, unit: str, known_as: str = "") -> ca.SX:
        inside = valid[known_as or name]
        words = f"of the water, for its absorption by {formula}"
        return m.parameter(
            name, value, unit=unit, min=inside.low, max=inside.high, description=words
        )

    if given.water == "parameters":
        T = water("temperature", 10.0, "degC")
        S = water("salinity", 35.0, "1")
        D, pH = water("absorption_depth", 10.0, "m", "depth"), water("pH", 8.0, "1")
        return m.derived("alpha", absorption(formula, frequency, T, S, D, pH))
    pH = water("pH", 8.0, "1")
    waters = {"depth": depth}
    for name, value, unit in (("temperature", 10.0, "degC"), ("salinity", 35.0, "1")):
        m.peers[name] = f"water.{name}"
        words = f"of the water at the instrument, for its absorption by {formula}"
        waters[name] = m.input(name, unit=unit, start=value, description=words)
    held = {name: clip(x, valid[name].low, valid[name].high) for name, x in waters.items()}
    known: ca.SX | float = 1.0
    for name, x in waters.items():
        known = ca.logic_and(known, held[name] == x)
    alpha = absorption(formula, frequency, held["temperature"], held["salinity"], held["depth"], pH)
    words = "of the water in the ping, dB/m one way"
    held_output(m, ping, "absorption", alpha, unit="1/m", description=words)
    words = "the water is within the range of the formula; else the nearest values are used"
    held_output(m, ping, "water_known", known, unit="1", type="Boolean", description=words)
    return alpha


def _number(name: str, given: float | str) -> float:
    """Return the absorption [dB/m] of an option."""
    try:
        alpha = float(given)
    except ValueError:
        alpha = -1.0
    if not 0.0 <= alpha < float("inf"):
        known = ", ".join(FORMULAS)
        raise InputInvalid(name, f"absorption = {given}", f"a number [dB/m], 0 or more, or {known}")
    return alpha
