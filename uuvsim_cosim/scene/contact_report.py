"""Warnings about contact in the summary of a run: starts inside, deep hulls, long steps."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from html import unescape
from pathlib import Path
from urllib.parse import parse_qs

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.parameter_files import Size, split_address, vehicle_size
from uuvsim_cosim.models.worlds.ground import ground_named

__all__ = ["contact_warnings"]

DEEP = 0.01  # m, from which a start inside something is reported


def contact_warnings(
    ssd: Path, tick: float, signals: Mapping[str, NDArray[np.float64]]
) -> list[str]:
    """Return a message for each hull deep inside something and each step that is too long.

    `ssd` names the scenes and steps of the contacts; `tick` is the system's step [s]; `signals`
    hold `<contact>.depth` (T,) [m] and `<contact>.touched` (T,).
    """
    try:
        text = unescape(ssd.read_text(encoding="utf-8"))
    except OSError:
        return []
    sources = [parse_qs(s) for s in re.findall(r"model:contact(?:\?([^\"'\s<]*))?", text)]
    scenes = {source.get("scene", ["flat"])[0] for source in sources}
    return [
        *_long_steps(sources, tick),
        *_inside(scenes, signals),
        *_sunk(sources, scenes, tick, signals),
    ]


def _long_steps(sources: list[dict[str, list[str]]], tick: float) -> Iterator[str]:
    """Yield a warning for each contact that is declared for shorter steps than the system's."""
    for step in sorted({float(source.get("step", ["0.01"])[0]) for source in sources}):
        if tick > step * (1.0 + 1e-9):
            yield (
                f"contact is declared for steps of at most {step:g} s, and the system's is "
                f"{tick:g} s: its forces are too stiff and can add energy; "
                f"expected model:contact?step={tick:g}"
            )


def _inside(scenes: set[str], signals: Mapping[str, NDArray[np.float64]]) -> Iterator[str]:
    """Yield a warning for each hull that starts inside something."""
    for name, touched in signals.items():
        path, _, signal = name.rpartition(".")
        depth = signals.get(f"{path}.depth")
        if signal != "touched" or depth is None or not len(touched):
            continue
        if touched[0] >= 0 and depth[0] > DEEP:
            yield (
                f"the hull of {path} starts {depth[0]:.2g} m deep in "
                f"{_named(scenes, int(touched[0]))}: contact pushes it out at up to 1 m/s"
            )


def _sunk(
    sources: list[dict[str, list[str]]],
    scenes: set[str],
    tick: float,
    signals: Mapping[str, NDArray[np.float64]],
) -> Iterator[str]:
    """Yield a warning for each hull that is in by more than half its smallest dimension."""
    vehicles = {source.get("vehicle", ["bluerov2_heavy"])[0] for source in sources}
    sizes = [size for size in map(_size, vehicles) if size is not None]
    if not sizes:
        return
    half = min(min(s.length, s.breadth, s.height) for s in sizes) / 2
    for name, touched in signals.items():
        path, _, signal = name.rpartition(".")
        depth = signals.get(f"{path}.depth")
        if signal != "touched" or depth is None or not len(touched) or depth[0] > DEEP:
            continue
        at = int(np.argmax(depth))
        if depth[at] > half:
            yield (
                f"the hull of {path} comes {depth[at]:.2g} m deep into "
                f"{_named(scenes, int(touched[at]))}, more than half its smallest dimension: "
                f"contact is softer the longer the step; expected a step of at most "
                f"{tick * (half / depth[at]) ** 0.5:.2g} s instead of {tick:g} s"
            )


def _size(vehicle: str) -> Size | None:
    try:
        return vehicle_size(split_address(vehicle)[0])
    except UuvsimError:  # gone since it was compiled
        return None


def _named(scenes: set[str], number: int) -> str:
    if number == 0:
        return "the seabed"
    names: tuple[str, ...] = ()
    try:
        if len(scenes) == 1:
            ground = ground_named(next(iter(scenes)))
            names = ground.names[: len(ground.solids)]
            if number > len(names):
                return "another vehicle"
    except UuvsimError:  # gone since it was compiled
        pass
    name = names[number - 1] if names else ""
    return f"obstacle {number} of the scene" + (f" ({name})" if name else "")
