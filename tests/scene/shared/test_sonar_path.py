"""Paths of a sonar's rays: arcs in a gradient, Snell's law, travel times, tubes, mirror echoes."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.scene.shared.test_sonar import (
    BED,
    MATERIALS,
    PRESSURE,
    SOLID,
    geometry,
    intensity,
    places,
    sonar,
)
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.reflection import coherent_share, rayleigh
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry
from uuvsim_cosim.models.worlds.sonar_image import ANGLES
from uuvsim_cosim.models.worlds.sonar_path import (
    STRAIGHT,
    SonarPaths,
    profile_levels,
    profile_of_text,
)
from uuvsim_cosim.scene.shared.sonar import Sonar, Ways

Array = NDArray[np.float64]
C, GRADIENT, DEPTH = 1500.0, 0.5, 10.0  # m/s at the surface, 1/s, m of the instrument
LINEAR = [(0.0, C), (100.0, C + 100.0 * GRADIENT)]
LAYERS = [(2.0, 1510.0), (12.0, 1506.0), (15.0, 1496.0), (22.0, 1497.0)]
GRAZING = np.arcsin(np.arange(ANGLES + 1) / ANGLES)


def squared(coefficient: Any) -> Any:
    both = np.broadcast_to(np.asarray(coefficient, complex) ** 2, GRAZING.shape)
    return np.stack([both.real, both.imag], axis=-1).astype(np.float32)


def paths(
    pairs: list[tuple[float, float]] | None = None,
    segments: int = 8,
    surface: Any = None,
    bottom: Any = None,
) -> SonarPaths:
    """Return what bends and reflects the rays of a range of 200 m."""
    level = STRAIGHT.level if pairs is None else profile_levels(pairs)
    up = STRAIGHT.surface if surface is None else squared(surface)
    down = STRAIGHT.bottom if bottom is None else np.stack([squared(bottom)] * len(MATERIALS))
    return SonarPaths(level, 200.0 / segments, up, down)


def of_path(p: SonarPaths, *solids: Sphere, **options: Any) -> Sonar:
    return sonar(geometry(range_max=200.0, bins=100), *solids, paths=p, **options)


def down(*degrees: float) -> Array:
    a = np.radians(degrees)
    return np.stack([np.cos(a), 0.0 * a, np.sin(a)], axis=1)


def arcs(segments: int) -> tuple[Array, Ways]:
    """Rays at 10 m in a linear gradient: angles below the horizontal, and their ends."""
    degrees = np.array([-60.0, -20.0, -6.0, 0.0, 3.0, 8.0, 30.0, 80.0])
    s = of_path(paths(LINEAR, segments))
    return np.radians(degrees), s.ways([0.0, 0.0, DEPTH], down(*degrees))


def test_rays_are_circular_arcs_in_a_linear_gradient() -> None:
    """The centre lies where the speed would be 0. Vertices are on the arc, chords inside of it."""
    a, w = arcs(8)
    radius = (C + GRADIENT * DEPTH) / (GRADIENT * np.cos(a))
    x, z = np.hypot(*w.places[:, :2].T), w.places[:, 2]
    off = np.hypot(x - radius * np.sin(a), z + C / GRADIENT) - radius
    at_vertex = (w.kind == 3) | (w.kind == 0)  # the first level lies at the surface
    assert at_vertex.sum() == 5
    np.testing.assert_allclose(off[at_vertex], 0.0, atol=1e-9)
    assert np.all((off <= 1e-9) & (off > -(25.0**2) / 8.0 / radius - 1e-6))


def test_the_travel_time_is_that_of_the_closed_form() -> None:
    _, w = arcs(2000)
    x2, z = (w.places[:, :2] ** 2).sum(axis=1), w.places[:, 2]
    c_0, c_1 = C + GRADIENT * DEPTH, C + GRADIENT * z
    t = np.arccosh(1 + GRADIENT**2 * (x2 + (z - DEPTH) ** 2) / (2 * c_0 * c_1)) / GRADIENT
    np.testing.assert_allclose(w.range, 1500.0 * t, rtol=1e-9)


def test_the_level_in_a_linear_gradient_falls_by_the_horizontal_distance_over_the_cosine() -> None:
    a, w = arcs(2000)
    np.testing.assert_allclose(w.spread, np.hypot(*w.places[:, :2].T) / np.cos(a), rtol=1e-5)


def test_snells_invariant_is_kept_through_layers() -> None:
    level = np.array(LAYERS)
    for degrees in (-70.0, -9.0, 1.0, 5.0, 12.0, 60.0):
        w = of_path(paths(LAYERS, 64)).ways([0.0, 0.0, DEPTH], down(degrees))
        c_0, c_1 = np.interp([DEPTH, w.places[0, 2]], level[:, 0], level[:, 1])
        cosine = np.hypot(*w.directions[0, :2])
        assert cosine / c_1 * c_0 == pytest.approx(np.cos(np.radians(degrees)), abs=1e-7)


def test_a_ray_turns_where_its_cosine_is_one() -> None:
    """At the vertex, c is c_0 / cos: a ball that reaches 1 cm higher is met, a lower one is not."""
    gradient, a = 5.0, radians(8.0)
    p = paths([(0.0, 1400.0), (70.0, 1750.0)], 400)
    c_0 = 1400.0 + gradient * DEPTH
    turn = c_0 * (1 / np.cos(a) - 1) / gradient + DEPTH
    x = c_0 * np.tan(a) / gradient  # of the vertex
    for above, kind in ((0.01, 4), (-0.01, 3)):
        s = of_path(p, Sphere((x, 0.0, turn + 0.5 - above), 0.5), bed=False)
        assert s.ways([0.0, 0.0, DEPTH], down(np.degrees(a))).kind[0] == kind


def test_the_ray_tube_through_layers_is_that_of_two_neighbouring_rays() -> None:
    """On a level bed, 1 / spread² = cos a / (x |dx/da| sin b)."""
    degrees, step = np.array([20.0, 30.0, 50.0, 75.0]), 1e-3
    s = of_path(paths(LAYERS, 4000))
    low, middle, high = (
        s.ways([0.0, 0.0, DEPTH], down(*(degrees + d))) for d in (-step, 0.0, step)
    )
    assert np.all(middle.kind == 1)
    x = [np.hypot(*w.places[:, :2].T) for w in (low, middle, high)]
    slope = np.abs(x[2] - x[0]) / np.radians(2 * step)
    spread = np.sqrt(x[1] * slope * middle.directions[:, 2] / np.cos(np.radians(degrees)))
    np.testing.assert_allclose(middle.spread, spread, rtol=1e-4)
    straight = of_path(STRAIGHT).ways([0.0, 0.0, DEPTH], down(*degrees))
    assert abs(middle.spread[0] / straight.spread[0] - 1.0) > 0.01


@pytest.mark.parametrize("pairs", [[(5.0, 1500.0)], [(0.0, 1500.0), (7.0, 1500.0), (30.0, 1500.0)]])
def test_a_constant_profile_gives_the_bits_of_no_profile(pairs: list[tuple[float, float]]) -> None:
    ball = Sphere((15.0, 1.0, BED - 2.0), 1.0)
    for reflected in ({}, {"surface": -0.9, "bottom": 0.4 + 0.1j}):
        images = [
            sonar(
                geometry(beams=8, range_max=40.0, bins=200), ball, paths=paths(p, **reflected),
                absorption=0.3, noise_level=60.0,
            ).images(places(2, 8.0), np.eye(3))
            for p in (None, pairs)
        ]  # fmt: skip
        np.testing.assert_array_equal(images[0].pressure, images[1].pressure)
        np.testing.assert_array_equal(images[0].label, images[1].label)


def test_water_of_another_speed_shifts_ranges_and_absorbs_along_the_path() -> None:
    """A ball at 30 m in water of 1425 m/s, with an instrument that assumes 1500 m/s."""
    g = geometry(beams=1, swath=0.0, beam_width=radians(20), rays=128, columns=64)
    offsets = np.add([0.0, 0.0, 10.0], np.random.default_rng(2).uniform(-0.2, 0.2, (60, 3)))
    ball, levels = Sphere((30.0, 0.0, 10.0), 0.5), []
    for alpha in (0.0, 0.3):
        s = sonar(g, ball, bed=False, paths=paths([(0.0, 1425.0)]), absorption=alpha)
        found = intensity(s, offsets).mean(axis=0)[0]
        levels.append(10 * np.log10(found.sum()))
        middle = float(found @ g.ranges / found.sum())
        assert middle == pytest.approx(29.6 * 1500 / 1425, abs=0.3)
    assert levels[0] - levels[1] == pytest.approx(2 * 0.3 * 29.7, abs=0.1)


def test_the_error_of_chords_falls_by_four_with_twice_as_many() -> None:
    degrees = (10.0, 12.0, 20.0)
    ends = [
        of_path(paths(LINEAR, n)).ways([0.0, 0.0, DEPTH], down(*degrees)).places[:, 0]
        for n in (3, 6, 12, 24, 4096)
    ]
    errors = [float(np.abs(x - ends[-1]).max()) for x in ends[:-1]]
    assert errors[0] < 1.5  # m, at 94 m
    assert errors[2] < 0.2
    assert errors[3] < errors[0] / 30.0


def test_a_bed_below_a_gradient_has_its_first_echo_at_the_time_of_the_closed_form() -> None:
    g = geometry(beams=1, swath=0.0, beam_width=radians(10), elevation=radians(10), rays=96)
    straight_down = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    s = sonar(g, paths=paths([(0.0, 1450.0), (50.0, 1850.0 - 300.0)], 1000))
    found = intensity(s, np.array([[0.0, 0.0, DEPTH]]), straight_down)[0, 0]
    c_0, c_1 = 1450.0 + 2.0 * DEPTH, 1450.0 + 2.0 * BED
    wanted = 1500.0 * np.log(c_1 / c_0) / 2.0
    first = g.ranges[np.argmax(found > 0.05 * found.max())]
    assert first == pytest.approx(wanted, abs=0.15)
    assert abs(wanted - (BED - DEPTH)) > 0.1


def wide(**changed: Any) -> SonarGeometry:
    own: dict[str, Any] = {
        "beams": 1, "swath": 0.0, "beam_width": radians(20), "elevation": radians(60),
        "rays": 512, "columns": 96, "bins": 300, "range_max": 31.0,
    }  # fmt: skip
    return geometry(**own | changed)


def sent(g: SonarGeometry, angle: float) -> float:
    """Return the power of the transmitted beam at an elevation."""
    return float(np.interp(angle, g.theta, g.gain))


def mirrored(
    p: SonarPaths, ball: Sphere, place: tuple[float, float, float], bed: bool = False
) -> tuple[SonarGeometry, Array]:
    """Return the mean intensity (bins,) of a ball from places near one."""
    g = wide()
    offsets = np.random.default_rng(3).uniform(-0.05, 0.05, (50, 3)) * [1.0, 1.0, 0.2]
    return g, intensity(sonar(g, ball, bed=bed, paths=p), np.add(place, offsets)).mean(axis=0)[0]


@pytest.mark.parametrize("rms", [0.0, 2e-4])
def test_a_ball_has_a_mirror_echo_above_the_surface(rms: float) -> None:
    """At the distance of the mirror image of the ball, with the fourth power of the coefficient."""
    k = 2 * np.pi * 900e3 / 1500
    p = paths(surface=-coherent_share(GRAZING, rms, k))
    ball, depth, a = Sphere((16.0, 0.0, 5.0), 0.4), 4.0, 0.4
    g, found = mirrored(p, ball, (0.0, 0.0, depth))
    r = float(np.hypot(16.0, 9.0))
    image = (g.ranges > r - 0.8) & (g.ranges < r + 0.8)
    direct = (g.ranges > 15.0) & (g.ranges < 16.9)
    assert g.ranges[image][found[image].argmax()] == pytest.approx(r - a, abs=0.25)
    between = ~image & ~direct
    assert found[between].sum() < 1e-3 * found[image].sum()
    sine = 9.0 / r
    loss = np.exp(-2.0 * (k * rms * sine) ** 2) ** 4
    pulse = float(np.sum(g.pulse.astype(float) ** 2)) / g.fine
    strength = 2 * np.pi * a**2 * SOLID / 3
    wanted = PRESSURE**2 * strength / (r - 0.75 * a) ** 4 * pulse * sent(g, np.arcsin(sine)) * loss
    assert 10 * np.log10(found[image].sum() / wanted) == pytest.approx(0.0, abs=0.5)


def test_a_ball_has_a_mirror_echo_below_a_smooth_bed_with_its_reflection_coefficient() -> None:
    """The difference of two beds: one that reflects, and one that does not."""
    rho, nu = 1.845, 1.1782  # medium sand
    p = paths(bottom=rayleigh(GRAZING, rho, nu, 0.01))
    ball, depth, a = Sphere((8.0, 0.0, BED - 6.0), 0.4), BED - 5.0, 0.4
    r = float(np.hypot(8.0, 11.0))
    g, on = mirrored(p, ball, (0.0, 0.0, depth), bed=True)
    _, off = mirrored(paths(), ball, (0.0, 0.0, depth), bed=True)
    image = (g.ranges > r - 0.8) & (g.ranges < r + 0.8)
    elsewhere = np.abs(g.ranges - r) > 1.5
    np.testing.assert_allclose(on[elsewhere], off[elsewhere], rtol=1e-3)  # pieces of the limb
    grazing = np.arcsin(11.0 / r)
    loss = float(abs(rayleigh(grazing, rho, nu, 0.01))) ** 4
    pulse = float(np.sum(g.pulse.astype(float) ** 2)) / g.fine
    strength = 2 * np.pi * a**2 * SOLID / 3
    wanted = PRESSURE**2 * strength / (r - 0.75 * a) ** 4 * pulse * sent(g, grazing) * loss
    found = float((on - off)[image].sum())
    assert 10 * np.log10(found / wanted) == pytest.approx(0.0, abs=2.0)  # speckle of the bed


def test_a_boundary_that_reflects_nothing_gives_the_bits_of_none() -> None:
    ball = Sphere((8.0, 0.0, BED - 2.0), 1.0)
    images = [
        sonar(geometry(beams=8), ball, paths=p).images(places(2, 3.0), np.eye(3)).pressure
        for p in (STRAIGHT, paths(surface=0.0, bottom=0.0))
    ]
    np.testing.assert_array_equal(*images)


def test_a_second_bounce_is_left_out() -> None:
    s = of_path(paths(surface=-1.0, bottom=0.5))
    w = s.ways([0.0, 0.0, DEPTH], down(30.0), bounces=1)
    assert w.kind[0] == 3
    np.testing.assert_allclose(w.length, (15.0 + 25.0) / np.sin(radians(30.0)), rtol=1e-6)
    np.testing.assert_allclose(w.spread, w.length)


@pytest.mark.parametrize(
    ("pairs", "words"),
    [
        ([(0.0, 1500.0), (10.0, 1490.0), (10.0, 1480.0)], "depth 10 m after 10 m; expected depths"),
        ([(5.0, 1500.0), (0.0, 1490.0)], "depth 0 m after 5 m"),
        ([(0.0, -1500.0)], "speed -1500 m/s at 0 m; expected 1300 to 1800 m/s"),
        ([(0.0, float("nan"))], "speed nan m/s"),
        ([(-1.0, 1500.0)], "depth -1 m"),
        ([(0.0, 1400.0), (1.0, 1600.0)], "gradient 200 1/s below 0 m; expected at most 20 1/s"),
        ([], "0 levels"),
    ],
)
def test_a_wrong_profile_is_refused(pairs: list[tuple[float, float]], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        profile_levels(pairs)


@pytest.mark.parametrize("text", ["1500", "0:1500,20", "0:1500;20:1490", "deep:1500", "0:1:2"])
def test_a_profile_that_cannot_be_read_is_refused(text: str) -> None:
    with pytest.raises(InputInvalid, match="0:1500,20:1490"):
        profile_of_text(text)
