"""Rays per CPU second over one million triangles, among a chart's obstacles, and beside Embree's.

All cast the same rays in one run, in turn, on one thread each. Scattered rays begin 5 to 40 m above
the bed and go down at 5 to 90 degrees; a multibeam's are 512 across a swath of 120 degrees, line
after line. Obstacles are as many as a harbour chart's (1,130) and of its kinds and sizes: piles in
rows, buoys with their moorings, cables laid in pieces, wrecks, pontoons. Rays near them begin
within 30 m of one. The ratio of each of nine goes with and without obstacles is taken, and the
median printed. A mesh of the same seabed goes through the tree, and through Embree.
`python benchmarks/rays.py`.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from parts.harbour import among, obstacles, terrain

from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.scene import Scene, save_scene
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.ray_casting import SEABED, SOLID, Caster

SENSORS: dict[str, dict[str, Any]] = {
    "altimeter": {"period": "0.1"},
    "dvl": {"id": "a50", "period": "0.1"},
    "multibeam": {"beams": 256, "period": "0.1"},
    "depth_camera": {"id": "camera_class", "period": "0.1"},
}
RAYS = 1_000_000
REPEATS = 9  # of each measurement, of which the median is printed


def triangles(t: Terrain) -> tuple[Any, Any]:
    """Return vertices and faces of a terrain as the caster cuts it."""
    n = len(t.z)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack(c, 1) for c in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))])
    axis = t.spacing * np.arange(n)
    places = [np.repeat(t.origin[0] + axis, n), np.tile(t.origin[1] + axis, n), t.z.ravel()]
    return np.column_stack(places).astype(np.float32), faces.astype(np.int32)


def embree(vertices: Any, faces: Any) -> Any:
    """Build the scene of Embree from the same triangles."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, vertices, faces)
    return scene


def scattered(c: Caster) -> tuple[Any, Any]:
    rng = np.random.default_rng(2)
    north, east = rng.uniform(-900, 2400, RAYS), rng.uniform(-1400, 1900, RAYS)
    turn, down = rng.uniform(0, 2 * np.pi, RAYS), np.deg2rad(rng.uniform(5, 90, RAYS))
    d = [np.cos(down) * np.cos(turn), np.cos(down) * np.sin(turn), np.sin(down)]
    up = c.height(north, east) - rng.uniform(5, 40, RAYS)
    return np.column_stack([north, east, np.maximum(up, 0.1)]), np.column_stack(d)


def lines() -> tuple[Any, Any]:
    pings = RAYS // 512
    o = np.column_stack([np.linspace(-500, 2000, pings), np.zeros(pings), np.full(pings, 15.0)])
    a = np.tile(np.linspace(-np.pi / 3, np.pi / 3, 512), pings)
    return np.repeat(o, 512, axis=0), np.column_stack([0 * a, np.sin(a), np.cos(a)])


def beside_bare(bare: Caster) -> None:
    """Print what rays cost among obstacles, over the bare terrain, in one run."""
    made = obstacles(bare)
    wrecks = tuple(wreck(bare, k) for k in range(10))
    among_solids = Caster(Scene("obstacles", terrain(), made))
    with_meshes = Caster(Scene("obstacles and wrecks", terrain(), made, meshes=wrecks))
    n_triangles = sum(len(w.corners) for w in wrecks)
    o, d = scattered(bare)
    lo, ld = lines()
    cases = {
        "scattered": (o, d),
        "scattered near obstacles": (among(o, made, bare), d),
        "multibeam": (lo, ld),
        "multibeam near obstacles": (np.repeat(among(lo[::512], made, bare), 512, axis=0), ld),
    }
    wrecked = {
        "scattered": (o, d),
        "scattered near wrecks": (among(o, wrecks, bare), d),
        "multibeam near wrecks": (np.repeat(among(lo[::512], wrecks, bare), 512, axis=0), ld),
    }
    print(f"{len(made):,} obstacles")
    ratios(bare, among_solids, cases)
    print(f"{len(made):,} obstacles, and 10 wrecks of {n_triangles:,} triangles")
    ratios(bare, with_meshes, wrecked)
    print("native components, 1,130 obstacles")
    in_components(bare, Scene("full", terrain(), made, description="made", source="made"))


def in_components(bare: Caster, full: Scene) -> None:
    """Print the same ratio of native components, at 50 places near obstacles, a sample each."""
    rng = np.random.default_rng(5)
    with tempfile.TemporaryDirectory() as temporary:
        for name, scene in (("bare", Scene("bare", full.terrain)), ("full", full)):
            save_scene(scene, Path(temporary) / name)
        at = among(np.zeros((50, 3)), full.obstacles, bare)
        poses = np.column_stack([at, 0.1 * rng.normal(size=(50, 2)), rng.uniform(-3, 3, 50)])
        for name, options in SENSORS.items():
            sampled = {}
            for which in ("bare", "full"):
                model = declare(name, scene=str(Path(temporary) / which), **options)
                sampled[which] = partial(samples, Native(model, name), poses)
            pairs = [(taken(sampled["full"]), taken(sampled["bare"])) for _ in range(REPEATS)]
            each = [with_ / without for with_, without in pairs]
            print(
                f"{name}: {1e6 * np.median([p[0] for p in pairs]) / (200 * len(poses)):.1f} us a "
                f"sample; ratio to bare terrain {np.median(each):.2f} "
                f"({min(each):.2f} to {max(each):.2f})"
            )


def samples(component: Native, poses: Any) -> None:
    """Take 200 samples at each pose."""
    variables = component.description.variables
    component.reset()
    component.enter_initialization_mode(0.0, None)
    component.exit_initialization_mode()
    for k, pose in enumerate(poses):
        component.set(variables["eta"], pose)
        component.do_step(20.0 * k, 20.0)


def wreck(c: Caster, seed: int) -> PlacedMesh:
    """Lay a hull of 40 x 8 x 6 m, dented, on the bed."""
    rng = np.random.default_rng(100 + seed)
    ball = trimesh.creation.icosphere(5, 1.0)
    dents = 1.0 + 0.05 * np.sin(9 * ball.vertices[:, :1] + seed)
    n, e = rng.uniform(-900, 2400), rng.uniform(-1400, 1900)
    at = (n, e, float(c.height(n, e)))
    points = ball.vertices * dents * (20.0, 4.0, 3.0) + at
    return PlacedMesh(Path("wreck"), points, ball.faces.astype(np.int32), at)


def ratios(bare: Caster, full: Caster, cases: dict[str, tuple[Any, Any]]) -> None:
    """Print the cost of rays in a scene over that on its bare terrain."""
    for name, (a, b) in cases.items():
        pairs = [(taken(lambda: full.cast(a, b)), taken(lambda: bare.cast(a, b)))  # noqa: B023
                 for _ in range(REPEATS)]  # fmt: skip
        each = [with_ / without for with_, without in pairs]
        _, kind = full.cast(a, b)
        print(
            f"{name}: {len(a) / np.median([p[0] for p in pairs]) / 1e6:.1f} M rays/CPU s, "
            f"{100 * np.mean(kind >= SOLID):.1f} % meet an obstacle; ratio to bare terrain "
            f"{np.median(each):.2f} ({min(each):.2f} to {max(each):.2f})"
        )


def taken(cast: Callable[[], Any]) -> float:
    """Return the CPU seconds of one go."""
    begun = time.process_time()
    cast()
    return time.process_time() - begun


def beside_embree(ours: Caster, theirs: Any, kind_of_hit: int, over: Caster) -> None:
    """Print the speed of a caster and of Embree on the same rays and triangles."""
    for name, (o, d) in (("scattered", scattered(over)), ("multibeam", lines())):
        o32, d32 = o.astype(np.float32), d.astype(np.float32)
        pairs = [
            (
                taken(lambda: ours.cast(o, d)),  # noqa: B023
                taken(lambda: theirs.run(o32, d32, query="DISTANCE")),  # noqa: B023
            )
            for _ in range(5)
        ]
        a, b = np.min(pairs, axis=0)
        found, kind = ours.cast(o, d)
        other = np.asarray(theirs.run(o32, d32, query="DISTANCE"), float)
        met = kind == kind_of_hit
        same = np.mean(np.abs(found - other)[met] < 0.01)
        print(
            f"{name}: {len(o) / a / 1e6:.1f} M rays/CPU s, Embree {len(o) / b / 1e6:.1f}; "
            f"ratio {b / a:.2f}; of {met.sum():,} hits {100 * same:.4f} % within 1 cm of Embree's"
        )


def main() -> None:
    global RAYS, REPEATS
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=REPEATS)
    parser.add_argument("--rays", type=int, default=RAYS)
    given = parser.parse_args()
    RAYS, REPEATS = given.rays, given.repeats
    t = terrain()
    bare = Caster(t)
    beside_bare(bare)
    vertices, faces = triangles(t)
    print(f"{len(faces):,} triangles of the terrain")
    beside_embree(bare, embree(vertices, faces), SEABED, bare)
    part = Terrain(np.ascontiguousarray(t.z[::2, ::2]), 2 * t.spacing, t.origin)
    vertices, faces = triangles(part)
    began = time.process_time()
    mesh = PlacedMesh(Path("seabed"), vertices.astype(float), faces, (0.0, 0.0, 0.0))
    ours = Caster(Scene("mesh", None, meshes=(mesh,)))
    print(
        f"{len(faces):,} triangles of a mesh of it, at {part.spacing:g} m; their tree is built in "
        f"{time.process_time() - began:.1f} CPU s"
    )
    beside_embree(ours, embree(vertices, faces), SOLID, Caster(part))


if __name__ == "__main__":
    main()
