"""The 3-D scene of the one-file report: data, canvas and script, without network access.

Horizontal positions are relative to the middle of the motion (`origin`), so that 32 bits are enough
far from the origin of `n` as well.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.models.worlds.terrain import Terrain
from uuvsim_cosim.view.plots.page import MARKS, encoded
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.recorded.traces import Array
from uuvsim_cosim.view.scene3d.colours import (
    ARROW,
    BODIES,
    ESTIMATE,
    MARKER,
    PATH,
    SOLIDS,
    TINTS,
)
from uuvsim_cosim.view.scene3d.motion import Motion, extent
from uuvsim_cosim.view.scene3d.scene import Mesh, Scene3D, Solid
from uuvsim_cosim.view.scene3d.shapes import cropped, floor, lathe, surface

__all__ = ["MOMENTS", "scene_card", "scene_data", "scene_html"]

MOMENTS = 900  # of the motion; between two the page interpolates
NODES = 128  # of the terrain, a side
BODIES_MOST = 16
ALPHA = {"basin": 0.35, "surface": 0.15}  # opacity of transparent parts
AROUND = 2.0  # terrain is shown this many extents of the motion around it


def scene_html(scene3d: Scene3D, motion: Motion) -> str:
    """Return the card with the scene, its data and its script; empty if nothing moves."""
    if not motion.positions or len(motion.time) < 2:
        return ""
    return scene_card(scene3d, motion, scene_data(scene3d, motion))


def scene_card(
    scene3d: Scene3D, motion: Motion, content: dict[str, Any], *, live: bool = False
) -> str:
    """Return the card of a scene with this data; a `live` one has no controls of its time."""
    data = json.dumps(content | {"live": live}, separators=(",", ":"), allow_nan=False)
    data = data.replace("<", "\\u003c")  # a name with "</script>" must not end the element
    script = _own("scene.js").replace("/*MATH*/", _own("scene_math.js"))
    script = script.replace("/*GL*/", _own("scene_gl.js"))
    speeds = "".join(
        f'<option value="{s}"{" selected" if s == 4 else ""}>{s} x</option>'
        for s in (0.25, 1, 4, 16, 64)
    )
    first = scene3d.bodies[0].name if scene3d.bodies else ""
    legend = _legend(scene3d, motion, content["terrain"])
    notes = "".join(f"<small>{escape(note)}</small>" for note in scene3d.notes)
    replay = (
        '<button class="go" type="button">play</button>'
        '<input type="range" aria-label="time"><span class="clock"></span>'
        f'<select aria-label="speed">{speeds}</select>'
    )
    return (
        '<div class="card" id="scene"><h3>Scene<span class="keys">drag to turn, shift-drag to '
        "move, click and wheel to zoom</span></h3>"
        '<div class="viewport"><canvas tabindex="0" aria-label="Scene of the run"></canvas>'
        f'<canvas class="overlay"></canvas></div><p class="keys">{legend}</p>'
        f'<p class="controls">{"" if live else replay}'
        f'<label><input class="follow" type="checkbox"> follow {escape(first)}</label> '
        '<label title="colour and fog of water; the fog is scaled to the view">'
        '<input class="wet" type="checkbox"> water</label> '
        '<label title="light that waves focus on the ground; an invented pattern">'
        f'<input class="net" type="checkbox"> caustics</label></p>{notes}'
        f'<script id="scene-data" type="application/json">{data}'
        f"</script>\n<script>{script}</script></div>"
    )


def _legend(scene3d: Scene3D, motion: Motion, terrain: dict[str, Any] | None) -> str:
    """Return the legend of the scene: a mark and a label for each part that is drawn.

    `terrain` is that of the scene's data.
    """

    def entry(label: str, colour: str, shape: str, mark: str = "") -> str:
        over = f'<path d="{mark}" fill="{colour}" transform="translate(11 5)"/>' if mark else ""
        return (
            f'<span class="key"><svg viewBox="0 0 22 10"><path d="{shape}" stroke="{colour}" '
            f'fill="none" stroke-width="2"/>{over}</svg>{escape(label)}</span>'
        )

    moving = [b for b in scene3d.bodies[:BODIES_MOST] if b.name in motion.positions]
    line, arrow, box = "M0 5H22", "M2 8L18 3M13 1L18 3L15 7", "M3 1.5H19V8.5H3Z"
    parts = [
        entry(f"{body.name} and its track", BODIES[i % len(BODIES)], line, MARKS["truth"])
        for i, body in enumerate(moving[:8])
    ]
    if any(body.name in motion.estimates for body in moving):
        parts.append(entry("estimated track", ESTIMATE, line, MARKS["estimate"]))
    if scene3d.lines:
        parts.append(entry("planned path", PATH, line, MARKS["fourth"]))
    if any(body.name in motion.thrusts for body in moving):
        parts.append(entry("thrust", ARROW, arrow))
    if any(marker.name in motion.positions for marker in scene3d.markers):
        parts.append(entry("target", MARKER, "", MARKS["truth"]))
    if any(solid.kind == "obstacle" for solid in scene3d.solids):
        parts.append(entry("obstacle", SOLIDS["obstacle"], box))
    if terrain is not None:
        low, high = terrain["depths"]
        parts.append(
            '<span class="key"><span class="ramp" style="background:linear-gradient(90deg,'
            f'{",".join(TINTS)})"></span>seabed, {low:.3g} to {high:.3g} m deep</span>'
            '<span class="key"><svg viewBox="0 0 22 10"><path d="M0 7C6 -2 14 12 22 3" '
            'stroke="currentColor" fill="none"/></svg><span class="interval"></span></span>'
        )
    elif scene3d.bottom is not None:
        parts.append(entry(f"bottom at {scene3d.bottom:g} m", SOLIDS["floor"], box))
    return "".join(parts)


def scene_data(scene3d: Scene3D, motion: Motion) -> dict[str, Any]:
    """Return the data of the script: meshes, poses, arrows, lines; binary parts as base64."""
    low, high = extent(scene3d, motion)
    origin = np.append(np.round(0.5 * (low[:2] + high[:2]), 3), 0.0)
    data: dict[str, Any] = {
        "time": _floats(motion.time), "extent": [_list(low - origin), _list(high - origin)],
        "origin": _list(origin), "arrow": ARROW, "hulls": [], "bodies": [], "lines": [],
        "solids": [], "terrain": None,
    }  # fmt: skip

    def add_line(points: Array, colour: str, width: float, mark: str, every: int = 0) -> None:
        known = points[np.isfinite(points).all(axis=1)] - origin
        if len(known) > 1:
            data["lines"].append({"points": _floats(known), "colour": colour, "width": width,
                                  "mark": MARKS[mark], "every": every})  # fmt: skip

    def hull(mesh: Mesh) -> int:
        packed = _packed(mesh)
        if packed not in data["hulls"]:  # vehicles of one kind share theirs
            data["hulls"].append(packed)
        return int(data["hulls"].index(packed))

    for i, body in enumerate(scene3d.bodies[:BODIES_MOST]):
        if body.name not in motion.positions:
            continue
        colour = BODIES[i % len(BODIES)]
        at = motion.positions[body.name]
        entry: dict[str, object] = {
            "name": body.name, "p": _floats(_held(at) - origin), "size": body.size,
            "colour": colour,
            "q": _shorts(motion.attitudes[body.name]), "hull": hull(body.hull), "arrows": None,
        }  # fmt: skip
        thrust = motion.thrusts.get(body.name)
        if thrust is not None:
            length = thrust * motion.scales[body.name]
            most = max(float(np.abs(length).max()), 1e-9)
            r, e = [_list(a.r) for a in body.arrows], [_list(a.e) for a in body.arrows]
            entry["arrows"] = {"r": r, "e": e, "v": _shorts(length / most), "scale": most}
        data["bodies"].append(entry)
        add_line(at, colour, 1.6, "truth")
        if body.name in motion.estimates:
            add_line(motion.estimates[body.name], ESTIMATE, 1.0, "estimate")
    t = np.linspace(0.0, np.pi, 9)
    for marker in scene3d.markers[:BODIES_MOST]:
        if marker.name in motion.positions:
            ball = hull(lathe(-marker.radius * np.cos(t), marker.radius * np.sin(t), 14))
            p = motion.positions[marker.name]
            data["bodies"].append({
                "name": marker.name, "p": _floats(_held(p) - origin), "size": 4 * marker.radius,
                "q": None, "colour": MARKER, "arrows": None, "hull": ball,
            })  # fmt: skip
            add_line(p, MARKER, 1.0, "truth")
    for line in scene3d.lines:
        add_line(line.points, PATH, 1.8, "fourth", max(1, len(line.points) // 60))
    margin = 0.5 * float(max(high[:2] - low[:2])) + 5.0
    if scene3d.terrain is not None:
        margin = max(AROUND * float(max(high[:2] - low[:2])), 60.0)
        data["terrain"] = _terrain(cropped(scene3d.terrain, low, high, margin))
    around = low[:2] - margin, high[:2] + margin
    shown = []
    for solid in scene3d.solids:  # those far from a terrain's part are left out
        places = solid.mesh.vertices[:, :2]
        near = (places.max(axis=0) > around[0]).all() and (places.min(axis=0) < around[1]).all()
        if scene3d.terrain is None or near:
            shown.append(solid)
    if scene3d.terrain is None and scene3d.bottom is not None:
        shown.append(Solid("bottom", floor(*around, scene3d.bottom), "floor"))
    if scene3d.terrain is not None or scene3d.bottom is not None:
        shown.append(Solid("surface", surface(*around), "surface"))
    for solid in shown:
        colour, alpha = SOLIDS.get(solid.kind, PATH), ALPHA.get(solid.kind, 1)
        data["solids"].append({**_mesh(solid.mesh, origin), "colour": colour, "alpha": alpha})
    return data


def _own(name: str) -> str:
    return files("uuvsim_cosim.view.scene3d").joinpath(name).read_text(encoding="utf-8")


def _floats(values: ArrayLike) -> str:
    return encoded(np.asarray(values, "<f4"))


def _shorts(values: Array) -> str:
    """Return numbers of -1 to 1 in 16 bits each."""
    return encoded(np.clip(np.nan_to_num(values) * 32767, -32767, 32767).round().astype("<i2"))


def _list(values: Iterable[float]) -> list[float]:
    return [round(float(v), 4) for v in values]


def _mesh(mesh: Mesh, origin: Array | float = 0.0) -> dict[str, str]:
    return {"v": _floats(mesh.vertices - origin), "f": encoded(mesh.faces.astype("<u4"))}


def _packed(mesh: Mesh) -> dict[str, Any]:
    """Return a hull with 16 bits a coordinate: 0.1 mm for one of 5 m."""
    low = mesh.vertices.min(axis=0)
    step = float(max(np.ptp(mesh.vertices, axis=0).max(), 1e-6)) / 65535
    places = ((mesh.vertices - low) / step).round().astype("<u2")
    wide = "<u2" if len(places) <= 65536 else "<u4"
    return {
        "low": [float(x) for x in low],
        "step": step,
        "v": encoded(places),
        "f": encoded(mesh.faces.astype(wide)),
        "wide": wide == "<u4",
    }


def _held(points: Array) -> Array:
    """Return points with three NaN where any coordinate is not finite."""
    return np.where(np.isfinite(points).all(axis=1, keepdims=True), points, np.nan)


def _terrain(terrain: Terrain) -> dict[str, object]:
    """Return a height field with at most NODES a side, depths in 16 bits; -32768 is unknown."""
    steps = [max(1, -(-size // NODES)) for size in terrain.z.shape]
    z = terrain.z[:: steps[0], :: steps[1]].astype(float)
    known = np.isfinite(z)
    low, high = (float(z[known].min()), float(z[known].max())) if known.any() else (0.0, 1.0)
    step = max(high - low, 1e-6) / 32767
    coded = np.where(known, (np.where(known, z, low) - low) / step, -32768).round().astype("<i2")
    rows, columns = (
        start + np.arange(n) * terrain.spacing * k
        for start, n, k in zip(terrain.origin, z.shape, steps, strict=True)
    )
    return {
        "z": encoded(coded), "shape": list(z.shape), "low": low, "step": step,
        "north": _list(rows), "east": _list(columns), "depths": [low, max(high, low + 1e-3)],
    }  # fmt: skip
