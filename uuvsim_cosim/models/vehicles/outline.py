"""Drawing of a vehicle from its files: from above and from starboard, to one scale, as SVG.

Hull by its size and shape, thrusters as arrows the way that positive thrust pushes, fins as lines
along their hinges, centres of gravity and buoyancy. x (ahead) points to the right in both views.
"""

from __future__ import annotations

from math import hypot
from pathlib import Path

from uuvsim_cosim.models.actuators.fins import fin_geometry
from uuvsim_cosim.models.actuators.thruster_geometry import thruster_geometry
from uuvsim_cosim.models.declaration.parameter_files import (
    Size,
    parameter_set,
    vehicle_folder,
    vehicle_ids,
    vehicle_size,
)

__all__ = ["outline_svg", "write_outlines"]

WIDTH, MARGIN, HEAD = 720.0, 36.0, 26.0
INK, HULL, PUSH, FIN = "#1f2937", "#e5e7eb", "#b45309", "#0f766e"


def write_outlines(root: Path | None = None) -> list[Path]:
    """Write a drawing, `outline.svg`, of each vehicle whose file states its size; return the files.

    They are in a folder for each vehicle below `root`, by default that of the vehicle's data.

    Example:

    >>> from pathlib import Path
    >>> from uuvsim_cosim.models import write_outlines
    >>> write_outlines(Path("drawings"))[0].as_posix()
    'drawings/bluerov2/outline.svg'
    """
    written = []
    for id in vehicle_ids():
        if vehicle_size(id) is not None:
            path = (vehicle_folder(id) if root is None else root / id) / "outline.svg"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(outline_svg(id), encoding="utf-8")
            written.append(path)
    return written


def outline_svg(id: str) -> str:
    """Return the picture of a vehicle; raises ValueError where its file states no size."""
    size = vehicle_size(id)
    if size is None:
        raise ValueError(f"{id}: its parameters.yaml states no size")
    folder = vehicle_folder(id)
    arrows, lines = [], []
    if (folder / "thrusters.yaml").is_file():
        geometry = thruster_geometry(id)
        arrows = list(zip(geometry.r.tolist(), geometry.e.tolist(), strict=True))
    if (folder / "fins.yaml").is_file():
        fins = fin_geometry(id)
        lines = list(zip(fins.r.tolist(), fins.a.tolist(), strict=True))
    points = [r for r, _ in (*arrows, *lines)]
    half = (size.length / 2, size.breadth / 2, size.height / 2)
    low = [min([size.at[i] - half[i], *(p[i] for p in points)]) for i in range(3)]
    high = [max([size.at[i] + half[i], *(p[i] for p in points)]) for i in range(3)]
    reach = 0.12 * max(h - lo for h, lo in zip(high, low, strict=True))
    low, high = [x - reach for x in low], [x + reach for x in high]
    scale = min((WIDTH - 2 * MARGIN) / (high[0] - low[0]), 300.0 / (high[1] - low[1]))
    parts, top = [], HEAD
    numbers = {k: q.value for k, q in parameter_set(id).quantities.items()}
    for across, title in ((1, "from above"), (2, "from starboard")):
        tall = (high[across] - low[across]) * scale
        view = _View(scale, low[0], low[across], across, top)
        parts.append(f'<text x="{MARGIN:g}" y="{top - 8:.1f}">{title}</text>')
        parts.append(_hull(size, view))
        for r, a in lines:
            (x, y), (to_x, to_y) = (
                view([p + s * 0.5 * reach * h for p, h in zip(r, a, strict=True)]) for s in (-1, 1)
            )
            style = f'stroke="{FIN}" stroke-width="5" stroke-linecap="round"'
            parts.append(f'<path d="M{x:.1f} {y:.1f}L{to_x:.1f} {to_y:.1f}" {style}/>')
        parts += [_arrow(view, r, e, reach) for r, e in arrows]
        for point, word in (("g", "CG"), ("b", "CB")):
            x, y = view([numbers.get(f"{axis}_{point}", 0.0) for axis in "xyz"])
            down = 14.0 if word == "CG" else -7.0
            parts.append(
                f'<path d="M{x - 4:.1f} {y:.1f}h8M{x:.1f} {y - 4:.1f}v8" stroke="{INK}"/>'
                f'<text x="{x + 5:.1f}" y="{y + down:.1f}" font-size="10">{word}</text>'
            )
        top += tall + HEAD + 8.0
    metre = 1.0 if high[0] - low[0] > 1.5 else 0.1
    y = top - 8.0
    parts.append(f'<path d="M{MARGIN:g} {y:.1f}h{metre * scale:.1f}" stroke="{INK}"/>')
    words = f"{metre:g} m" + ("; arrows: positive thrust" if arrows else "")
    parts.append(f'<text x="{MARGIN + metre * scale + 8:.1f}" y="{y + 4:.1f}">{words}</text>')
    body = "\n".join(parts)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH:g} {top + 8:.0f}" '
        f'role="img" aria-label="{id} from above and from starboard" '
        f'font-family="system-ui, sans-serif" font-size="12" fill="{INK}">\n'
        f'<rect width="100%" height="100%" fill="#ffffff"/>\n{body}\n</svg>\n'
    )


class _View:
    """Points of b to pixels: x to the right, y or z down."""

    def __init__(self, scale: float, x: float, low: float, across: int, top: float) -> None:
        self.scale, self.x, self.low, self.across, self.top = scale, x, low, across, top

    def __call__(self, p: list[float] | tuple[float, ...]) -> tuple[float, float]:
        across = p[self.across] - self.low
        return MARGIN + (p[0] - self.x) * self.scale, self.top + across * self.scale


def _hull(size: Size, view: _View) -> str:
    wide = size.length * view.scale
    tall = (size.breadth if view.across == 1 else size.height) * view.scale
    x, y = view(size.at)
    style = f'fill="{HULL}" stroke="{INK}"'
    if size.shape == "ellipsoid":
        return (
            f'<ellipse cx="{x:.1f}" cy="{y:.1f}" rx="{wide / 2:.1f}" ry="{tall / 2:.1f}" {style}/>'
        )
    left, up = x - wide / 2, y - tall / 2
    if size.shape == "box":
        box = f'width="{wide:.1f}" height="{tall:.1f}" rx="4"'
        return f'<rect x="{left:.1f}" y="{up:.1f}" {box} {style}/>'
    nose, tail = min(tall, wide / 4), min(1.8 * tall, wide / 3)
    r = tall / 2
    return (
        f'<path d="M{left:.1f} {y - 0.15 * r:.1f}'
        f"C{left + 0.5 * tail:.1f} {y - 0.8 * r:.1f} {left + 0.7 * tail:.1f} {up:.1f}"
        f" {left + tail:.1f} {up:.1f}H{left + wide - nose:.1f}"
        f"A{nose:.1f} {r:.1f} 0 0 1 {left + wide - nose:.1f} {y + r:.1f}H{left + tail:.1f}"
        f"C{left + 0.7 * tail:.1f} {y + r:.1f} {left + 0.5 * tail:.1f} {y + 0.8 * r:.1f}"
        f' {left:.1f} {y + 0.15 * r:.1f}Z" {style}/>'
    )


def _arrow(view: _View, r: list[float], e: list[float], length: float) -> str:
    x, y = view(r)
    to_x, to_y = view([a + length * b for a, b in zip(r, e, strict=True)])
    d = hypot(to_x - x, to_y - y)
    dot = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{PUSH}"/>'
    if d < 3.0:  # seen end on
        return dot
    u, v = (to_x - x) / d * 7.0, (to_y - y) / d * 7.0
    head = f"M{to_x - u - v / 2:.1f} {to_y - v + u / 2:.1f}L{to_x:.1f} {to_y:.1f}"
    head += f"L{to_x - u + v / 2:.1f} {to_y - v - u / 2:.1f}"
    return (
        f'{dot}<path d="M{x:.1f} {y:.1f}L{to_x:.1f} {to_y:.1f}{head}" '
        f'stroke="{PUSH}" stroke-width="2" fill="none"/>'
    )
