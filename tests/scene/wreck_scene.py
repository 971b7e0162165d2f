"""Writes the shipped scene `tacoma_wreck`: the seabed about a charted wreck, with an invented hull.

    python -m tests.scene.wreck_scene

Position and depth are those of the chart (scene `tacoma`). The shape is made up here: a coaster of
28 m with a deckhouse and a funnel, which lies on its bilge. The chart states nothing of it.
"""

from __future__ import annotations

import shutil
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.models.worlds.placed_mesh import placed_mesh
from uuvsim_cosim.models.worlds.scene import Scene, load_scene, save_scene

LENGTH, BEAM, DEPTH = 28.0, 7.0, 4.0  # m, of the hull
STATIONS, POINTS = 29, 9  # along the hull; from the keel to the deck
CENTRE = (-1158.44, 1290.22)  # N, E [m], of the chart's cylinder
BED = 73.22  # D [m]: centre and half height of the chart's cylinder
CROP = 16  # nodes to each side
MADE = "the wreck's shape is made up"

Triangles = list[tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]]


def hull() -> Triangles:
    """Return the shell and the deck; x ahead, y to starboard, z down from the keel's line."""
    x = np.linspace(-LENGTH / 2, LENGTH / 2, STATIONS)
    along = np.clip(1.0 - np.abs(2.0 * x / LENGTH) ** 3, 0.0, 1.0)
    around = np.linspace(0.0, 1.0, POINTS)
    half = BEAM / 2 * along[:, None] * around[None, :] ** 0.4
    sheer = 0.6 * (2.0 * x / LENGTH) ** 2
    z = -(DEPTH + sheer[:, None]) * around[None, :]
    sides = [np.stack([np.broadcast_to(x[:, None], half.shape), s * half, z], -1) for s in (1, -1)]
    found: Triangles = []
    for side in sides:
        for i in range(STATIONS - 1):
            for k in range(POINTS - 1):
                a, b, c, d = side[i, k], side[i + 1, k], side[i + 1, k + 1], side[i, k + 1]
                found += [(a, b, c), (a, c, d)]
    starboard, port = sides[0][:, -1], sides[1][:, -1]
    for i in range(STATIONS - 1):
        if 17 <= i < 22:  # the hold is open
            continue
        found += [
            (starboard[i], starboard[i + 1], port[i + 1]),
            (starboard[i], port[i + 1], port[i]),
        ]
    return [t for t in found if np.linalg.norm(np.cross(t[1] - t[0], t[2] - t[0])) > 1e-9]


def box(centre: tuple[float, float, float], half: tuple[float, float, float]) -> Triangles:
    """Return the twelve triangles of a box."""
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * half
    corners = corners + np.array(centre)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return [
        (corners[a], corners[b], corners[c])
        for i, j, k, m in faces
        for a, b, c in ((i, j, k), (i, k, m))
    ]


def wreck_stl() -> str:
    """Return the mesh as an ASCII STL [m], which no package is needed to read; z is down."""
    triangles = hull()
    triangles += box((-8.5, 0.0, -DEPTH - 1.5), (3.0, 2.2, 1.5))  # deckhouse
    triangles += box((-10.0, 0.0, -DEPTH - 4.0), (0.7, 0.7, 1.2))  # funnel
    triangles += box((5.0, 0.0, -DEPTH - 3.0), (0.15, 0.15, 3.0))  # mast
    lines = [f"solid {MADE}: a coaster of {LENGTH:g} m; x ahead, y to starboard, z down [m]; CC0"]
    for triangle in triangles:
        lines += ["facet normal 0 0 0", "outer loop"]
        for corner in triangle:
            lines.append("vertex " + " ".join(f"{round(float(v), 3) + 0.0:g}" for v in corner))
        lines += ["endloop", "endfacet"]
    return "\n".join([*lines, "endsolid"]) + "\n"


def wreck_scene(folder: Path) -> None:
    """Write the scene's folder, without its README."""
    chart = load_scene("tacoma")
    terrain = chart.terrain
    assert terrain is not None
    assert terrain.sigma is not None
    assert terrain.material is not None
    at = [round((c - o) / terrain.spacing) for c, o in zip(CENTRE, terrain.origin, strict=True)]
    rows, columns = (slice(i - CROP, i + CROP + 1) for i in at)
    crop = replace(
        terrain,
        z=terrain.z[rows, columns],
        sigma=terrain.sigma[rows, columns],
        material=terrain.material[rows, columns],
        origin=(
            terrain.origin[0] + rows.start * terrain.spacing,
            terrain.origin[1] + columns.start * terrain.spacing,
        ),
    )
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "wreck.stl"
    file.write_text(wreck_stl(), encoding="utf-8")
    mesh = placed_mesh(
        file, (*CENTRE, BED), (0.45, 0.05, 65.0 * pi / 180.0), unit="m", axes="NED",
        material="steel", contact=False,
    )  # fmt: skip
    save_scene(
        Scene(
            "tacoma_wreck", crop, (), folder,
            "A charted wreck of Browns Point, Puget Sound, with an invented hull",
            f"{chart.source.partition(';')[0]}; not for navigation; {MADE}", (mesh,),
        ),
        folder,
    )  # fmt: skip


if __name__ == "__main__":
    shipped = content("models", "scenes", "tacoma_wreck")
    wreck_scene(shipped)
    text = (shipped / "scene.yaml").read_text(encoding="utf-8")
    text = text.replace("$schema=.schema/", "$schema=../../schema/")
    (shipped / "scene.yaml").write_text(text, encoding="utf-8")
    shutil.rmtree(shipped / ".schema")
