"""Physics of the sonar's images: levels, speckle, beams, range resolution, shadows."""

from __future__ import annotations

from functools import partial
from math import radians, sin
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import stats

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.worlds.obstacles import Box, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.sonar_geometry import (
    SHADINGS,
    SonarGeometry,
    array_pattern,
    sonar_geometry,
)
from uuvsim_cosim.models.worlds.sonar_image import Surfaces
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared import sonar as shared_sonar
from uuvsim_cosim.scene.shared.sonar import Sonar

Array = NDArray[np.float64]
MU, SOLID = 10.0**-2.7, 0.1  # Lambert's coefficient of the bed and of solids
BED = 25.0  # m
PRESSURE = 1e-6 * 10 ** (220 / 20)  # Pa at 1 m
LEVEL = Terrain(np.full((2, 2), BED, np.float32), 4000.0, (-2000.0, -2000.0))
MATERIALS = np.array([[MU], [SOLID]]) * np.sin(np.linspace(0.0, np.pi / 2, 91)) ** 2


def geometry(**changed: Any) -> SonarGeometry:
    own: dict[str, Any] = {
        "beams": 64, "swath": radians(90), "beam_width": radians(2), "shading": "none",
        "elevation": radians(20), "bins": 600, "range_min": 1.0, "range_max": 61.0,
        "resolution": 0.1, "rays": 48,
    }  # fmt: skip
    return sonar_geometry(**own | changed)


def sonar(g: SonarGeometry, *solids: Obstacle, bed: bool = True, **options: Any) -> Sonar:
    scene = Scene("made", LEVEL if bed else None, solids)
    surfaces = Surfaces(MATERIALS, np.zeros((0, 0), np.uint8), np.ones(len(solids), np.uint8))
    return Sonar(scene, g, surfaces, **{"frequency": 900e3, "noise_level": -np.inf} | options)


def places(n: int, height: float, seed: int = 0) -> Array:
    """Return n places within 100 m at a height over the bed."""
    rng = np.random.default_rng(seed)
    return np.c_[rng.uniform(-50, 50, (n, 2)), np.full(n, BED - height)]


def intensity(s: Sonar, positions: Array, R: Array | None = None) -> Array:
    pressure = s.images(positions, np.eye(3) if R is None else R).pressure
    return np.asarray(np.abs(pressure.astype(complex)) ** 2)


def of_bed(g: SonarGeometry, height: float, beam: int, r: float, alpha: float) -> float:
    """Return the mean intensity of a level Lambert bed, by the integral over the horizontal angle.

    The ring of the bed at the slant range r has the area r dr dpsi.
    """
    psi = np.linspace(-np.pi / 2, np.pi / 2, 20_001)
    u = np.sqrt(r * r - height * height) / r * np.sin(psi)
    down = height / r / np.sqrt(1.0 - u * u)  # sine of the elevation
    lit = np.abs(np.arcsin(np.clip(down, -1, 1))) < radians(20)
    sent = np.sinc(down * 0.885893 / (2 * sin(radians(10)))) ** 2 * lit
    received = array_pattern(u - sin(g.bearings[beam]), radians(2)) ** 2
    received = received * (np.abs(u) <= g.u.max() + g.du[-1] / 2)
    ring = np.trapezoid(MU * (height / r) ** 2 * sent * received, psi)
    pulse = float(np.sum(g.pulse.astype(float) ** 2)) / g.fine * g.step
    return float(PRESSURE**2 * ring * pulse / r**3 * 10 ** (-0.2 * alpha * r))


@pytest.mark.parametrize(("frequency", "alpha"), [(100e3, 0.034), (400e3, 0.11), (1200e3, 0.5)])
def test_the_level_of_a_flat_lambert_bed_is_that_of_the_closed_form(
    frequency: float, alpha: float
) -> None:
    g = geometry()
    s = sonar(g, frequency=frequency, absorption=alpha)
    found = intensity(s, places(30, 1.0))
    for r in (5.0, 7.0, 10.0, 20.0, 30.0, 40.0, 50.0):
        near = np.flatnonzero(np.abs(g.ranges - r) < 0.02 * r)
        wanted = np.mean([of_bed(g, 1.0, b, g.ranges[i], alpha) for b in (8, 32, 50) for i in near])
        error = 10 * np.log10(found[:, 6:58, near].mean() / wanted)
        assert abs(error) < 0.5, (r, error)


def test_a_sphere_falls_by_40_log_r_and_a_bed_by_30_log_r() -> None:
    g = geometry(beams=16, swath=radians(24), rays=192, columns=240)
    echoes = []
    rng = np.random.default_rng(1)
    for r in (10.0, 40.0):
        seen = []
        for _ in range(12):  # other places of the world have other scatterers
            place = np.array([*rng.uniform(-50.0, 50.0, 2), 10.0])
            ball = sonar(g, Sphere((place[0] + r, place[1], 10.0), 0.5), bed=False)
            offsets = rng.uniform(-0.3, 0.3, (30, 3))
            seen.append(intensity(ball, place + offsets).sum(axis=(1, 2)).mean())
        echoes.append(np.mean(seen))
    decades = np.log10((40.0 - 0.375) / (10.0 - 0.375))  # of what is met on the sphere
    assert 10 * np.log10(echoes[0] / echoes[1]) / decades == pytest.approx(40, abs=0.5)
    # A bed at a constant angle of incidence: its height grows with the range.
    echoes = []
    g = geometry()
    for r in (10.0, 40.0):
        near = np.abs(g.ranges - r) < 0.02 * r
        echoes.append(intensity(sonar(g), places(40, 0.15 * r))[:, 6:58, near].mean())
    assert 10 * np.log10(echoes[0] / echoes[1]) / np.log10(4) == pytest.approx(30, abs=1.0)


def test_a_rough_spheres_level_is_that_of_its_target_strength() -> None:
    """A sphere of Lambert's law has the cross section 2 pi a² mu / 3."""
    g = geometry(beams=1, swath=0.0, beam_width=radians(20), rays=256, columns=256)
    s = sonar(g, Sphere((20.0, 0.0, 10.0), 0.5), bed=False)
    offsets = np.random.default_rng(2).uniform(-0.2, 0.2, (300, 3))
    found = intensity(s, np.add([0.0, 0.0, 10.0], offsets)).sum(axis=(1, 2)).mean()
    pulse = float(np.sum(g.pulse.astype(float) ** 2)) / g.fine
    wanted = PRESSURE**2 * (2 * np.pi * 0.5**2 * SOLID / 3) / 19.7**4 * pulse
    assert 10 * np.log10(found / wanted) == pytest.approx(0.0, abs=0.5)


@pytest.fixture(scope="module")
def speckle() -> Array:
    """Intensities over their mean, of pixels that are independent of each other."""
    g = geometry(beams=22, shading="hann", beam_width=radians(3))
    found = intensity(sonar(g), places(60, 2.0, 3))[:, 1:-1:2, 200:500:3]
    return np.asarray((found / found.mean(axis=(0, 1))).ravel())


def test_speckle_has_the_contrast_1(speckle: Array) -> None:
    assert speckle.std() == pytest.approx(1.0, abs=0.03)


def test_five_percent_of_the_intensities_exceed_three_times_the_mean(speckle: Array) -> None:
    assert np.mean(speckle > 3.0) == pytest.approx(np.exp(-3.0), abs=0.003)


def test_amplitudes_follow_rayleighs_law(speckle: Array) -> None:
    amplitude = np.sqrt(speckle[::7])
    assert stats.kstest(amplitude, stats.rayleigh(scale=np.sqrt(0.5)).cdf).pvalue > 0.01


def test_the_phase_is_uniform() -> None:
    g = geometry(beams=22, shading="hann", beam_width=radians(3))
    phase = np.angle(sonar(g).images(places(40, 2.0, 4), np.eye(3)).pressure[:, 1:-1:2, 200:500:3])
    assert stats.kstest(phase.ravel()[::7], stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01


def beam(shading: str) -> tuple[Array, Array]:
    """Return the sines of 1501 beams of 2 degrees, and their level [dB] of a small sphere ahead."""
    g = geometry(
        beams=1501, swath=radians(30), shading=shading, columns=4000, rays=301,
        elevation=radians(1), bins=40, range_min=19, range_max=21, resolution=0.05,
    )  # fmt: skip
    s = sonar(g, Sphere((20.0, 0.0, 10.0), 0.02), bed=False)
    image = intensity(s, np.array([[0.0, 0.0, 10.0]]))[0]
    echo = image[:, image.max(axis=0).argmax()]
    return np.sin(g.bearings), 10 * np.log10(np.maximum(echo / echo.max(), 1e-12))


@pytest.mark.parametrize(
    ("shading", "lobe"), [("none", -13.26), ("hamming", -42.7), ("hann", -31.5)]
)
def test_a_beam_has_its_width_and_its_side_lobes(shading: str, lobe: float) -> None:
    u, level = beam(shading)
    wide = u[level > -3.0103]
    assert wide[-1] - wide[0] == pytest.approx(2 * sin(radians(1)), rel=0.03)
    if shading == "none":  # 0.886 lambda / L
        assert array_pattern(
            np.array([0.5 * 0.885893 * 0.04]), 2 * np.arcsin(0.5 * 0.885893 * 0.04)
        )[0] == pytest.approx(np.sqrt(0.5), rel=1e-5)
    length = SHADINGS[shading][1] / (2 * sin(radians(1)))  # in lambda
    first = {"none": 1.0, "hamming": 2.0, "hann": 2.0}[shading] / length  # its first zero
    outside = level[np.abs(u) > 1.05 * first]
    assert outside.max() == pytest.approx(lobe, abs=0.6)


@pytest.mark.parametrize("bandwidth", [5e3, 20e3])
def test_the_range_resolution_is_c_over_twice_the_bandwidth(bandwidth: float) -> None:
    """The response has its zeros there, and two targets at 1.5 times it are two peaks."""
    resolution = 1500.0 / (2 * bandwidth)
    g = geometry(
        beams=1, swath=0.0, bins=400, range_min=20 - 5 * resolution, range_max=20 + 5 * resolution,
        resolution=resolution, rays=401, columns=401,
        beam_width=radians(0.2), elevation=radians(0.2),
    )  # fmt: skip
    s = sonar(g, Sphere((20.0, 0.0, 10.0), 0.004), bed=False)
    echo = np.sqrt(intensity(s, np.array([[0.0, 0.0, 10.0]]))[0, 0])
    echo /= echo.max()
    middle = g.ranges[echo.argmax()]
    near = np.abs(g.ranges - middle) < 1.4 * resolution
    ahead = near & (g.ranges > middle)
    zero = g.ranges[ahead][echo[ahead].argmin()] - middle
    assert zero == pytest.approx(resolution, rel=0.05)
    assert middle == pytest.approx(20.0, abs=0.05 * resolution + 0.01)


def test_a_shadow_has_the_length_of_geometry() -> None:
    """A wall of height H at the distance d casts a shadow to d h / (h - H)."""
    h, H, d = 4.0, 1.0, 12.0
    g = geometry(beams=9, swath=radians(8), rays=768, bins=1000, range_max=26.0, resolution=0.025)
    wall = Box((d + 0.05, 0.0, BED - H / 2), (0.05, 40.0, H / 2), 0.0)
    rng = np.random.default_rng(5)
    positions = np.c_[np.zeros(80), rng.uniform(-5, 5, 80), np.full(80, BED - h)]
    tilt = radians(12)
    R = np.array([[np.cos(tilt), 0, -np.sin(tilt)], [0, 1, 0], [np.sin(tilt), 0, np.cos(tilt)]])
    found = intensity(sonar(g, wall), positions, R)[:, 4].mean(axis=0)
    far = (d + 0.1) * h / (h - H)  # of the wall's far upper edge
    end = np.hypot(far, h)
    lit = found[(g.ranges > end + 0.3) & (g.ranges < end + 1.5)].mean()
    dark = (g.ranges > end - 2.0) & (g.ranges < end + 0.5)
    measured = g.ranges[dark][np.argmax(found[dark] > lit / 2)]
    assert measured == pytest.approx(end, abs=0.05)
    assert found[(g.ranges > end - 2.0) & (g.ranges < end - 0.2)].mean() < 1e-3 * lit


def test_equal_poses_give_equal_bits_in_any_order() -> None:
    s = sonar(geometry(beams=8), Sphere((8.0, 0.0, BED), 1.0))
    three = places(3, 2.0)
    forward = s.images(three, np.eye(3)).pressure
    backward = s.images(three[::-1], np.eye(3)).pressure[::-1]
    np.testing.assert_array_equal(forward, backward)


def test_speckle_stands_still_with_the_scene() -> None:
    """A step of a tenth of a millimetre changes it little, one of a metre wholly."""
    s = sonar(geometry(beams=16), frequency=100e3)
    start = places(1, 2.0)
    images = [
        s.images(np.add(start, [0.0, step, 0.0]), np.eye(3)).pressure[0, :, 100:400].ravel()
        for step in (0.0, 1e-4, 1.0)
    ]
    like = [
        abs(np.vdot(images[0], i)) / np.linalg.norm(images[0]) / np.linalg.norm(i) for i in images
    ]
    assert like[1] > 0.9
    assert like[2] < 0.2


def test_the_rounding_of_a_pose_does_not_change_the_speckle_of_a_bed_at_a_round_depth() -> None:
    """The bed at 25 m would lie on the border of two cells of any size below 1 m."""
    s = sonar(geometry(rays=24, beams=16))
    place = np.array([[3.0, 4.0, 15.0]])
    shifts = np.random.default_rng(3).uniform(-1e-12, 1e-12, (6, 3))
    images = [s.images(p, np.eye(3)).pressure.astype(complex) for p in (place, *(place + shifts))]
    for image in images[1:]:
        np.testing.assert_allclose(image, images[0], atol=1e-4 * np.abs(images[0]).max())


def test_the_error_falls_with_the_rays_of_a_beam() -> None:
    """Relief: what few rays show, against what many show."""
    x = np.arange(200) * 0.5
    z = BED - 1.0 + 0.5 * np.sin(x[:, None] / 1.3) * np.cos(x[None, :] / 1.7)
    relief = Scene("relief", Terrain(z.astype(np.float32), 0.5, (-50.0, -50.0)))
    surfaces = Surfaces(MATERIALS, np.zeros((0, 0), np.uint8), np.zeros(0, np.uint8))
    at = np.random.default_rng(6).uniform(-5, 5, (12, 2))
    positions = np.c_[at, np.full(12, BED - 4.0)]
    means = []
    for rays in (8, 32, 128, 1024):
        g = geometry(beams=32, bins=60, range_max=31.0, resolution=0.5, rays=rays)
        means.append(intensity(Sonar(relief, g, surfaces, frequency=900e3), positions).mean(axis=0))
    bright = means[-1] > 0.01 * means[-1].max()
    errors = [float(np.mean(np.abs(np.log10(m[bright] / means[-1][bright])))) for m in means[:3]]
    assert errors[0] > errors[1]
    assert abs(10 * np.log10(means[1][bright].sum() / means[-1][bright].sum())) < 0.5


def test_labels_are_what_is_in_the_picture() -> None:
    g = geometry(beams=31, swath=radians(60), bins=200, range_max=21.0)
    found = sonar(g, Sphere((10.0, 0.0, BED - 0.5), 0.5)).images(
        places(1, 2.0) * [0, 0, 1], np.eye(3)
    )
    label = found.label[0]
    beams, bins = np.nonzero(label == 2)
    assert np.abs(g.bearings[beams]).max() < np.arctan(0.5 / 9.5) + radians(2)
    assert np.all(np.abs(g.ranges[bins] - 10.0) < 1.0)
    assert (label == 1).any()
    assert (label[:, :10] == 0).all()


def test_noise_has_its_absolute_level() -> None:
    s = sonar(geometry(), bed=False, noise_level=80.0)
    found = s.images(places(2, 2.0), np.eye(3))
    assert 10 * np.log10(
        np.mean(np.abs(found.pressure.astype(complex)) ** 2) * 1e12
    ) == pytest.approx(80.0, abs=0.1)
    assert not found.range.any()
    other = s.images(places(2, 2.0), np.eye(3), seed=1)
    assert abs(np.corrcoef(found.magnitude.ravel(), other.magnitude.ravel())[0, 1]) < 0.02


@pytest.mark.parametrize(("tvg", "fall"), [(0, 30), (20, 10), (30, 0), (40, -10)])
def test_the_gain_raises_by_its_power_of_the_range_and_by_the_absorption(
    tvg: int, fall: int
) -> None:
    g = geometry()
    s = sonar(g, tvg=tvg, absorption=0.2)
    levels = [
        intensity(s, places(20, 0.15 * r))[:, 6:58, np.abs(g.ranges - r) < 0.03 * r].mean()
        for r in (10.0, 40.0)
    ]
    lost = 0.4 * 30.0 if tvg == 0 else 0.0  # dB, two ways
    assert 10 * np.log10(levels[0] / levels[1]) == pytest.approx(fall * np.log10(4) + lost, abs=0.6)


def test_the_phase_turns_by_twice_the_wave_number() -> None:
    """Steps of 50 um toward a small ball at 55 m, which is 88,000 turns of phase away."""
    g = geometry(
        beams=1, swath=0.0, beam_width=radians(0.3), elevation=radians(0.3), columns=15, rays=15,
        range_min=50.0, range_max=60.0, bins=100,
    )  # fmt: skip
    s = sonar(g, Sphere((55.0, 0.0, 10.0), 0.05), bed=False, frequency=1.2e6)
    steps = 5e-5 * np.arange(6)
    found = s.images(np.c_[steps, np.zeros(6), np.full(6, 10.0)], np.eye(3)).pressure[:, 0]
    strongest = np.abs(found[0]).argmax()
    turned = np.unwrap(np.angle(found[:, strongest]))
    np.testing.assert_allclose(turned - turned[0], -4 * np.pi * 1.2e6 / 1500 * steps, atol=0.02)


def test_bits_do_not_depend_on_the_instructions_of_a_processor(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    g = geometry(beams=9, bins=101, range_max=30.0)
    hashes = set()
    for flags in ((), ("-O0",), ("-O3", *processor_flags(False))):
        library = compile_shared(
            [content("fmus", "kernels") / "sonar_batch.c"],
            name="sonar_batch", include=runtime(), flags=flags,
        )  # fmt: skip
        monkeypatch.setattr(shared_sonar, "_library", partial(shared_sonar.opened, library))
        s = sonar(g, Sphere((12.0, 0.0, BED), 1.0), noise_level=60.0, absorption=0.3, tvg=30)
        found = s.images(places(2, 3.0), np.eye(3))
        hashes.add(found.pressure.tobytes() + found.label.tobytes() + found.magnitude.tobytes())
    assert len(hashes) == 1


def test_a_single_scatterer_has_an_amplitude_by_rayleighs_law() -> None:
    """One ray that meets a wall at right angles, at many places of it."""
    g = geometry(
        beams=1, swath=0.0, beam_width=radians(0.1), elevation=radians(0.1), columns=1, rays=1,
        range_max=21.0, bins=100,
    )  # fmt: skip
    s = sonar(g, Box((12.0, 0.0, 10.0), (0.1, 40.0, 10.0), 0.0), bed=False)
    at = np.random.default_rng(8).uniform(-5, 5, (2000, 2))
    found = intensity(s, np.c_[np.zeros(2000), at[:, 0], 10.0 + at[:, 1]]).max(axis=(1, 2))
    amplitude = np.sqrt(found / found.mean())
    assert stats.kstest(amplitude, stats.rayleigh(scale=np.sqrt(0.5)).cdf).pvalue > 0.01


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ([0.0, 0.0, -1.0], r"\(0, 0, -1\) m; expected finite numbers, and D of 0 or more"),
        ([0.0, np.nan, 1.0], "finite numbers"),
        ([8.0, 0.0, 20.0], "is in the obstacle number 0; expected a place in the water"),
    ],
)
def test_a_sonar_out_of_the_water_is_refused(place: list[float], words: str) -> None:
    s = sonar(geometry(beams=8), Sphere((8.0, 0.0, 20.0), 1.0))
    with pytest.raises(InputInvalid, match=words):
        s.images([[0.0, 0.0, 10.0], place], np.eye(3))
