"""Rays against closed forms, against Embree on the same triangles, and where there is nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Sphere
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.ray_casting import BELOW, NOTHING, SEABED, SOLID, SURFACE, Caster

ROUGH = 60  # nodes a side


def plane(n: int = 11, a: float = 0.0, b: float = 0.0, z0: float = 10.0, h: float = 2.0) -> Terrain:
    """Z = z0 + a N + b E, of n x n nodes about the origin."""
    x = (np.arange(n) - (n - 1) / 2) * h
    z = z0 + a * x[:, None] + b * x[None, :]
    return Terrain(z.astype(np.float32), h, (float(x[0]), float(x[0])))


def rough(seed: int = 1) -> Terrain:
    rng = np.random.default_rng(seed)
    z = 30.0 + np.cumsum(np.cumsum(rng.normal(size=(ROUGH, ROUGH)), 0) * 0.05, 1)
    return Terrain(z.astype(np.float32), 3.0, (-50.0, -70.0))


def rays_over(t: Terrain, n: int, seed: int = 2) -> tuple[Any, Any]:
    """Origins within the terrain, above it and under water, and unit directions, mostly down."""
    rng, (n0, n1, e0, e1) = np.random.default_rng(seed), t.extent
    d = rng.normal(size=(n, 3)) * (1, 1, 0.5)
    d[:, 2] = np.abs(d[:, 2])
    o = np.column_stack([rng.uniform(n0, n1, n), rng.uniform(e0, e1, n), rng.uniform(1, 15, n)])
    return o, d / np.linalg.norm(d, axis=1)[:, None]


def one(scene: Any, o: Any, d: Any, far: float = np.inf) -> tuple[float, int]:
    t, kind = Caster(scene).cast(o, [d], far)
    return float(t[0]), int(kind[0])


def test_a_level_bed_is_at_its_height_along_any_ray() -> None:
    o, d = rays_over(plane(), 500)
    o *= (0.2, 0.2, 0.5)
    t, kind = Caster(plane()).cast(o, d)
    wanted = (10.0 - o[:, 2]) / d[:, 2]
    inside = np.all(np.abs((o + wanted[:, None] * d)[:, :2]) < 9.99, axis=1)
    assert inside.sum() > 100
    np.testing.assert_allclose(t[inside], wanted[inside], rtol=1e-13)
    assert np.all(kind[inside] == SEABED)


@pytest.mark.parametrize(("a", "b"), [(0.5, 0.0), (0.0, -0.25), (0.5, 0.75)])
def test_a_ramp_is_met_where_its_plane_is(a: float, b: float) -> None:
    o, d = rays_over(plane(a=a, b=b), 500)
    o = o * (0.3, 0.3, 0.0) + (0, 0, 1)
    t, kind = Caster(plane(a=a, b=b)).cast(o, d)
    wanted = (10 + o @ (a, b, -1)) / (d @ (-a, -b, 1))
    met = kind == SEABED
    assert met.sum() > 50
    np.testing.assert_allclose(t[met], wanted[met], rtol=1e-12)


@pytest.mark.parametrize(
    ("solid", "o", "d", "wanted"),
    [
        (Sphere((5, 0, 5), 2.0), (0, 0, 5), (1, 0, 0), 3.0),
        (Sphere((5, 0, 5), 2.0), (5, 0, 5), (1, 0, 0), 2.0),  # from within: the far side
        (Box((5, 0, 5), (1, 2, 3)), (0, 1.5, 5), (1, 0, 0), 4.0),
        (Box((5, 0, 5), (1, 1, 1), np.pi / 4), (0, 0, 5), (1, 0, 0), 5 - np.sqrt(2)),
        (Capsule((5, -2, 5), (5, 2, 5), 0.5), (0, 1, 5), (1, 0, 0), 4.5),
        (Capsule((5, -2, 5), (5, 2, 5), 0.5), (5, -9, 5), (0, 1, 0), 6.5),
        (Cylinder((5, 0, 5), 1.0, 2.0), (0, 0, 6), (1, 0, 0), 4.0),
        (Cylinder((5, 0, 5), 1.0, 2.0), (5.5, 0, 1), (0, 0, 1), 2.0),
    ],
)
def test_a_solid_is_met_where_geometry_says(solid: Any, o: Any, d: Any, wanted: float) -> None:
    found, kind = one(Scene("s", None, (solid,)), o, d)
    assert (found, kind) == (pytest.approx(wanted, abs=1e-12), SOLID)


def test_the_nearest_of_bed_surface_and_solids_counts_and_is_named() -> None:
    scene = Scene("s", plane(), (Sphere((5, 5, 5), 1.0), Sphere((0, 0, 5), 1.0)))
    assert one(scene, (0, 0, 1), (0, 0, 1)) == (3.0, SOLID + 1)
    assert one(scene, (2, 0, 1), (0, 0, 1)) == (9.0, SEABED)
    assert one(scene, (2, 0, 1), (0, 0, -1)) == (1.0, SURFACE)
    assert one(scene, (2, 0, -1), (0, 0, 1)) == (1.0, SURFACE)
    assert one(scene, (2, 0, 12), (0, 0, -1)) == (2.0, BELOW)


@pytest.mark.parametrize(
    ("o", "d", "wanted"),
    [
        ((-30, 0.5, 5), (1, 0, 0.2), (25.0, SEABED)),  # comes in from outside
        ((-30, 0.5, 5), (1, 0, 1.0), (np.inf, NOTHING)),  # passes below before the edge
        ((50, 50, 5), (0, 0, 1), (np.inf, NOTHING)),  # outside, straight down
        ((0.5, 0.5, 5), (1, 0, 0), (np.inf, NOTHING)),  # level
        ((0.5, 0.5, 15), (1, 0.3, 0.1), (np.inf, NOTHING)),  # below it and on down
        ((0.5, 0.5, 5), (0, 0, 0), (np.inf, NOTHING)),  # no direction
        ((np.nan, 0.5, 5), (0, 0, 1), (np.inf, NOTHING)),
    ],
)
def test_rays_from_outside_and_below_and_level_ones(o: Any, d: Any, wanted: Any) -> None:
    assert one(plane(), o, d) == (pytest.approx(wanted[0]), wanted[1])


def test_a_level_ray_meets_a_ridge() -> None:
    z = np.full((21, 5), 10.0, np.float32)
    z[10] = 4.0
    t, kind = one(Terrain(z, 1.0, (0.0, 0.0)), (0.5, 2.2, 7.0), (1, 0, 0))
    assert (t, kind) == (pytest.approx(9.0), SEABED)


def test_farther_than_asked_is_nothing() -> None:
    assert one(plane(), (0.3, 0.2, 1), (0, 0, 1), far=8.99) == (np.inf, NOTHING)
    assert one(plane(), (0.3, 0.2, 1), (0, 0, 1), far=9.01)[1] == SEABED


def test_ranges_are_in_lengths_of_the_direction() -> None:
    o, d = rays_over(rough(), 200)
    t, kind = Caster(rough()).cast(o, d)
    twice, same = Caster(rough()).cast(o, 2.0 * d)
    np.testing.assert_array_equal(kind, same)
    np.testing.assert_allclose(2.0 * twice[kind == SEABED], t[kind == SEABED], rtol=1e-12)


def test_through_a_hole_there_is_nothing_and_around_it_all_is_as_before() -> None:
    whole, holed = rough(), rough()
    holed.z[20:24, 30:33] = np.nan
    o, d = rays_over(whole, 4000)
    t, kind = Caster(whole).cast(o, d)
    t_holed, kind_holed = Caster(holed).cast(o, d)
    same = (t == t_holed) & (kind == kind_holed)
    assert 0 < (~same).sum() < 400
    assert np.all(t_holed[~same] > t[~same])
    north, east = -50 + 3.0 * 21.5, -70 + 3.0 * 31.5
    assert np.isnan(Caster(holed).height(north, east))
    assert one(holed, (north, east, 1.0), (0, 0, 1)) == (np.inf, NOTHING)


def test_heights_are_where_vertical_rays_end() -> None:
    c, (o, _) = Caster(rough()), rays_over(rough(), 300)
    t, _ = c.cast(o, np.tile((0.0, 0.0, 1.0), (300, 1)))
    np.testing.assert_allclose(o[:, 2] + t, c.height(o[:, 0], o[:, 1]), rtol=1e-14)


@settings(max_examples=40, deadline=None)
@given(
    i=st.integers(1, ROUGH - 2), j=st.integers(1, ROUGH - 2), x=st.floats(-40, 40),
    y=st.floats(-40, 40),
)  # fmt: skip
def test_a_ray_at_a_node_or_along_a_line_of_the_grid_does_not_slip_through(
    i: int, j: int, x: float, y: float
) -> None:
    t = rough()
    node = np.array([t.origin[0] + 3.0 * i, t.origin[1] + 3.0 * j, float(t.z[i, j])])
    c = Caster(t)
    o = np.array([[node[0] + x, node[1] + y, 1.0], [node[0], node[1] + y, 1.0], [*node[:2], 1.0]])
    height = c.height(o[:, 0], o[:, 1])
    _, kind = c.cast(o, node - o + (0, 0, 1e-9), 2.0)
    assert np.all(kind[(height > 1.0)] == SEABED)


def test_north_and_east_may_be_exchanged() -> None:
    """The diagonal from (i, j) to (i + 1, j + 1) stays where it is."""
    t = rough()
    turned = Terrain(np.ascontiguousarray(t.z.T), 3.0, t.origin[::-1])
    o, d = rays_over(t, 500)
    swap = [1, 0, 2]
    a, b = Caster(t).cast(o, d), Caster(turned).cast(o[:, swap], d[:, swap])
    np.testing.assert_array_equal(a[1], b[1])
    met = a[1] == SEABED
    np.testing.assert_allclose(a[0][met], b[0][met], rtol=1e-12)


def test_a_deeper_bed_is_met_later() -> None:
    t = rough()
    deeper = Terrain(t.z + np.float32(0.5), 3.0, t.origin)
    o, d = rays_over(t, 500)
    o = o[Caster(t).height(o[:, 0], o[:, 1]) > o[:, 2]]
    a, b = Caster(t).cast(o, d[: len(o)])[0], Caster(deeper).cast(o, d[: len(o)])[0]
    assert np.all((b > a) | np.isinf(a))


def test_it_hits_what_embree_hits() -> None:
    pytest.importorskip("embreex", reason="the extra `scene` is not installed")
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    t = rough()
    n = ROUGH
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack(c, 1) for c in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))])
    axis = 3.0 * np.arange(n)
    points = np.stack([np.repeat(t.origin[0] + axis, n), np.tile(t.origin[1] + axis, n)], 1)
    vertices = np.column_stack([points, t.z.ravel()]).astype(np.float32)
    mesh = rtcore_scene.EmbreeScene()
    TriangleMesh(mesh, vertices, faces.astype(np.int32))
    o, d = (x.astype(np.float32) for x in rays_over(t, 20_000))
    theirs = np.asarray(mesh.run(o, d, query="DISTANCE"), float)
    found, kind = Caster(t).cast(o, d)
    found[(kind != SEABED) & (kind != BELOW)] = np.inf
    theirs[theirs > 1e30] = np.inf
    both = np.isfinite(found) & np.isfinite(theirs)
    # In single precision Embree may miss by a few 1e-5 at an edge and go on to the next triangle.
    assert np.mean(np.isfinite(found) != np.isfinite(theirs)) < 2e-4
    assert both.sum() > 5_000
    off = np.abs(found[both] - theirs[both])
    assert np.quantile(off, 0.999) < 1e-3
    assert np.mean(off > 0.01) < 2e-4


def test_given_arrays_are_written_and_returned() -> None:
    o, d = rays_over(plane(), 8)
    out = np.empty(8), np.empty(8, np.int32)
    t, kind = Caster(plane()).cast(o, d, out=out)
    assert t is out[0]
    assert kind is out[1]


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (lambda: Caster("tacona"), "there is no scene 'tacona'"),
        (lambda: Caster("nowhere.npz"), "nowhere.npz: there is no such file"),
        (lambda: Caster(Terrain(np.full((3, 3), np.nan, np.float32), 1.0, (0, 0))), "but holes"),
        (lambda: Caster(Scene("s", None, (Sphere((0, 0, 5), -1.0),))), "greater than 0"),
        (lambda: Caster(Scene("s", None, (Sphere((0, np.nan, 5), 1.0),))), "not finite"),
        (lambda: Caster(plane()).cast((0, 0), [(0, 0, 1)]), "origins: shape (2,)"),
        (lambda: Caster(plane()).cast(np.zeros((3, 3)), np.ones((2, 3))), "expected 1, or 2"),
    ],
)
def test_what_is_no_scene_and_no_ray_is_said(build: Any, words: str) -> None:
    with pytest.raises(InputInvalid, match="".join(f"[{c}]" if c in "()" else c for c in words)):
        build()
