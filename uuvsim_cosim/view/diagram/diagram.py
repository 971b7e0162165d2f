"""Block diagram of a system as one self-contained SVG."""

from __future__ import annotations

from html import escape
from math import hypot

from uuvsim_cosim.orchestrator.plan.flatten import plan_to_inspect
from uuvsim_cosim.orchestrator.plan.loop_delays import loop_delays, loop_lines
from uuvsim_cosim.orchestrator.system.elements import step_text
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.view.diagram.graph import Box, boxes_and_nets, text_width
from uuvsim_cosim.view.diagram.layout import HEAD, ROW, Place, laid_out
from uuvsim_cosim.view.diagram.route import Point, routed

__all__ = ["diagram"]

_KIND = {"FMU": "#2b6cb0", "model": "#0f766e", "Python": "#b45309", "system": "#6d28d9"}
_LINES = ("#33658a", "#86543b", "#4a7c59", "#7b4b94", "#a23b55", "#5c6b73", "#b07d1a", "#2a7f9e")
_GROUPS = ("#fdf3d8", "#e3f0fb", "#fbe6ea", "#e6f5e6")
_INK, _FAINT, _RULE = "#1f2933", "#5f6c7b", "#c3cdd8"
_MARGIN, _TITLE, _LINE = 28.0, 58.0, 17.0


def diagram(system: System) -> str:
    """Draw the top level of a system: components, steps, bundles, groups, loop delays."""
    boxes, nets = boxes_and_nets(system)
    layout = laid_out(boxes, nets)
    routes = routed(layout, boxes, nets)
    caption = ["no loops" if system.elements else "no components"]
    loops = loop_delays(plan_to_inspect(system)[0]) if system.elements else []
    if loops:
        caption = ["Loops and their delay, one step for each connection:", *loop_lines(loops)]
        caption += [
            f"Shaded: {', '.join(g.members)} step in this order ({g.algorithm})"
            for g in system.groups
        ]
    facts = f"tick {step_text(system.base_step * 1000)} ms, {len(system.elements)} components"
    title = f"{system.description}. {facts}" if system.description else facts
    width = max(
        routes.width, text_width(title, 12.5), text_width(system.name, 19, bold=True),
        *(text_width(c, 12) + 8 for c in caption), 320.0,
    ) + 2 * _MARGIN  # fmt: skip
    shift = (width - routes.width) / 2
    caption_y = _MARGIN + _TITLE + routes.height + 40
    height = caption_y + _LINE * len(caption) + _MARGIN / 2
    colours = {key: _LINES[i % len(_LINES)] for i, key in enumerate(boxes)}
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.1f} {height:.1f}" role="img" '
        "font-family=\"system-ui, -apple-system, 'Segoe UI', Helvetica, Arial, sans-serif\">",
        f"<title>{escape(system.name)}</title>",
        '<rect width="100%" height="100%" fill="#ffffff"/>',
        _text(_MARGIN, _MARGIN + 16, system.name, 19, bold=True),
        _text(_MARGIN, _MARGIN + 36, title, 12.5, _FAINT),
        f'<g transform="translate({shift:.1f} {_MARGIN + _TITLE:.1f})">',
    ]
    for n, net in enumerate(nets):  # a white rim keeps the lines of two nets apart
        lines = [points for m, points in routes.lines if m == n]
        colour = colours[net.source[0]]
        for stroke, w in (("#ffffff", 4.5), (colour, 1.5)):
            parts += [
                f'<path d="{_rounded(p)}" fill="none" stroke="{stroke}" stroke-width="{w}"/>'
                for p in lines
            ]
        for points in lines:
            x, y = points[-1]
            parts.append(f'<path d="M{x:.1f} {y:.1f}l-7.5 -3.6v7.2z" fill="{colour}"/>')
    for key, box in boxes.items():
        place = layout.boxes[key]
        parts.append(_box(box, place, routes.columns[place.column]))
    parts.append("</g>")
    parts += [
        _text(_MARGIN, caption_y + _LINE * i, line, 12, _INK if i == 0 else _FAINT)
        for i, line in enumerate(caption)
    ]
    legend, x, y = "", width - _MARGIN, _MARGIN + 12
    for kind in reversed(list(dict.fromkeys(b.kind for b in boxes.values()))):
        x -= text_width(kind, 11.5) + 4
        legend += _text(x, y, kind, 11.5, _FAINT)
        x -= 15
        legend += (f'<rect x="{x:.1f}" y="{y - 9:.1f}" width="10" height="10" rx="2" '
                   f'fill="{_KIND.get(kind, "#64748b")}"/>')  # fmt: skip
        x -= 14
    parts.append(legend)
    parts.append("</svg>\n")
    return "\n".join(parts)


def _box(box: Box, place: Place, x: float) -> str:
    y, w, h = place.y, place.width, place.height
    colour = _KIND.get(box.kind, "#64748b")
    fill = "#ffffff" if box.group is None else _GROUPS[box.group % len(_GROUPS)]
    rect = (
        '<rect x="{:.1f}" y="{:.1f}" width="{:.1f}" height="{:.1f}" rx="6" '
        f'fill="{fill}" stroke="{_RULE}" stroke-width="1.2"/>'
    )
    parts = [rect.format(x + d, y + d, w, h) for d in ((8, 4) if box.count > 1 else ())]
    parts += [
        rect.format(x, y, w, h),
        f'<path d="M{x + 6:.1f} {y:.1f}h{w - 12:.1f}a6 6 0 0 1 6 6v-0h-{w:.1f}v0a6 6 0 0 1 6 -6z" '
        f'fill="{colour}"/>',
        _text(x + 12, y + 22, box.title, 13.5, bold=True),
        _text(x + 12, y + 37, box.subtitle, 11, colour),
        _text(x + w - 12, y + 37, box.rate, 11, _FAINT, anchor="end"),
    ]
    for i, port in enumerate(box.inputs):
        label = box.labels[f"< {port}"]
        parts.append(_text(x + 9, y + HEAD + ROW * (i + 0.5) + 4, label, 11.5, _FAINT))
    for i, port in enumerate(box.outputs):
        label = box.labels[f"> {port}"]
        parts.append(_text(x + w - 9, y + HEAD + ROW * (i + 0.5) + 4, label, 11.5, anchor="end"))
    return "<g>" + "".join(parts) + "</g>"


def _text(
    x: float, y: float, text: str, size: float, fill: str = _INK, *,
    bold: bool = False, anchor: str = "start",
) -> str:  # fmt: skip
    weight = ' font-weight="650"' if bold else ""
    place = "" if anchor == "start" else f' text-anchor="{anchor}"'
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size:g}" fill="{fill}"{weight}{place}>'
        f"{escape(text)}</text>"
    )


def _rounded(points: list[Point], radius: float = 5.0) -> str:
    """Return the path of a polyline whose corners are rounded."""
    kept = [p for i, p in enumerate(points) if i == 0 or hypot(p[0] - points[i - 1][0],
            p[1] - points[i - 1][1]) > 0.05]  # fmt: skip
    text = f"M{kept[0][0]:.1f} {kept[0][1]:.1f}"
    for a, b, c in zip(kept, kept[1:], kept[2:], strict=False):
        r = min(radius, hypot(b[0] - a[0], b[1] - a[1]) / 2, hypot(c[0] - b[0], c[1] - b[1]) / 2)
        p, q = _toward(b, a, r), _toward(b, c, r)
        text += f"L{p[0]:.1f} {p[1]:.1f}Q{b[0]:.1f} {b[1]:.1f} {q[0]:.1f} {q[1]:.1f}"
    return text + f"L{kept[-1][0]:.1f} {kept[-1][1]:.1f}"


def _toward(a: Point, b: Point, distance: float) -> Point:
    length = hypot(b[0] - a[0], b[1] - a[1])
    return a[0] + (b[0] - a[0]) * distance / length, a[1] + (b[1] - a[1]) * distance / length
