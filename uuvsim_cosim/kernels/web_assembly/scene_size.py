"""Size of the scenes in a WebAssembly module: each declaration that names one has its own copy."""

from __future__ import annotations

import math
from collections.abc import Iterable
from urllib.parse import parse_qsl

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.models.worlds.ground import scene_named

__all__ = ["MOST_BYTES", "refuse_large_scenes", "scene_bytes"]

MOST_BYTES = 8e6  # of all scenes of a module; the compiler needs about 3 kB of memory for a byte
_PYRAMID = 4 / 3  # a terrain with the ranges of depth over it, of float32 nodes
_TRIANGLE = 4 * (3 + 3 + 7)  # corners, about as many vertices, and its part of the search tree


def scene_bytes(source: str) -> tuple[float, str]:
    """Return the bytes that a declaration's scene takes in a module, and what it consists of."""
    options = dict(parse_qsl(source.partition("?")[2]))
    named = options.get("scene") or options.get("terrain")
    if not source.startswith("model:") or not named:
        return 0.0, ""
    scene = scene_named(named)
    triangles = sum(len(m.corners) for m in scene.meshes)
    nodes = 0 if scene.terrain is None else scene.terrain.z.size
    parts = [f"{nodes:,} nodes"] * bool(nodes) + [f"{triangles:,} triangles"] * bool(triangles)
    words = f"{scene.name or named} of {' and '.join(parts) or 'solids'}"
    return 4.0 * nodes * _PYRAMID + triangles * _TRIANGLE, words


def refuse_large_scenes(sources: Iterable[str]) -> None:
    """Raise SystemInvalid with an estimate if the scenes are too large for a module."""
    found = {source: scene_bytes(source) for source in dict.fromkeys(sources)}
    total = sum(size for size, _ in found.values())
    if total <= MOST_BYTES:
        return
    coarser = math.sqrt(total / MOST_BYTES)
    expected = (
        f"at most {MOST_BYTES / 1e6:g} MB for all scenes of a page: a terrain of {coarser:.1f} "
        "times the spacing or of a smaller area (`uuvsim terrain FILE --resolution METRES --size "
        "KM -o SCENE`), or the report of a run, which shows its scene without computing it"
    )
    raise SystemInvalid(
        [
            Problem(source, f"the scene {words} takes about {size / 1e6:.3g} MB", expected)
            for source, (size, words) in found.items()
            if size
        ]
    )
