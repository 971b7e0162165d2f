"""Images per second of a colour camera on one core, and what pixels, lamps and triangles cost.

The camera looks ahead and 30 degrees down, over relief, near obstacles as many as a harbour chart's
(1,130). Times are CPU times of one thread; cases alternate, and the median of the repeats is
printed, with the ratio to the first case within each repeat. `python benchmarks/color_camera.py`.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from math import radians
from typing import Any

import numpy as np
from imaging_sonar import alternate, ball, poses
from parts.harbour import obstacles, terrain

from uuvsim_cosim.models.worlds.scene import Scene
from uuvsim_cosim.scene.shared.camera import Camera, Lamp
from uuvsim_cosim.scene.shared.ray_casting import Caster

AHEAD = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
LAMPS = tuple(Lamp((x, 0.1, 0.0), (0.4, 0.45, 0.35)) for x in (-0.2, 0.2, -0.4, 0.4))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=10)
    parser.add_argument("--repeats", type=int, default=5)
    given = parser.parse_args()
    n, repeats = given.images, given.repeats
    relief = terrain()
    caster = Caster(relief)
    made = obstacles(caster)
    bare, full = Scene("bare", relief), Scene("full", relief, made)
    at, R = poses(caster, made, n, radians(-30))
    R = R @ AHEAD
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(f"load {load:.1f}; {n} images a case, {repeats} repeats")

    def runs(scene: Scene, lamps: int = 2, columns: int = 320, **changed: Any) -> Callable[[], Any]:
        size = {"columns": columns, "rows": columns * 3 // 4, "focal_length": 0.6 * columns}
        camera = Camera(scene, lamps=LAMPS[:lamps], distortion=(-0.02, 0.0), **size | changed)
        return lambda: camera.images(at, R)

    print("scene: 320 x 240 pixels, two lamps, texture, noise")
    names = {"bare relief": bare, f"{len(made):,} obstacles": full}
    alternate({name: runs(scene) for name, scene in names.items()}, n, repeats)
    print("lamps, bare relief")
    alternate({f"{k} lamps": runs(bare, k) for k in (2, 0, 1, 4)}, n, repeats)
    print("parts, bare relief, two lamps")
    parts = {"all": {}, "no noise": {"noise": False}, "no texture": {"contrast": 0.0}}
    alternate({name: runs(bare, **changed) for name, changed in parts.items()}, n, repeats)
    print("pixels, bare relief, two lamps")
    alternate(
        {f"{k} x {k * 3 // 4}": runs(bare, columns=k) for k in (320, 64, 160, 640)}, n, repeats
    )
    print("triangles of a mesh ahead of the camera, bare relief, two lamps")
    cases = {"none": runs(bare)}
    for size in (10, 100, 316):
        balls = tuple(ball(k, p, size) for k, p in enumerate(at[:4]))
        cases[f"{sum(len(b.corners) for b in balls):,}"] = runs(Scene("mesh", relief, meshes=balls))
    alternate(cases, n, repeats)


if __name__ == "__main__":
    main()
