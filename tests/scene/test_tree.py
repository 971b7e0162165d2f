"""The tree over solids and triangles: the bits of a test of every solid, whatever its shape."""

from __future__ import annotations

import ctypes
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uuvsim_cosim.fmus.codegen.processor import processor_flags
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_shared
from uuvsim_cosim.models.shapes.tree import NOBODY, Tree, node_boxes, tree_of
from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh, placed_mesh
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.ray_casting import NOTHING, SOLID, Caster

Array = NDArray[np.float64]
TREE, EVERY, CULLED, MOVING = range(4)
Cast = tuple[Array, NDArray[np.int32], Array]

# Without a tree: every solid in turn, in one of two ways. With `cull`, as before there was a tree,
# a solid is left out where the ray comes to its ball behind the nearest hit so far: rounding can
# leave out one that is nearer by its last digit, so that the result depended on their order.
SOURCE = """
#include "uuv_rays.h"

static int every(const uuv_scene *s, const double o[3], const double d[3], double far,
                 int cull, uuv_hit *hit) {
    uuv_scene bare = *s;
    bare.tree.n_nodes = 0;
    uuv_cast(&bare, 0, 0, o, d, far, hit);
    for (int i = 0; i < s->n_solids; i++) {
        const uuv_solid *one = s->solid + i;
        const double p[3] = {o[0] - one->centre[0], o[1] - one->centre[1], o[2] - one->centre[2]};
        const double before = hit->t;
        if (cull) uuv_cast_solid_(one, o, d, i, hit);
        else if (uuv_may_meet_(one, p, d, 0)) uuv_cast_shape_(one, p, d, hit);
        if (hit->t < before) hit->kind = UUV_HIT_SOLID + i;
    }
    return hit->kind;
}

__attribute__((visibility("default"))) void cast(
    const uuv_scene *s, int way, const double *o, const double *d, double far, int n,
    double *range, int32_t *kind, double *normal) {
    for (int k = 0; k < n; k++, o += 3, d += 3) {
        uuv_hit hit;
        const uuv_solid moving = {UUV_CAPSULE, {0.0, 0.0, 9.0}, {0.5, 0.0, 0.0, 0.5}, 1.0};
        if (way == 0) uuv_cast(s, 0, 0, o, d, far, &hit);
        else if (way == 3) uuv_cast(s, &moving, 1, o, d, far, &hit);
        else every(s, o, d, far, way == 2, &hit);
        kind[k] = hit.kind;
        range[k] = hit.t;
        for (int m = 0; m < 3; m++) normal[3 * k + m] = hit.n[m];
    }
}

__attribute__((visibility("default"))) int parts(
    const uuv_scene *s, const double *low, const double *high, int32_t *part, int most) {
    return uuv_parts_in_box(&s->tree, low, high, part, most);
}
"""


@pytest.fixture(scope="module")
def c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    return library(tmp_path_factory.mktemp("c"))


def library(folder: Path, flags: tuple[str, ...] = ()) -> ctypes.CDLL:
    file = folder / "every.c"
    file.write_text(SOURCE)
    made = compile_shared([file], name="every", include=runtime(), flags=flags)
    loaded, pointer, count = ctypes.CDLL(str(made)), ctypes.c_void_p, ctypes.c_int
    loaded.cast.argtypes = [
        pointer, count, pointer, pointer, ctypes.c_double, count, pointer, pointer, pointer,
    ]  # fmt: skip
    loaded.parts.argtypes = [pointer, pointer, pointer, pointer, count]
    return loaded


def cast(c: ctypes.CDLL, by: Caster, o: Array, d: Array, far: float, way: int) -> Cast:
    o, d = np.ascontiguousarray(o, float), np.ascontiguousarray(d, float)
    t, kind, normal = np.empty(len(d)), np.empty(len(d), np.int32), np.empty((len(d), 3))
    c.cast(
        ctypes.byref(by.scene), way, o.ctypes.data, d.ctypes.data, far, len(d),
        t.ctypes.data, kind.ctypes.data, normal.ctypes.data,
    )  # fmt: skip
    return t, kind, normal


def with_tree(by: Caster, tree: Tree) -> None:
    """Put another tree over the same parts into a caster."""
    nodes = np.zeros(len(tree.children), by._nodes.dtype)
    nodes["box"], nodes["child"] = tree.boxes, tree.children
    by._nodes = nodes
    by.scene.tree.node, by.scene.tree.n_nodes = nodes.ctypes.data, len(nodes)


def shuffled(tree: Tree, rng: np.random.Generator) -> Tree:
    """Return a tree of another shape over the boxes of the same parts, at random."""
    is_part = (tree.children < 0) & (tree.children != NOBODY)
    part, boxes = -1 - tree.children[is_part], tree.boxes.transpose(0, 2, 1)[is_part]
    own = np.empty((len(part), 6), np.float32)
    own[part] = boxes
    rows: list[list[int]] = []

    def made(parts: list[int]) -> int:
        at = len(rows)
        rows.append([NOBODY] * 4)
        groups = [g for g in np.array_split(parts, rng.integers(2, 5)) if len(g)]
        for k, g in enumerate(groups):
            rows[at][k] = -1 - int(g[0]) if len(g) == 1 else made(g.tolist())
        return at

    made(rng.permutation(len(part)).tolist())
    children = np.array(rows)
    nodes = np.empty((len(rows), 6, 4), np.float32)
    for k in reversed(range(len(rows))):  # children come after their node
        nodes[k] = node_boxes(children[k : k + 1], own[:, :3], own[:, 3:], nodes)[0]
    return Tree(nodes, children.astype(np.int32))


SEEN = st.integers(0, 2**32 - 1)


def solids(rng: np.random.Generator, n: int, whole: bool) -> tuple[Obstacle, ...]:
    """Draw solids; at whole numbers, many touch, overlap and are equal."""

    def at() -> tuple[float, float, float]:
        x = rng.uniform(-20, 20, 3)
        return tuple((np.round(x / 4) * 2 if whole else x).tolist())

    def size() -> float:
        return float(rng.integers(1, 4) if whole else rng.uniform(0.05, 3))

    made: list[Obstacle] = []
    for _ in range(n):
        kind = rng.integers(4)
        if kind == 0:
            yaw = float(rng.integers(4) * np.pi / 2 if whole else rng.uniform(-4, 4))
            made.append(Box(at(), (size(), size(), size()), yaw))
        elif kind == 1:
            made.append(Sphere(at(), size()))
        elif kind == 2:
            made.append(Capsule(at(), at(), size()))
        else:
            made.append(Cylinder(at(), size(), size()))
    return tuple(made)


def rays(rng: np.random.Generator, n: int, whole: bool) -> tuple[Array, Array]:
    o, d = rng.uniform(-25, 25, (n, 3)), rng.normal(size=(n, 3))
    if whole:
        o, d = np.round(o), rng.integers(-2, 3, (n, 3)).astype(float)
    return o, d


@settings(max_examples=150, deadline=None)
@given(SEEN, st.integers(1, 40), st.booleans(), st.sampled_from([np.inf, 10.0, 0.5]))
def test_the_tree_gives_the_bits_of_a_test_of_every_solid(
    c: ctypes.CDLL, seed: int, n: int, whole: bool, far: float
) -> None:
    rng = np.random.default_rng(seed)
    by = Caster(Scene("s", None, solids(rng, n, whole)))
    o, d = rays(rng, 300, whole)
    mine = cast(c, by, o, d, far, TREE)
    for way in (EVERY,) if whole else (EVERY, CULLED):
        same(mine, cast(c, by, o, d, far, way))


@settings(max_examples=60, deadline=None)
@given(SEEN, st.integers(1, 60), st.booleans())
def test_the_shape_of_the_tree_changes_no_bit(
    c: ctypes.CDLL, seed: int, n: int, whole: bool
) -> None:
    rng = np.random.default_rng(seed)
    meshes = () if seed % 2 else (blob(rng),)
    by = Caster(Scene("s", None, solids(rng, n, whole), meshes=meshes))
    o, d = rays(rng, 300, whole)
    first = cast(c, by, o, d, np.inf, TREE)
    with_tree(by, shuffled(by.ground.tree, rng))
    same(cast(c, by, o, d, np.inf, TREE), first)


def same(one: Cast, other: Cast) -> None:
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no gcc here; zig is what users have")
def test_gcc_for_this_processor_gives_the_bits_of_zig(
    c: ctypes.CDLL, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Turned boxes, too, whose products of sine and cosine gcc would contract."""
    rng = np.random.default_rng(8)
    by = Caster(Scene("s", None, solids(rng, 100, False), meshes=(blob(rng),)))
    o, d = rays(rng, 20_000, False)
    monkeypatch.setenv("CC", "gcc")
    by_gcc = library(tmp_path, processor_flags(baseline=False))
    same(cast(by_gcc, by, o, d, np.inf, TREE), cast(c, by, o, d, np.inf, TREE))


def blob(
    rng: np.random.Generator, n: int = 300, size: float = 8.0, at: Array | None = None
) -> PlacedMesh:
    """Return a closed surface of triangles, every point of it seen from its middle `at`."""
    from scipy.spatial import ConvexHull

    on = rng.normal(size=(n, 3))
    on /= np.linalg.norm(on, axis=1)[:, None]
    corners = ConvexHull(on).simplices
    away = np.linalg.det(on[corners]) < 0.0
    corners[away] = corners[away][:, ::-1]
    at = rng.uniform(-5, 5, 3) if at is None else at
    points = on * size * rng.uniform(0.6, 1.0, (n, 1)) + at
    return PlacedMesh(Path("blob.stl"), points, corners.astype(np.int32), (0.0, 0.0, 0.0))


@settings(max_examples=60, deadline=None)
@given(SEEN)
def test_no_ray_from_within_leaves_a_closed_mesh(c: ctypes.CDLL, seed: int) -> None:
    """Aimed at vertices, edges, and anywhere: watertight to the bit."""
    rng = np.random.default_rng(seed)
    o = rng.uniform(-5, 5, 3)
    by = Caster(Scene("s", None, meshes=(blob(rng, at=o),)))
    triangles = by.ground.surfaces.triangles
    share = rng.uniform(0, 1, (len(triangles), 1))
    on_edges = triangles[:, 0] + share * (triangles[:, 1] - triangles[:, 0])
    targets = np.concatenate([triangles.reshape(-1, 3), on_edges, o + rng.normal(size=(500, 3))])
    level = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, -1, 1]], float)
    d = np.concatenate([targets - o, level])
    kind = cast(c, by, np.broadcast_to(o, d.shape), d, np.inf, TREE)[1]
    assert np.all((kind == SOLID) | (kind == 3))
    met, there, _ = cast(c, by, np.broadcast_to(o, targets.shape), targets - o, np.inf, TREE)
    at_vertex = met[: 3 * len(triangles)][there[: 3 * len(triangles)] == SOLID]
    assert np.all(at_vertex < 1.0 + 1e-9)


def test_a_ray_along_the_plane_of_a_face_meets_the_box(c: ctypes.CDLL, tmp_path: Path) -> None:
    by = Caster(Scene("s", None, meshes=(box_mesh(tmp_path),)))
    o = np.array([[-5.0, 1.0, 5.0], [-5.0, -1.0, 6.0], [-5.0, 0.5, 6.0], [1.0, -9.0, 4.0]])
    d = np.array([[1.0, 0, 0], [1.0, 0, 0], [1.0, 0, 0], [0, 1.0, 0]])
    t, kind, normal = cast(c, by, o, d, np.inf, TREE)
    np.testing.assert_array_equal(kind, SOLID)
    np.testing.assert_array_equal(t, [4.0, 4.0, 4.0, 8.0])
    assert np.all(np.einsum("ij,ij->i", normal, d) <= 0.0)


def box_mesh(folder: Path, centre: Any = (0.0, 0.0, 5.0), **given: Any) -> PlacedMesh:
    """Write a box of 2 m and place it."""
    import trimesh

    file = folder / "box.stl"
    file.write_bytes(trimesh.creation.box((2, 2, 2)).export(file_type="stl"))
    return placed_mesh(file, centre, **{"unit": "m", "axes": "NED", **given})


def test_a_mesh_of_a_box_is_met_where_the_box_is(c: ctypes.CDLL, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    o, d = rng.uniform(-6, 6, (20_000, 3)), rng.normal(size=(20_000, 3))
    mesh = Caster(Scene("s", None, meshes=(box_mesh(tmp_path),)))
    box = Caster(Scene("s", None, (Box((0, 0, 5), (1, 1, 1)),)))
    (t, kind, n), (wanted, as_box, normal) = (cast(c, by, o, d, np.inf, TREE) for by in (mesh, box))
    np.testing.assert_array_equal(kind, as_box)
    met = kind == SOLID
    assert met.sum() > 300
    np.testing.assert_allclose(t[met], wanted[met], rtol=1e-12, atol=1e-12)
    against = normal[met] * -np.sign(np.einsum("ij,ij->i", normal[met], d[met]))[:, None]
    np.testing.assert_allclose(n[met], against, atol=1e-12)  # met from either side


def test_a_mesh_hits_what_embree_hits() -> None:
    pytest.importorskip("embreex", reason="the extra `scene` is not installed")
    from embreex import rtcore_scene
    from embreex.mesh_construction import TriangleMesh

    rng = np.random.default_rng(7)
    mesh = blob(rng, 4000, 20.0)
    by = Caster(Scene("s", None, meshes=(mesh,)))
    scene = rtcore_scene.EmbreeScene()
    points = mesh.vertices.astype(np.float32)
    TriangleMesh(scene, points, mesh.corners)
    o = rng.uniform(-30, 30, (40_000, 3)).astype(np.float32)
    d = rng.normal(size=o.shape).astype(np.float32)
    theirs = np.asarray(scene.run(o, d, query="DISTANCE"), float)
    theirs[theirs > 1e30] = np.inf
    t, kind = by.cast(o, d)
    surface = np.where(d[:, 2] != 0, -o[:, 2] / d[:, 2], np.inf)
    theirs[(surface >= 0) & (surface < theirs)] = np.inf
    t[kind != SOLID] = np.inf
    both = np.isfinite(t) & np.isfinite(theirs)
    assert both.sum() > 5_000
    # In single precision Embree may take another side at an edge.
    assert np.mean(np.isfinite(t) != np.isfinite(theirs)) < 2e-4
    assert np.mean(np.abs(t[both] - theirs[both]) > 1e-3) < 2e-4


@settings(max_examples=60, deadline=None)
@given(SEEN, st.integers(1, 60))
def test_all_parts_whose_boxes_meet_a_box_are_found_in_order(
    c: ctypes.CDLL, seed: int, n: int
) -> None:
    rng = np.random.default_rng(seed)
    by = Caster(Scene("s", None, solids(rng, n, False), meshes=(blob(rng),)))
    triangles = by.ground.surfaces.triangles
    low = np.ascontiguousarray(rng.uniform(-20, 18, 3))
    high = np.ascontiguousarray(low + rng.uniform(0, 6, 3))
    found = np.empty(len(triangles) + n, np.int32)
    count = c.parts(ctypes.byref(by.scene), low.ctypes.data, high.ctypes.data,
                    found.ctypes.data, len(found))  # fmt: skip
    found = found[:count]
    inside = (triangles.min(1) <= high).all(1) & (triangles.max(1) >= low).all(1)
    assert np.all(np.diff(found) > 0)
    assert set(n + np.flatnonzero(inside)) <= set(found.tolist())
    near = (triangles.min(1) <= high + 0.01).all(1) & (triangles.max(1) >= low - 0.01).all(1)
    assert set(found[found >= n].tolist()) <= set(n + np.flatnonzero(near))
    few = np.empty(3, np.int32)
    assert count == c.parts(
        ctypes.byref(by.scene), low.ctypes.data, high.ctypes.data, few.ctypes.data, 3
    )
    np.testing.assert_array_equal(few[:count], found[:3])


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 17, 1000])
def test_each_part_is_in_the_tree_once(n: int) -> None:
    at = np.random.default_rng(n).normal(size=(n, 3))
    for low in (at, 0 * at, 2.0 ** np.arange(n)[:, None] % 1e30 * np.ones(3)):
        tree = tree_of(low, low + 1.0)
        parts = -1 - tree.children[(tree.children < 0) & (tree.children != NOBODY)]
        assert sorted(parts.tolist()) == list(range(n))
        nodes = tree.children[tree.children >= 0]
        assert sorted(nodes.tolist()) == list(range(1, len(tree.children)))


def test_a_box_of_the_tree_holds_its_part_in_float32_as_well() -> None:
    rng = np.random.default_rng(4)
    low = rng.uniform(-20e3, 20e3, (500, 3))
    high = low + rng.uniform(0, 1e-3, low.shape)
    tree = tree_of(low, high)
    is_part = (tree.children < 0) & (tree.children != NOBODY)
    part, boxes = -1 - tree.children[is_part], tree.boxes.transpose(0, 2, 1)[is_part]
    assert np.all(boxes[:, :3].astype(float) <= low[part])
    assert np.all(boxes[:, 3:].astype(float) >= high[part])


def test_numbers_count_solids_then_meshes_then_what_moves(c: ctypes.CDLL, tmp_path: Path) -> None:
    meshes = tuple(box_mesh(tmp_path, (north, 0.0, 9.0)) for north in (5.0, 10.0))
    solids = (Sphere((-5.0, 0.0, 9.0), 1.0), Sphere((-10.0, 0.0, 9.0), 1.0))
    by = Caster(Scene("s", None, solids, meshes=meshes))
    o = np.array([[n, 0.0, 1.0] for n in (-5.0, -10.0, 5.0, 10.0, 0.0)])
    d = np.tile([0.0, 0.0, 1.0], (5, 1))
    _, kind, _ = cast(c, by, o, d, np.inf, MOVING)
    np.testing.assert_array_equal(kind, SOLID + np.arange(5))


def test_a_scene_without_parts_has_no_tree() -> None:
    by = Caster(Terrain(np.full((3, 3), 9.0, np.float32), 1.0, (0.0, 0.0)))
    assert by.scene.tree.n_nodes == 0
    assert by.cast((1.0, 1.0, 10.0), [(0, 0, 1)])[1][0] == NOTHING
