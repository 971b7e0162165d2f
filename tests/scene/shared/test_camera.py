"""Physics of the colour camera: attenuation, veiling light, lamps, lens, noise."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.sensors.color_camera import SUN
from uuvsim_cosim.models.worlds.camera_image import ENTERS
from uuvsim_cosim.models.worlds.obstacles import Box, Obstacle, Sphere
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.models.worlds.water_optics import WATERS, WaterOptics, spectra, water_optics
from uuvsim_cosim.scene.shared.camera import Camera, Images, Lamp, opened

Array = NDArray[np.float64]
AHEAD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # looks north, image up
BED = Terrain(np.full((2, 2), 25.0, np.float32), 4000.0, (-2000.0, -2000.0))
GREY, D = 0.18, 5.0
DARK = (0.0, 0.0, 0.0)


def camera(*solids: Obstacle, bed: bool = False, **options: Any) -> Camera:
    own: dict[str, Any] = {
        "columns": 9, "rows": 7, "focal_length": 200.0, "contrast": 0.0, "noise": False,
        "solids": np.full((len(solids), 3), GREY), "farthest": 1000.0,
    }  # fmt: skip
    return Camera(Scene("made", BED if bed else None, solids), **own | options)


def plate(z: float, half: float = 20.0) -> Box:
    """Return a grey plate that faces a camera at the origin, z ahead of it."""
    return Box((z + 0.5, 0.0, D), (0.5, half, half))


def look(c: Camera, place: tuple[float, float, float] = (0.0, 0.0, D), seed: int = 0) -> Images:
    return c.images([place], AHEAD, seed)


def middle(c: Camera) -> Array:
    """Return the radiance of the middle pixel."""
    return np.asarray(look(c).radiance[0, 3, 4])


def without(optics: WaterOptics, *names: str) -> WaterOptics:
    """Return coefficients of which some are 0."""
    return WaterOptics(**vars(optics) | {name: np.zeros(3) for name in names})


@pytest.mark.parametrize("water", WATERS)
def test_the_slope_of_each_channel_is_that_of_beer_and_lambert(water: str) -> None:
    optics = water_optics(water)
    z = np.array([0.5, 1.0, 2.0, 4.0])
    light = np.array([middle(camera(plate(d), water=without(optics, "V"))) for d in z])
    slope = -np.polyfit(z, np.log(light), 1)[0]
    np.testing.assert_allclose(slope, optics.beta_D, rtol=0.01)


@pytest.mark.parametrize("water", ["I", "III", "5C"])
def test_a_grey_plate_has_the_closed_form(water: str) -> None:
    w = water_optics(water)
    for z in np.linspace(0.5, 10.0, 20):
        E = np.array(SUN) * np.exp(-w.K * D)
        wanted = GREY / np.pi * 0.5 * E * np.exp(-w.beta_D * z)
        wanted += w.V * E * (1.0 - np.exp(-w.beta_B * z))
        np.testing.assert_allclose(middle(camera(plate(z), water=water)), wanted, rtol=0.01)


def test_infinite_water_has_the_veiling_light() -> None:
    w = water_optics("3C")
    wanted = w.V * SUN * np.exp(-w.K * D)
    np.testing.assert_allclose(middle(camera(water="3C")), wanted, rtol=1e-9)
    far = middle(camera(plate(60.0, 50.0), water="3C"))
    np.testing.assert_allclose(far, wanted, rtol=1e-4)


def test_daylight_falls_with_depth_and_a_level_face_has_twice_that_of_a_steep_one() -> None:
    w = without(water_optics("II"), "V", "beta_D")
    c = camera(bed=True, water=w, seabed=(GREY,) * 3)
    down = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = c.images([[0.0, 0.0, 10.0]], down).radiance[0, 3, 4]
    np.testing.assert_allclose(found, GREY / np.pi * np.array(SUN) * np.exp(-w.K * 25.0), rtol=1e-6)
    steep = middle(camera(plate(1.0), water=without(w, "K")))
    np.testing.assert_allclose(2.0 * steep, GREY / np.pi * np.array(SUN), rtol=1e-6)


def test_a_lamp_has_an_inverse_square_law() -> None:
    clear = without(water_optics("I"), "beta_D", "b")
    lamp = Lamp((0.0, 0.0, 0.0), (2.0, 1.0, 0.5))
    for z in (0.5, 1.0, 3.0, 9.0):
        found = middle(camera(plate(z), water=clear, sun=DARK, lamps=[lamp]))
        np.testing.assert_allclose(found, GREY / np.pi * np.array(lamp.intensity) / z**2, rtol=1e-6)


def test_a_lamp_is_attenuated_on_its_way_to_the_object_and_back() -> None:
    w = without(water_optics("3C"), "b")
    lamp = Lamp((0.3, 0.0, 0.0), (1.0, 1.0, 1.0))
    for z in (1.0, 2.0, 5.0):
        far = np.hypot(z, 0.3)
        wanted = GREY / np.pi * z / far**3 * np.exp(-w.beta_D * (z + far))
        found = middle(camera(plate(z), water=w, sun=DARK, lamps=[lamp]))
        np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_a_cone_ends_at_its_outer_angle() -> None:
    lamp = Lamp((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), inner=0.05, outer=0.1)
    w = without(water_optics("I"), "b")
    c = camera(plate(2.0), columns=101, rows=1, water=w, sun=DARK, lamps=[lamp])
    angle = np.abs(np.arctan((np.arange(101) - 50) / 200.0))
    lit = look(c).radiance[0, 0, :, 1] > 0.0
    np.testing.assert_array_equal(lit, angle < 0.1)


@pytest.mark.parametrize("side", [0.1, 0.4, 1.5])
@pytest.mark.parametrize("water", ["II", "3C", "7C"])
def test_the_light_that_water_scatters_from_a_lamp_is_the_integral(side: float, water: str) -> None:
    w, g, z = water_optics(water), 0.9, 6.0
    lamp = Lamp((side, 0.0, 0.0), (1.0, 2.0, 3.0), inner=3.0, outer=3.1)
    found = middle(
        camera(plate(z), water=w, sun=DARK, lamps=[lamp], asymmetry=g, solids=np.zeros((1, 3)))
    )

    def scattered(s: float, beta: float) -> float:
        far = np.hypot(s, side)
        phase = (1 - g * g) / (4 * np.pi * (1 + g * g + 2 * g * s / far) ** 1.5)
        return float(phase / far**2 * np.exp(-beta * (s + far)))

    wanted = [
        b * power * quad(scattered, 0.0, z, args=(beta,), limit=200, points=[side])[0]
        for b, power, beta in zip(w.b, lamp.intensity, w.beta_D, strict=True)
    ]
    np.testing.assert_allclose(found, wanted, rtol=0.002)


def test_backscatter_is_less_if_the_lamp_is_farther_from_the_camera() -> None:
    black = np.zeros((1, 3))
    near, far = (
        middle(camera(plate(3.0), sun=DARK, solids=black, lamps=[Lamp((x, 0.0, 0.0), (1.0,) * 3)]))
        for x in (0.05, 0.8)
    )
    assert (near > 4.0 * far).all()


@pytest.mark.parametrize("mean", [0.3, 3.0, 20.0, 50.0, 4000.0])
def test_the_variance_of_photon_noise_is_the_mean(mean: float) -> None:
    """By grey levels of one electron, or of several where 255 is too few."""
    gain = min(1.0, 100.0 / mean)
    c = camera(
        plate(2.0), columns=400, rows=300, focal_length=1e6, noise=True, read_noise=0.0, gain=gain,
        sensitivity=mean / float(middle(camera(plate(2.0)))[1]),
    )  # fmt: skip
    levels = look(c).image[0, :, :, 1].astype(float)
    rounding = 1.0 / 12.0 if mean >= 32.0 else 0.0
    assert levels.mean() / gain == pytest.approx(mean, rel=0.01)
    assert (levels.var() - rounding) / gain**2 == pytest.approx(mean, rel=0.02)


def test_read_noise_adds_its_variance() -> None:
    c = camera(
        plate(2.0), columns=400, rows=300, focal_length=1e6, noise=True, read_noise=6.0, gain=1.0,
        sensitivity=100.0 / float(middle(camera(plate(2.0)))[1]),
    )  # fmt: skip
    levels = look(c).image[0, :, :, 1].astype(float)
    assert levels.var() - 1 / 12 == pytest.approx(136.0, rel=0.02)


@pytest.mark.parametrize("distortion", [(0.0, 0.0), (-0.1, 0.01), (0.15, -0.02)])
def test_a_point_is_projected_within_a_hundredth_of_a_pixel(
    distortion: tuple[float, float],
) -> None:
    """Edges of a plate, found between the samples of a camera of a thousand pixels a pixel."""
    f, fine, (k1, k2) = 200.0, 1000, distortion
    for Y, X in ((0.6, 2.0), (1.4, 2.0), (1.8, 2.5)):
        wide = Box((X + 0.5, Y - 5.0, D), (0.5, 5.0, 20.0))  # its starboard edge is at Y
        c = camera(
            wide, columns=2 * 250 * fine, rows=1, focal_length=f * fine, distortion=distortion
        )
        met = look(c).label[0, 0] > 0
        edge = (np.flatnonzero(met).max() + 1 - 250 * fine) / fine
        u = Y / X
        assert edge == pytest.approx(f * u * (1 + k1 * u**2 + k2 * u**4), abs=0.01)


def test_a_flat_port_bends_rays_by_snells_law() -> None:
    """Edges of plates, as above; a point is where the ray in air and the one in water lead."""
    f, fine, n, away = 150.0, 1000, 1.34, 0.05
    for Y, X in ((0.3, 1.0), (0.9, 1.5), (2.0, 2.5)):
        wide = Box((X + 0.5, Y - 5.0, D), (0.5, 5.0, 20.0))
        c = camera(wide, columns=2 * 250 * fine, rows=1, focal_length=f * fine, port=away)
        met = look(c).label[0, 0] > 0
        edge = (np.flatnonzero(met).max() + 1 - 250 * fine) / fine

        def beside(u: float, X: float = X, Y: float = Y) -> float:
            sine = u / np.hypot(1.0, u) / n
            return float(away * u + (X - away) * sine / np.sqrt(1.0 - sine**2) - Y)

        assert edge == pytest.approx(f * brentq(beside, 0.0, 10.0), abs=0.01)


def test_depth_behind_a_port_is_from_the_lens() -> None:
    seen = look(camera(plate(3.0), port=0.1, focal_length=5.0))
    np.testing.assert_allclose(seen.depth, 3.0, rtol=1e-6)


def test_rows_of_a_rolling_shutter_are_those_of_images_at_their_own_poses() -> None:
    solids = Sphere((4.0, 0.3, D), 1.0), plate(8.0)
    size: dict[str, Any] = {"columns": 40, "rows": 30, "focal_length": 40.0}
    lamp = Lamp((0.2, 0.1, 0.0), (1.0, 1.0, 1.0))
    v, w, step = np.array([0.5, 1.0, -0.3]), np.array([0.2, -0.3, 0.8]), 0.002
    rolling = camera(*solids, **size, row_time=step, lamps=[lamp])
    place = np.array([0.0, 0.0, D])
    found = rolling.images([place], AHEAD, velocities=[[*v, *w]])
    still = camera(*solids, **size, lamps=[lamp])
    for i in range(30):
        dt = (i - 29) * step
        R = Rotation.from_rotvec(w * dt).as_matrix() @ AHEAD
        one = still.images([place + v * dt], R)
        np.testing.assert_allclose(found.radiance[0, i], one.radiance[0, i], rtol=1e-5)
        np.testing.assert_allclose(found.depth[0, i], one.depth[0, i], rtol=1e-5)
    assert np.abs(found.depth - look(still).depth).max() > 1.0


def test_a_rolling_shutter_of_a_camera_at_rest_shows_nothing() -> None:
    solids = Sphere((4.0, 0.3, D), 1.0), plate(8.0)
    one, other = (look(camera(*solids, row_time=t)).radiance for t in (0.0, 0.01))
    np.testing.assert_array_equal(one, other)


def look_up(depth: float = 3.0, **options: Any) -> tuple[Array, Array]:
    """Return what is straight above in clear water: angles from the zenith, and radiance."""
    w = without(water_optics("I"), *({"beta_D", "beta_B", "V", "K", "b"} - options.keys()))
    options.pop("beta_D", None)
    c = camera(columns=801, rows=1, focal_length=200.0, water=w, **options)
    up = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
    found = c.images([[0.0, 0.0, depth]], up).radiance[0, 0]
    return np.arctan(np.abs(np.arange(801) - 400) / 200.0), found


def test_the_sky_is_seen_in_a_window_of_48_degrees_around_the_zenith() -> None:
    angle, light = look_up()
    np.testing.assert_array_equal(light[:, 1] > 0.0, angle < np.arcsin(1.0 / 1.34))
    assert np.degrees(np.arcsin(1.0 / 1.34)) == pytest.approx(48.3, abs=0.05)


def test_the_sky_at_the_zenith_is_brighter_by_the_square_of_the_index() -> None:
    _, light = look_up()
    mirror = (0.34 / 2.34) ** 2
    wanted = 1.34**2 * (1.0 - mirror) / (np.pi * ENTERS) * np.array(SUN)
    np.testing.assert_allclose(light[400], wanted, rtol=1e-9)


def test_the_light_of_the_window_is_the_daylight_below_the_surface() -> None:
    angle, light = look_up()
    half, L = angle[400:], light[400:, 1]
    E = 2.0 * np.pi * np.trapezoid(L * np.sin(half) * np.cos(half), half)
    assert pytest.approx(SUN[1], rel=0.003) == E


def test_light_from_the_surface_is_attenuated_on_its_way() -> None:
    near, far = (look_up(d, beta_D=True)[1][400] for d in (1.0, 4.0))
    np.testing.assert_allclose(np.log(near / far) / 3.0, water_optics("I").beta_D, rtol=1e-9)


def test_beyond_the_window_the_surface_mirrors_the_seabed() -> None:
    w = without(water_optics("I"), "beta_D", "beta_B", "V", "K", "b")
    c = camera(bed=True, water=w, columns=60, rows=5, focal_length=300.0, seabed=(GREY,) * 3)
    up = np.deg2rad(25.0)  # looks north, 65 degrees from the zenith
    tilt = [[0.0, np.sin(up), np.cos(up)], [1.0, 0.0, 0.0], [0.0, np.cos(up), -np.sin(up)]]
    found = c.images([[0.0, 0.0, 4.0]], tilt).radiance[0]
    np.testing.assert_allclose(found, np.broadcast_to(GREY / np.pi * np.array(SUN), found.shape))


def test_normals_are_unit_vectors_in_the_axes_of_the_camera() -> None:
    c = camera(Sphere((5.0, 0.0, D), 1.0), columns=201, rows=3, focal_length=150.0)
    seen = look(c)
    np.testing.assert_allclose(seen.normal[0, 1, 100], [0.0, 0.0, -1.0], atol=1e-6)
    met = seen.label[0] > 0
    np.testing.assert_allclose(np.linalg.norm(seen.normal[0][met], axis=-1), 1.0, rtol=1e-6)
    u = (np.arange(201) - 100) / 150.0
    z = seen.depth[0, 1].astype(float)
    point = np.stack([u * z, 0.0 * z, z - 5.0], axis=-1)[met[1]]
    np.testing.assert_allclose(seen.normal[0, 1][met[1]], point, atol=1e-5)
    assert not seen.normal[0][~met].any()


def test_the_disparity_of_two_cameras_is_focal_length_times_base_over_depth() -> None:
    """Edges of plates that two cameras of a rig see, within 0.01 pixel."""
    f, fine, base = 200.0, 1000, 0.12
    c = [camera(Box((z + 0.5, 0.2 - 5.0, D), (0.5, 5.0, 20.0)), columns=200 * fine, rows=1,
                focal_length=f * fine) for z in (1.0, 2.5, 7.0)]  # fmt: skip
    for each, z in zip(c, (1.0, 2.5, 7.0), strict=True):
        left, right = (
            np.flatnonzero(look(each, (0.0, y, D)).label[0, 0]).max() / fine for y in (0.0, base)
        )
        assert left - right == pytest.approx(f * base / z, abs=0.01)


def test_every_option_of_the_compiler_gives_the_same_bits(tmp_path: Path) -> None:
    solids = Sphere((4.0, 0.3, D), 1.0), plate(8.0)
    c = camera(
        *solids, bed=True, columns=40, rows=30, focal_length=30.0, contrast=0.5, noise=True,
        port=0.05, row_time=0.001, lamps=[Lamp((0.2, 0.1, 0.0), (1.0, 1.0, 1.0))],
    )  # fmt: skip
    source = content("fmus", "kernels") / "camera_batch.c"
    seen = []
    for flags in ((), ("-O0",), ("-O3", *processor_flags(False))):
        c._c = opened(compile_shared([source], name="c", include=runtime(), flags=flags))
        seen.append(c.images([[0.0, 0.0, D]], AHEAD, velocities=[0.1] * 6))
    for other in seen[1:]:
        for name, values in vars(seen[0]).items():
            np.testing.assert_array_equal(values, getattr(other, name))


def test_depth_is_along_the_view_and_labels_name_what_is_met() -> None:
    c = camera(Sphere((5.0, 0.0, D), 1.0), plate(8.0), columns=201, rows=3, focal_length=150.0)
    seen = look(c)
    assert seen.depth[0, 1, 100] == pytest.approx(4.0)
    np.testing.assert_allclose(seen.depth[0, 1, :20], 8.0, rtol=1e-6)
    assert set(np.unique(seen.label)) == {2, 3}


def test_an_equal_pose_gives_equal_bits_and_another_seed_another_noise() -> None:
    c = camera(bed=True, columns=64, rows=48, focal_length=40.0, noise=True, contrast=0.5)
    one, same, other = (look(c, seed=k) for k in (1, 1, 2))
    np.testing.assert_array_equal(one.image, same.image)
    np.testing.assert_array_equal(one.radiance, same.radiance)
    np.testing.assert_array_equal(one.radiance, other.radiance)
    assert (one.image != other.image).any()


def test_texture_is_fixed_to_the_world_and_drawn_by_its_seed() -> None:
    options: dict[str, Any] = {"bed": True, "columns": 40, "rows": 40, "contrast": 0.5}
    down = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    w = without(water_optics("I"), "beta_D", "beta_B", "V")
    c = camera(**options, water=w, focal_length=40.0)
    one = c.images([[0.0, 0.0, 21.0]], down).radiance[0]
    moved = c.images([[1.0, 0.0, 21.0]], down).radiance[0]  # 10 pixels to the north
    np.testing.assert_allclose(moved[10:], one[:-10], rtol=0.02)
    other = camera(**options, water=w, focal_length=40.0, texture_seed=7)
    assert np.abs(other.images([[0.0, 0.0, 21.0]], down).radiance[0] / one - 1.0).max() > 0.1


def test_attenuation_and_backscatter_differ_and_lie_within_the_spectrum() -> None:
    for water in WATERS:
        w, (_, a, b) = water_optics(water), spectra(water)
        assert (w.beta_D != w.beta_B).all()
        for beta in (w.beta_D, w.beta_B):
            assert (beta > (a + b).min()).all()
            assert (beta < (a + b).max()).all()


def test_the_spectrum_of_a_type_has_the_diffuse_attenuation_of_the_table() -> None:
    for water in WATERS:
        K, a, b = spectra(water)
        np.testing.assert_allclose(np.sqrt(a * a + 0.235 * a * b), K, rtol=1e-12)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        ((0.0, 0.0, -1.0), "above the water"),
        ((0.0, 0.0, 26.0), "below the seabed at 25 m"),
        ((5.0, 0.0, D), "in the obstacle ball"),
        ((np.nan, 0.0, D), "not finite"),
    ],
)
def test_a_place_out_of_the_water_is_refused(place: tuple[float, float, float], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        look(camera(Sphere((5.0, 0.0, D), 1.0, name="ball"), bed=True), place)


def test_wrong_numbers_are_refused_by_one_message() -> None:
    for options, words in (
        ({"focal_length": 0.0}, "focal length 0 pixels; expected more than 0"),
        ({"columns": 0}, "0 x 7 pixels"),
        ({"port": -0.1}, "port at -0.1 m"),
        ({"row_time": np.nan}, "row_time = nan s"),
        ({"lamps": [Lamp((0.0,) * 3, (1.0,) * 3)] * 17}, "17 lamps; expected 16 at most"),
        ({"water": "IV"}, "water: 'IV'"),
        ({"solids": np.zeros((3, 3))}, "3 reflectances"),
    ):
        with pytest.raises(InputInvalid, match=words):
            camera(**options)


def test_images_that_are_larger_than_memory_are_refused() -> None:
    with pytest.raises(InputInvalid, match=r"fit into memory; these need 4[\d,]* GiB"):
        look(camera(columns=10_000_000, rows=10_000_000))
