"""Rays per CPU second over one million triangles, beside Embree's on the same triangles.

Both cast the same rays in one run, in turn, on one thread each; the best of five of each counts.
Scattered rays begin 5 to 40 m above the bed and go down at 5 to 90 degrees; a multibeam's are 512
across a swath of 120 degrees, line after line. `python benchmarks/rays.py`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

from uuvsim_cosim.models.terrain import Terrain
from uuvsim_cosim.scene.cast import SEABED, Caster

NODES, SPACING, RAYS = 708, 5.0, 1_000_000


def terrain() -> Terrain:
    """Relief whose spectrum falls as wave number to the 3.6, 20 to 80 m deep."""
    rng = np.random.default_rng(1)
    k = np.fft.fftfreq(NODES)
    size = np.hypot(k[:, None], k[None])
    size[0, 0] = 1.0
    z = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(NODES, NODES))) * size**-1.8))
    return Terrain((50 + 7 * z / z.std()).astype(np.float32), SPACING, (-1000.0, -1500.0))


def embree(t: Terrain) -> Any:
    """Give the same triangles to Embree."""
    n = NODES
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n - 1), np.arange(n - 1), indexing="ij"))
    a = i * n + j
    faces = np.concatenate([np.stack(c, 1) for c in ((a, a + n, a + n + 1), (a, a + n + 1, a + 1))])
    axis = SPACING * np.arange(n)
    places = [np.repeat(t.origin[0] + axis, n), np.tile(t.origin[1] + axis, n), t.z.ravel()]
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.column_stack(places).astype(np.float32), faces.astype(np.int32))
    print(f"{len(faces):,} triangles")
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


def taken(cast: Callable[[], Any]) -> float:
    """Give the CPU seconds of one go."""
    begun = time.process_time()
    cast()
    return time.process_time() - begun


def main() -> None:
    t = terrain()
    ours, theirs = Caster(t), embree(t)
    for name, (o, d) in (("scattered", scattered(ours)), ("multibeam", lines())):
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
        met = kind == SEABED
        same = np.mean(np.abs(found - other)[met] < 0.01)
        print(
            f"{name}: {len(o) / a / 1e6:.1f} M rays/CPU s, Embree {len(o) / b / 1e6:.1f}; "
            f"ratio {b / a:.2f}; of {met.sum():,} hits {100 * same:.4f} % within 1 cm of Embree's"
        )


if __name__ == "__main__":
    main()
