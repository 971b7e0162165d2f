"""Light of a film's frames: closed forms of the water, of plates and of shadows."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import quad

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Sphere
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.models.worlds.water_optics import water_optics
from uuvsim_cosim.view.film.renderer import (
    FARTHEST,
    HULL,
    NOTHING,
    SEABED,
    SOLID,
    SUNWARD,
    SURFACE,
    Look,
    Renderer,
)
from uuvsim_cosim.view.scene3d.scene import Body, Scene3D
from uuvsim_cosim.view.scene3d.shapes import box

Array = NDArray[np.float64]
SUN = np.array([100.0, 100.0, 90.0])
D = 6.0
PLATE = Body("plate", box(np.array([-1.0, -1.0, -0.1]), np.array([1.0, 1.0, 0.1])), "plate.eta")
LEVEL = {"plate": (np.array([0.0, 0.0, D]), np.eye(3))}


def renderer(*bodies: Body, water: str = "II", **scene: object) -> Renderer:
    return Renderer(Scene3D("made", bodies, **scene), 9, 9, water)  # type: ignore[arg-type]


def ray(r: Renderer, eye: Array, target: Array, poses: dict = LEVEL) -> tuple[Array, int, float]:
    """Return light, kind and distance of the middle pixel."""
    seen = r.seen(Look.at(eye, target), poses, 0.0)
    return seen.light[4, 4].astype(float), int(seen.kind[4, 4]), float(seen.distance[4, 4])


def veil(down: float, z: float, from_: float = D) -> Array:
    """Return the veiling light by quadrature over the ray."""
    o = water_optics("II")
    return np.array([
        quad(lambda s, c=c: o.V[c] * SUN[c] * np.exp(-o.K[c] * (from_ + s * down))
             * o.beta_B[c] * np.exp(-o.beta_B[c] * s), 0.0, z, epsabs=1e-13)[0]
        for c in range(3)
    ])  # fmt: skip


def test_water_without_end_has_the_veil_of_the_camera_along_a_level_ray() -> None:
    o = water_optics("II")
    light, kind, _ = ray(renderer(), np.array([0.0, 0.0, D]), np.array([5.0, 0.0, D]))
    expected = o.V * SUN * np.exp(-o.K * D) * (1.0 - np.exp(-o.beta_B * FARTHEST))
    assert kind == NOTHING
    np.testing.assert_allclose(light, expected, rtol=1e-6)


@pytest.mark.parametrize("down", [-0.6, 0.3, 1.0])
def test_the_veil_of_a_sloping_ray_is_the_integral_over_its_depths(down: float) -> None:
    flat = np.sqrt(1.0 - down**2)
    eye = np.array([0.0, 0.0, 300.0])
    light, kind, _ = ray(renderer(), eye, eye + np.array([flat, 0.0, down]))
    assert kind == NOTHING
    np.testing.assert_allclose(light, veil(down, FARTHEST, 300.0), rtol=1e-5)


def test_a_plate_has_the_light_of_sky_and_sun_that_its_water_leaves() -> None:
    o, eye = water_optics("II"), np.array([0.0, 0.0, D - 3.1])
    r = renderer(PLATE)
    light, kind, z = ray(r, eye, LEVEL["plate"][0])
    assert kind == HULL
    assert z == pytest.approx(3.0)
    on = SUN * np.exp(-o.K * (D - 0.1)) * (0.5 - 0.5 * SUNWARD[2])
    rho = r._rho["plate"]
    expected = rho / np.pi * on * np.exp(-o.beta_D * z) + veil(1.0, z, D - 3.1)
    np.testing.assert_allclose(light, expected, rtol=1e-5)


def test_a_hull_throws_a_shadow_that_leaves_the_light_of_the_sky() -> None:
    r = renderer(PLATE, bottom=D + 2.0, water="none")
    r_free = renderer(bottom=D + 2.0, water="none")
    spot = np.array([0.0, 0.0, D + 2.0]) - 1.9 * SUNWARD / -SUNWARD[2] * np.array([1, 1, 0])
    eye = np.array([3.5, 0.0, D + 0.5])
    shaded, kind, _ = ray(r, eye, spot)
    free, _, _ = ray(r_free, eye, spot)
    assert kind == SEABED
    np.testing.assert_allclose(shaded / free, 0.5 / (0.5 - 0.5 * SUNWARD[2]), rtol=1e-4)


def test_a_hull_is_drawn_where_its_pose_puts_it() -> None:
    r = Renderer(Scene3D("made", (PLATE,)), 180, 320, "none")
    look = Look.at(np.array([-6.0, 2.0, 3.0]), np.array([0.5, 0.5, D]))
    c, s = np.cos(0.7), np.sin(0.7)
    R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    at = np.array([0.3, -0.4, D])
    seen = r.seen(look, {"plate": (at, R)}, 0.0)
    corners = at + PLATE.hull.vertices.astype(float) @ R.T
    pixels, _ = r.projected(look, corners)
    rows, columns = np.nonzero(seen.kind == HULL)
    np.testing.assert_allclose(
        [columns.min(), columns.max() + 1, rows.min(), rows.max() + 1],
        [*np.sort(pixels[:, 0])[[0, -1]], *np.sort(pixels[:, 1])[[0, -1]]], atol=1.5,
    )  # fmt: skip


def test_exact_solids_of_the_scene_are_met_where_they_are() -> None:
    world = Scene("made", None, (Sphere((5.0, 0.0, D), 1.0),))
    r = renderer(world=world, water="none")
    _, kind, z = ray(r, np.array([0.0, 0.0, D]), np.array([5.0, 0.0, D]))
    assert (kind, z) == (SOLID, pytest.approx(4.0))


def test_the_surface_is_bright_above_and_a_mirror_beyond_the_critical_angle() -> None:
    r = renderer()
    eye = np.array([0.0, 0.0, 2.0])
    above, kind, _ = ray(r, eye, np.array([0.2, 0.0, 0.0]))
    beside, other, _ = ray(r, eye, np.array([8.0, 0.0, 0.0]))
    assert kind == other == SURFACE
    assert (above > 3.0 * beside).all()


def test_caustics_change_the_ground_and_are_off_by_default() -> None:
    bed = Terrain(np.full((2, 2), 4.0, np.float32), 100.0, (-50.0, -50.0))
    lights = []
    for strength in (0.0, 0.0, 1.0):
        r = Renderer(Scene3D("made", terrain=bed), 60, 80, "II", strength)
        look = Look.at(np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 4.0]))
        lights.append(r.seen(look, {}, 3.0).light[..., 1])
    assert (lights[0] == lights[1]).all()
    assert lights[2].std() > 1.5 * lights[0].std()
    assert lights[2].mean() == pytest.approx(lights[0].mean(), rel=0.25)


def test_a_water_type_that_is_unknown_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputInvalid, match=r"IIB.*II"):
        renderer(water="IIB")
