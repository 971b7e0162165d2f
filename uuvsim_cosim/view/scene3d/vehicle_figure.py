"""Figure of vehicles in three dimensions, as SVG: hull, thrusters and fins at their places.

Each panel is a parallel projection from ahead, starboard and above, to a scale of its own. The hull
is the solid that the vehicle's file states (box, ellipsoid or torpedo). Thrusters are short tubes
with an arrow along positive thrust, and fins are plates along their hinges; their places and
directions are those of the files, their sizes are chosen, because the files state none.

Polygons are sorted by depth. A polygon covers a convex hull if its middle is outside of one of the
faces that are seen; else the hull covers it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.actuators.fins import fin_geometry
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.parameter_files import (
    Size,
    split_address,
    vehicle_folder,
    vehicle_ids,
    vehicle_size,
)
from uuvsim_cosim.view.plots.svg import escape
from uuvsim_cosim.view.scene3d.shapes import hull_of

__all__ = ["vehicle_figure"]

Array = NDArray[np.float64]
COLUMNS, WIDE, TALL, HEAD, FOOT = 4, 250.0, 170.0, 34.0, 30.0  # panels and their sizes [px]
INK, HULL, PUSH, FIN = "#1f2937", "#c9d3df", "#b45309", "#0f766e"
TOWARDS = np.array([0.62, 0.55, -0.56]) / np.linalg.norm([0.62, 0.55, -0.56])  # the viewer, in b
LIGHT = np.array([0.25, 0.45, -0.86]) / np.linalg.norm([0.25, 0.45, -0.86])


def _axes() -> Array:
    """Return the rows right and down of the picture, in b."""
    right = np.cross(TOWARDS, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(right, TOWARDS)])


ACROSS = _axes()


@dataclass(frozen=True)
class _Part:
    """A filled polygon (n, 3), or an open line without a fill, in b [m]."""

    corners: Array
    colour: str
    filled: bool = True

    @property
    def middle(self) -> Array:
        return np.asarray(self.corners.mean(axis=0))


def vehicle_figure(vehicles: Sequence[str] = ()) -> str:
    """Return a figure with one panel for each vehicle, four in a row, as the text of an SVG.

    `vehicles` are ids or folders; without them, all shipped vehicles are drawn. Raises
    InputInvalid if a file states no size.

    Example:

    >>> from uuvsim_cosim.view.scene3d.vehicle_figure import vehicle_figure
    >>> vehicle_figure(["remus100"]).count('class="fin"')
    4
    """
    ids = list(vehicles) or list(vehicle_ids())
    panels = []
    for i, id in enumerate(ids):
        row, column = divmod(i, COLUMNS)
        place = f"translate({column * WIDE:g} {row * (HEAD + TALL + FOOT):g})"
        panels.append(f'<g transform="{place}">\n{_panel(id)}\n</g>')
    rows = -(-len(ids) // COLUMNS)
    width, height = min(len(ids), COLUMNS) * WIDE, rows * (HEAD + TALL + FOOT)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height + 26:g}" '
        f'role="img" aria-label="{len(ids)} vehicles from ahead, starboard and above" '
        f'font-family="system-ui, sans-serif" font-size="12" fill="{INK}" '
        'stroke-linejoin="round" stroke-linecap="round">\n'
        '<rect width="100%" height="100%" fill="#ffffff"/>\n'
        + "\n".join(panels)
        + f'\n<text x="16" y="{height + 12:g}"><tspan fill="{PUSH}">positive thrust</tspan>'
        f'<tspan dx="16" fill="{FIN}">fins</tspan></text>\n</svg>\n'
    )


def _panel(id: str) -> str:
    name, _ = split_address(id)
    size = vehicle_size(name)
    if size is None:
        raise InputInvalid(f"{id}: parameters.yaml", "no size", "`size`, to draw the vehicle")
    unit = float(np.cbrt(size.length * size.breadth * size.height))
    folder = vehicle_folder(name)
    groups: list[tuple[str, list[_Part]]] = []
    if (folder / "thrusters.yaml").is_file():
        geometry = thruster_geometry(name)
        for r, e in zip(geometry.r, geometry.e, strict=True):
            groups.append(("thruster", _thruster(r, e, unit)))
    if (folder / "fins.yaml").is_file():
        fins = fin_geometry(name)
        for r, a in zip(fins.r, fins.a, strict=True):
            groups.append(("fin", _fin(r, a, size)))
    faces = _faces(size)
    shown = [p.corners for _, parts in groups for p in parts] + [c for c, _ in faces]
    seen = np.concatenate(shown) @ ACROSS.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    scale = float(min((WIDE - 32.0) / (high[0] - low[0]), TALL / (high[1] - low[1])))
    shift = np.array([0.5 * WIDE, HEAD + 0.5 * TALL]) - 0.5 * scale * (low + high)

    def drawn(kind: str, part: _Part) -> str:
        points = part.corners @ ACROSS.T * scale + shift
        text = "L".join(f"{x:g} {y:g}" for x, y in np.round(points, 1).tolist())
        if not part.filled:
            style = f'fill="none" stroke="{part.colour}" stroke-width="1.6"'
            return f'<path class="{kind}" d="M{text}" {style}/>'
        style = f'fill="{part.colour}" stroke="{part.colour}" stroke-width="0.6"'
        return f'<path class="{kind}" d="M{text}Z" {style}/>'

    under: list[tuple[float, str]] = []
    over: list[tuple[float, str]] = []
    opaque = size.shape == "torpedo"
    for kind, parts in groups:
        for part in parts:
            outside = max(float(n @ (part.middle - corners[0])) for corners, n in faces)
            if opaque and not part.filled:  # the arrow of a stern propeller is not hidden
                outside = 1.0
            where = over if outside > 1e-9 else under
            where.append((float(part.middle @ TOWARDS), drawn(kind, part)))
    alike: dict[str, str] = {}
    for corners, n in faces:
        points = np.round(corners @ ACROSS.T * scale + shift, 1).tolist()
        colour = _shade(HULL, n)
        outline = "M" + "L".join(f"{x:g} {y:g}" for x, y in points) + "Z"
        alike[colour] = alike.get(colour, "") + outline
    hull = [
        f'<path class="hull" d="{d}" fill="{colour}" fill-opacity="{1.0 if opaque else 0.55:g}" '
        f'stroke="{colour}" stroke-width="0.6"/>'
        for colour, d in alike.items()
    ]
    metre = next(m for m in (2.0, 1.0, 0.5, 0.2, 0.1, 0.05) if m * scale < 0.4 * WIDE)
    y = HEAD + TALL + 14.0
    return "\n".join(
        [
            f'<text x="16" y="18" font-weight="600">{escape(name)}</text>',
            *(text for _, text in sorted(under)),
            *hull,
            *(text for _, text in sorted(over)),
            f'<path d="M16 {y:g}h{metre * scale:.1f}" stroke="{INK}" stroke-width="1.5"/>',
            f'<text x="{22 + metre * scale:.1f}" y="{y + 4:g}" font-size="11">{metre:g} m</text>',
        ]
    )


def _faces(size: Size) -> list[tuple[Array, Array]]:
    """Return the faces of a hull that are seen: corners (n, 3) in order and normal (3,)."""
    mesh = hull_of(size)
    vertices = np.asarray(mesh.vertices, float)
    centre = 0.5 * (vertices.max(axis=0) + vertices.min(axis=0))
    planes: dict[tuple[float, ...], list[int]] = {}
    for face in mesh.faces.tolist():
        a, b, c = vertices[face]
        n = np.cross(b - a, c - a)
        area = float(np.linalg.norm(n))
        if area < 1e-9:
            continue
        n = n / area * (1.0 if n @ (a - centre) > 0 else -1.0)
        if n @ TOWARDS > 1e-3:
            planes.setdefault((*np.round(n, 3).tolist(), round(float(n @ a), 4)), []).extend(face)
    found = []
    for key, numbers in planes.items():
        normal = np.array(key[:3])
        corners = np.unique(vertices[numbers], axis=0)
        middle = corners.mean(axis=0)
        u = corners[0] - middle
        v = np.cross(normal, u)
        order = np.argsort(np.arctan2((corners - middle) @ v, (corners - middle) @ u))
        found.append((corners[order], normal))
    return sorted(found, key=lambda f: float(f[0].mean(axis=0) @ TOWARDS))


def _thruster(r: Array, e: Array, unit: float) -> list[_Part]:
    """Return a tube of length and radius in proportion to the hull, and its arrow."""
    radius, half = 0.12 * unit, 0.05 * unit
    u = np.cross(e, np.eye(3)[int(np.argmin(np.abs(e)))])
    u /= np.linalg.norm(u)
    v = np.cross(e, u)
    angle = np.linspace(0.0, 2.0 * np.pi, 13)
    ring = r + radius * (np.cos(angle)[:, None] * u + np.sin(angle)[:, None] * v)
    parts = []
    for i in range(12):
        a, b = ring[i], ring[i + 1]
        n = 0.5 * (a + b) - r
        corners = np.array([a - half * e, b - half * e, b + half * e, a + half * e])
        # Both sides of the tube are seen: the wall behind through its opening.
        parts.append(_Part(corners, _shade("#64748b", n if n @ TOWARDS > 0 else -n)))
    tip = r + 0.42 * unit * e
    side = np.cross(e, TOWARDS)
    if np.linalg.norm(side) > 0.1:
        side *= 0.05 * unit / np.linalg.norm(side)
    back = tip - 0.1 * unit * e
    parts.append(_Part(np.array([r + half * e, tip]), PUSH, filled=False))
    parts.append(_Part(np.array([back - side, tip, back + side]), PUSH, filled=False))
    return parts


def _fin(r: Array, a: Array, size: Size) -> list[_Part]:
    """Return a plate whose span is along the hinge `a`: one fin, or a pair if r is on the axis."""
    wide = min(size.breadth, size.height)
    span = wide * (1.7 if np.hypot(r[1], r[2]) < 0.1 * wide else 0.8)
    chord = np.cross(a, np.cross([1.0, 0.0, 0.0], a))
    chord *= 0.28 * wide / np.linalg.norm(chord)
    root, tip = r - 0.5 * span * a, r + 0.5 * span * a
    n = np.cross(a, chord)
    corners = np.array([root - chord, tip - chord, tip + chord, root + chord])
    return [_Part(corners, _shade(FIN, n if n @ TOWARDS > 0 else -n))]


def _shade(colour: str, normal: Array) -> str:
    """Return a colour as it is lit on a surface with this normal, of any length."""
    length = float(np.linalg.norm(normal))
    lit = 0.68 + 0.32 * float(normal @ LIGHT) / (length or 1.0)
    parts = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return "#" + "".join(f"{min(255, max(0, round(p * lit))):02x}" for p in parts)
