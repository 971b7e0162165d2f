"""Images per second of a sonar on one core, and what rays, bins, triangles and instruments cost.

The forward-looking sonar has 256 beams of 600 bins over 60 m and 512 x 192 = 98,304 rays. It moves
over relief, 5 to 15 m above it, and near obstacles as many as a harbour chart's (1,130). Times are
CPU times of one thread; cases alternate, and the median of the repeats is printed, with the ratio
to the first case within each repeat. `python benchmarks/imaging_sonar.py`.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
from parts.harbour import among, obstacles, terrain

from uuvsim_cosim.models.worlds.obstacles import Obstacle
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.models.worlds.sonar_geometry import SonarGeometry, sonar_geometry
from uuvsim_cosim.models.worlds.sonar_image import ANGLES, Surfaces
from uuvsim_cosim.models.worlds.sonar_path import STRAIGHT, SonarPaths, profile_levels
from uuvsim_cosim.scene.shared.ray_casting import Caster
from uuvsim_cosim.scene.shared.sonar import Sonar

LAMBERT = np.array([[0.01], [0.1]]) * np.sin(np.linspace(0.0, np.pi / 2, 91)) ** 2
FORWARD: dict[str, Any] = {
    "beams": 256, "swath": radians(90), "beam_width": radians(1), "shading": "hann",
    "elevation": radians(20), "bins": 600, "range_min": 1.0, "range_max": 61.0,
    "resolution": 0.1, "columns": 512, "rays": 192,
}  # fmt: skip
INSTRUMENTS: dict[str, dict[str, Any]] = {
    "forward-looking": {},
    "forward-looking, no shading": {"shading": "none"},
    "multibeam, 256 beams": {
        "swath": radians(130), "elevation": radians(1.9), "columns": 640, "rays": 12,
    },
    "scanning, 1 beam": {"beams": 1, "swath": 0.0, "beam_width": radians(2), "columns": 12},
    "side-scan, 1 beam a side": {
        "beams": 1, "swath": 0.0, "beam_width": radians(0.5), "elevation": radians(50),
        "bins": 1000, "resolution": 0.03, "columns": 12, "rays": 256,
    },
    "32 x 64, 512 rays": {
        "beams": 32, "bins": 64, "beam_width": radians(3.3), "resolution": 1.0, "columns": 32,
        "rays": 16,
    },
}  # fmt: skip


PROFILE = profile_levels([(0.0, 1510.0), (10.0, 1508.0), (20.0, 1490.0), (60.0, 1487.0)])
NONE, ALL = np.zeros((0, 2), np.float32), np.ones((ANGLES + 1, 2), np.float32)
BENT = {n: SonarPaths(PROFILE, 61.9 / n, NONE, STRAIGHT.bottom) for n in (1, 8, 32)}
PATHS = {
    "straight": STRAIGHT,
    **{f"profile of 4 levels, {n} segments": p for n, p in BENT.items()},
    "a bounce at the surface": SonarPaths(STRAIGHT.level, 0.0, ALL, STRAIGHT.bottom),
    "bounces at surface and bottom": SonarPaths(STRAIGHT.level, 0.0, ALL, np.stack([ALL] * 2)),
}


def sonar(scene: Scene, geometry: SonarGeometry, paths: SonarPaths = STRAIGHT) -> Sonar:
    solids = np.ones(len(scene.obstacles) + len(scene.meshes), np.uint8)
    surfaces = Surfaces(LAMBERT, np.zeros((0, 0), np.uint8), solids)
    return Sonar(
        scene, geometry, surfaces, frequency=900e3, noise_level=70.0, absorption=0.3, tvg=40,
        paths=paths,
    )  # fmt: skip


def poses(
    caster: Caster, made: tuple[Obstacle | PlacedMesh, ...], n: int, pitch: float
) -> tuple[Any, Any]:
    """Return n places 5 to 15 m above the bed, within 30 m of an obstacle, and rotations."""
    rng = np.random.default_rng(7)
    at = among(np.zeros((n, 3)), made, caster)
    at[:, 2] = np.maximum(caster.height(at[:, 0], at[:, 1]) - rng.uniform(5, 15, n), 0.5)
    turn = rng.uniform(0, 2 * np.pi, n)
    c, s, p = np.cos(turn), np.sin(turn), np.full(n, pitch)
    down = np.stack(
        [np.cos(p), 0 * p, -np.sin(p), 0 * p, 1 + 0 * p, 0 * p, np.sin(p), 0 * p, np.cos(p)], 1
    )
    yaw = np.stack([c, -s, 0 * c, s, c, 0 * c, 0 * c, 0 * c, 1 + 0 * c], 1)
    return at, yaw.reshape(-1, 3, 3) @ down.reshape(-1, 3, 3)


def alternate(cases: Mapping[str, Callable[[], Any]], n: int, repeats: int) -> None:
    """Print images per CPU second of each case, and its time over that of the first."""
    taken: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(repeats):
        for name, run in cases.items():
            start = time.process_time()
            run()
            taken[name].append((time.process_time() - start) / n)
    first = np.array(next(iter(taken.values())))
    for name, each in taken.items():
        ratio = np.median(np.array(each) / first)
        own = np.median(each)
        print(f"  {name:<32} {1 / own:8.1f} images/s {1e3 * own:8.2f} ms   x {ratio:.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=20)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    n, repeats = given.images, given.repeats
    relief = terrain()
    caster = Caster(relief)
    made = obstacles(caster)
    scenes = {
        "bare relief": Scene("bare", relief),
        f"{len(made):,} obstacles": Scene("full", relief, made),
    }
    at, R = poses(caster, made, n, radians(15))
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"load {load:.1f}; {n} images a case, {repeats} repeats")

    def runs(scene: Scene, paths: SonarPaths = STRAIGHT, **changed: Any) -> Callable[[], Any]:
        s = sonar(scene, sonar_geometry(**FORWARD | changed), paths)
        return lambda: s.images(at, R)

    bare, full = scenes.values()
    print("scene: 256 beams x 600 bins, 98,304 rays")
    alternate({name: runs(scene) for name, scene in scenes.items()}, n, repeats)
    print("rays, among obstacles")
    alternate(
        {f"512 x {k} = {512 * k:,}": runs(full, rays=k) for k in (192, 96, 48, 24)}, n, repeats
    )
    print("bins, among obstacles")
    alternate(
        {f"{k} bins": runs(full, bins=k, resolution=60 / k) for k in (600, 300, 150)}, n, repeats
    )
    print("beams, among obstacles")
    alternate({f"{k} beams": runs(full, beams=k) for k in (256, 128, 64)}, n, repeats)
    print("triangles of a mesh around the sonar, bare relief")
    cases: dict[str, Callable[[], Any]] = {"none": runs(bare)}
    for size in (10, 32, 100, 316):
        balls = tuple(ball(k, p, size) for k, p in enumerate(at[:4]))
        cases[f"{sum(len(b.corners) for b in balls):,}"] = runs(Scene("mesh", relief, meshes=balls))
    alternate(cases, n, repeats)
    print("paths, among obstacles")
    alternate({name: runs(full, paths) for name, paths in PATHS.items()}, n, repeats)
    print("instruments, among obstacles")
    alternate({name: runs(full, **changed) for name, changed in INSTRUMENTS.items()}, n, repeats)


def ball(number: int, place: Any, size: int) -> PlacedMesh:
    """Return a ball of 2 size² triangles, 8 m ahead of a place."""
    a, b = np.meshgrid(
        np.linspace(0, np.pi, size + 1), np.linspace(0, 2 * np.pi, size + 1), indexing="ij"
    )
    points = np.stack([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)], -1).reshape(-1, 3)
    i, j = (v.ravel() for v in np.meshgrid(np.arange(size), np.arange(size), indexing="ij"))
    k = i * (size + 1) + j
    corners = np.concatenate(
        [np.stack([k, k + size + 1, k + 1], 1), np.stack([k + 1, k + size + 1, k + size + 2], 1)]
    )
    middle = (float(place[0]) + 8.0, float(place[1]), float(place[2]) + 4.0)
    return PlacedMesh(
        Path(f"ball {number}"), 3.0 * points + middle, corners.astype(np.int32), middle
    )


if __name__ == "__main__":
    main()
