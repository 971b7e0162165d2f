"""Relief, and obstacles as many and of the kinds of a harbour chart's."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from uuvsim_cosim.models.worlds.obstacles import Box, Capsule, Cylinder, Obstacle, Sphere
from uuvsim_cosim.models.worlds.placed_mesh import PlacedMesh
from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.scene.shared.ray_casting import Caster

NODES, SPACING = 708, 5.0


def terrain() -> Terrain:
    """Relief whose spectrum falls as wave number to the 3.6, 20 to 80 m deep."""
    rng = np.random.default_rng(1)
    k = np.fft.fftfreq(NODES)
    size = np.hypot(k[:, None], k[None])
    size[0, 0] = 1.0
    z = np.real(np.fft.ifft2(np.fft.fft2(rng.normal(size=(NODES, NODES))) * size**-1.8))
    return Terrain((50 + 7 * z / z.std()).astype(np.float32), SPACING, (-1000.0, -1500.0))


def obstacles(c: Caster) -> tuple[Obstacle, ...]:
    """Stand 1,130 obstacles in the water, in the shares of a harbour chart."""
    rng = np.random.default_rng(3)
    made: list[Obstacle] = []

    def bed(north: float, east: float) -> float:
        return float(c.height(north, east))

    for _ in range(40):  # rows of piles
        n, e = rng.uniform(-900, 2400), rng.uniform(-1400, 1900)
        way = rng.uniform(0, 2 * np.pi)
        for k in range(12):
            a, b = n + 4 * k * np.cos(way), e + 4 * k * np.sin(way)
            z = bed(a, b)
            made.append(Cylinder((a, b, (z - 3) / 2), 0.25, (z + 3) / 2))
    for _ in range(60):
        n, e = rng.uniform(-900, 2400), rng.uniform(-1400, 1900)
        made += [Sphere((n, e, 0.0), 1.0), Capsule((n, e, 1.0), (n, e, bed(n, e)), 0.05)]
    for _ in range(8):  # cables
        n, e = rng.uniform(-900, 1500), rng.uniform(-1400, 1000)
        way = rng.uniform(0, np.pi / 2)
        at = [(n + 10 * k * np.cos(way), e + 10 * k * np.sin(way)) for k in range(51)]
        ends = [(a, b, bed(a, b)) for a, b in at]
        made += [Capsule(a, b, 0.05) for a, b in pairwise(ends)]
    while len(made) < 1130:
        n, e = rng.uniform(-900, 2400), rng.uniform(-1400, 1900)
        if len(made) % 3:
            made.append(Cylinder((n, e, bed(n, e) - 1.5), 5.0, 1.5))
        else:
            made.append(Box((n, e, 0.0), (20.0, 1.5, 0.5), rng.uniform(0, np.pi)))
    return tuple(made)


def place(x: Obstacle | PlacedMesh) -> tuple[float, float, float]:
    if isinstance(x, PlacedMesh):
        return x.position
    return x.start if isinstance(x, Capsule) else x.centre


def among(o: Any, made: tuple[Obstacle | PlacedMesh, ...], c: Caster) -> Any:
    """Move origins to within 30 m of an obstacle."""
    rng = np.random.default_rng(4)
    places = np.array([place(x) for x in made])[:, :2]
    at = places[rng.integers(len(places), size=len(o))] + rng.uniform(-30, 30, (len(o), 2))
    at = np.clip(at, (-950.0, -1450.0), (2450.0, 1950.0))
    up = c.height(at[:, 0], at[:, 1]) - rng.uniform(5, 40, len(o))
    return np.column_stack([at, np.maximum(up, 0.1)])
