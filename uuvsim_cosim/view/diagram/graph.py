"""Graph of a block diagram: boxes with ports, and nets from one port to others."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from uuvsim_cosim.orchestrator.plan.loop_delays import equal_components
from uuvsim_cosim.orchestrator.system.elements import Element, step_text
from uuvsim_cosim.orchestrator.system.resolve import resolve
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.orchestrator.values.values import is_float

__all__ = ["Box", "Net", "boxes_and_nets", "text_width"]


@dataclass
class Box:
    """One component, nested system, or stack of equal components; ports are (name, label)."""

    key: str
    title: str
    subtitle: str
    kind: str
    rate: str
    count: int
    group: int | None
    inputs: list[str]
    outputs: list[str]
    labels: dict[str, str]  # by "< input" and "> output"


@dataclass(frozen=True)
class Net:
    """Value flow from an output port to input ports, each (box, port)."""

    source: tuple[str, str]
    targets: tuple[tuple[str, str], ...]


def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Estimate a text's width in a sans-serif font of this size, in px."""
    narrow = sum(c in "ijlt.,:;|!'()[] 1f/" for c in text)
    wide = sum(c in "mwMW…→" for c in text)
    per_character = 0.6 * len(text) - 0.24 * narrow + 0.25 * wide
    return size * per_character * (1.06 if bold else 1.0)


def boxes_and_nets(system: System) -> tuple[dict[str, Box], list[Net]]:
    """Return the diagram of the top level of a system; equal numbered components share a box."""
    wires = system.checked.wires
    neighbours: dict[str, set[str]] = {e.name: set() for e in system.elements}
    for w in wires:
        neighbours[w.source.element].add(f"> {w.target.element}")
        neighbours[w.target.element].add(f"< {w.source.element}")
    kinds = {e.name: f"{_label(e)}/{e.rate}" for e in system.elements}
    stacks = equal_components(kinds, neighbours)
    groups = {m: i for i, g in enumerate(system.groups) for m in g.members}
    boxes: dict[str, Box] = {}
    for element in system.elements:
        key = stacks[element.name]
        if key in boxes:
            boxes[key].count += 1
            continue
        nested = system.nested_or_none(element.name)
        kind = "system" if nested else resolve(str(element.source), system.base).kind
        step = Fraction(element.rate or (nested.base_step if nested else system.base_step))
        rate = f"{step_text(step * 1000)} ms" if step < 1 else f"{step_text(step)} s"
        group = groups.get(element.name)
        boxes[key] = Box(key, key, _label(element), kind, rate, 1, group, [], [], {})
    nets: dict[tuple[str, str], dict[tuple[str, str], None]] = {}
    for w in wires:
        source = (stacks[w.source.element], w.source.variable.name)
        target = (stacks[w.target.element], w.target.variable.name)
        nets.setdefault(source, {})[target] = None
        for (key, port), side, variable in (
            (source, ">", w.source.variable), (target, "<", w.target.variable),
        ):  # fmt: skip
            ports = boxes[key].outputs if side == ">" else boxes[key].inputs
            if port not in ports:
                ports.append(port)
                size = f" [{' x '.join(map(str, variable.shape))}]" if variable.shape else ""
                unit = variable.unit_text if is_float(variable) else ""
                unit = "" if unit in ("", "1") else f"  {unit}"
                boxes[key].labels[f"{side} {port}"] = f"{variable.name}{size}{unit}"
    return boxes, [Net(source, tuple(targets)) for source, targets in nets.items()]


def _label(element: Element) -> str:
    """Return a short name of a source: the file, the class, or the declaration."""
    if not isinstance(element.source, str):
        return element.source.name
    text = element.source
    if text.startswith("model:"):
        name, _, query = text.removeprefix("model:").partition("?")
        options = dict(part.partition("=")[::2] for part in query.split("&") if part)
        return options.get("id", name)
    return Path(text).name
