"""Warnings in the summary of a run: hulls outside of the terrain, and contacts that go wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from html import unescape
from pathlib import Path
from urllib.parse import parse_qs, unquote

import numpy as np

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_size
from uuvsim_cosim.models.worlds.ground import ground_named, scene_named
from uuvsim_cosim.orchestrator.recording.samples import Array, blocks, element
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["contact_warnings", "sonar_warnings", "terrain_warnings"]

DEEP = 0.01  # m, from which a start inside something is reported


def terrain_warnings(ssd: Path, time: Array, signals: Mapping[str, Array]) -> list[str]:
    """Return a warning for each hull outside of the terrain of a scene that `ssd` names.

    Sensors get no echo there. A hull is a signal `hull.eta` (T, 6), below any path; `time` is
    (T,) [s].
    """
    named = re.findall(r"[?&]scene=([^&\"'\s<]+)", _text_of(ssd))
    scenes = [s for s in dict.fromkeys(unquote(n) for n in named) if s != "flat"]
    hulls = [n for n in signals if n == "hull.eta" or n.endswith(".hull.eta")]
    found = [_outside(scene, hull, time, signals) for scene in scenes for hull in hulls]
    return [warning for warning in found if warning]


def _outside(scene: str, eta: str, time: Array, signals: Mapping[str, Array]) -> str:
    """Return the warning on a hull outside of the terrain of a scene; empty without."""
    try:
        terrain = scene_named(scene).terrain
    except UuvsimError:  # the file was deleted since it was compiled
        return ""
    if terrain is None or not len(time):
        return ""
    caster = Caster(terrain)
    low = np.array(terrain.origin)
    high = low + terrain.spacing * (np.array(terrain.z.shape) - 1)
    unknown: list[int] = []  # of each block: samples without terrain, and samples below it
    under: list[int] = []
    first: dict[bool, float] = {}  # time at which there first is no terrain, or the hull below it
    beside, row = False, 0
    position = [element(signals, eta, k, len(time)) for k in range(3)]
    for north, east, down in zip(*map(blocks, position), strict=True):
        z = caster.height(north, east)
        for rows, count, known in ((np.isnan(z), unknown, False), (down > z, under, True)):
            count.append(int(np.sum(rows)))
            if count[-1]:
                first.setdefault(known, float(time[row + np.argmax(rows)]))
        at = np.column_stack([north, east])
        beside = beside or bool(np.any((at < low) | (at > high)))
        row += len(north)
    hull = eta.removesuffix(".eta")
    if not first:
        return ""
    if False not in first:
        return (
            f"{hull} was below the seabed of scene {scene} for {100 * sum(under) / row:.0f} % of "
            f"the time, first at t = {first[True]:g} s: sensors hear nothing there"
        )
    where = "left the terrain" if beside else "was over a hole in the terrain"
    return (
        f"{hull} {where} of scene {scene} (N {low[0]:.0f} to {high[0]:.0f} m, E {low[1]:.0f} to "
        f"{high[1]:.0f} m) for {100 * sum(unknown) / row:.0f} % of the time, first at t = "
        f"{first[False]:g} s: sensors hear nothing there, and there is no bed to touch"
    )


def sonar_warnings(ssd: Path, time: Array, signals: Mapping[str, Array]) -> list[str]:
    """Return a message for each hull above the water or in an obstacle, where there are sonars."""
    sonars = re.findall(r"model:(?:\w+_sonar)\b[^\"'\s<]*", _text_of(ssd))
    scenes = [parse_qs(s.partition("?")[2]).get("scene", ["flat"])[0] for s in sonars]
    found = []
    for eta in (n for n in signals if n == "hull.eta" or n.endswith(".hull.eta")):
        columns = (blocks(element(signals, eta, k, len(time))) for k in range(3))
        at = np.column_stack([np.concatenate([*column, np.zeros(0)]) for column in columns])
        if not len(at):
            continue
        for scene in dict.fromkeys(scenes):
            cases = {"above the water": at[:, 2] < 0.0}
            with suppress(UuvsimError):  # the file was deleted since it was compiled
                caster = Caster(scene)
                cases[f"in an obstacle of scene {scene}"] = caster.inside(at) >= 0
            found += [
                f"{eta.removesuffix('.eta')} was {where} for {100 * np.mean(there):.0f} % of the "
                f"time, first at t = {time[np.argmax(there)]:g} s: sonars show noise alone there"
                for where, there in cases.items()
                if there.any()
            ]
    for name in (n for n in signals if n.endswith(".water_known")):
        parts = list(blocks(element(signals, name, 0, len(time))))
        known = np.concatenate([*parts, np.zeros(0)]) > 0.5
        known[: int(np.argmax(known))] |= known.any()  # before the first ping
        if len(known) and not known.all():
            found.append(
                f"{name.rpartition('.')[0]}: the water was beyond the range of the formula of the "
                f"absorption for {100 * np.mean(~known):.0f} % of the time: the nearest values in "
                "the range were used"
            )
    return list(dict.fromkeys(found))


def contact_warnings(ssd: Path, tick: float, signals: Mapping[str, Array]) -> list[str]:
    """Return a message for each hull deep inside something and each step that is too long.

    `ssd` names the scenes and steps of the contacts; `tick` is the system's step [s]; `signals`
    hold `<contact>.depth` (T,) [m] and `<contact>.touched` (T,).
    """
    queries = re.findall(r"model:contact(?:\?([^\"'\s<]*))?", _text_of(ssd))
    sources = [parse_qs(query) for query in queries]
    scenes = {source.get("scene", ["flat"])[0] for source in sources}
    long_steps = [
        f"contact is declared for steps of at most {step:g} s, and the system's is {tick:g} s: "
        f"its forces are too stiff and can add energy; expected model:contact?step={tick:g}"
        for step in sorted({float(source.get("step", ["0.01"])[0]) for source in sources})
        if tick > step * (1.0 + 1e-9)
    ]
    half = np.inf  # of the smallest dimension of all hulls [m]
    for vehicle in {source.get("vehicle", ["bluerov2_heavy"])[0] for source in sources}:
        with suppress(UuvsimError):  # the file was deleted since it was compiled
            if (size := vehicle_size(split_address(vehicle)[0])) is not None:
                half = min(half, min(size.length, size.breadth, size.height) / 2)
    starts_inside, deep = [], []
    for name in signals:  # only the signals of contacts are read
        path, _, signal = name.rpartition(".")
        if signal != "touched" or f"{path}.depth" not in signals:
            continue
        touched, depth = signals[name], signals[f"{path}.depth"]
        if not len(touched):
            continue
        if depth[0] > DEEP:
            if touched[0] >= 0:
                starts_inside.append(
                    f"the hull of {path} starts {depth[0]:.2g} m deep in "
                    f"{_named(scenes, int(touched[0]))}: contact pushes it out at up to 1 m/s"
                )
            continue
        at = int(np.argmax(depth))
        if depth[at] > half:
            deep.append(
                f"the hull of {path} comes {depth[at]:.2g} m deep into "
                f"{_named(scenes, int(touched[at]))}, more than half its smallest dimension: "
                f"contact is softer the longer the step; expected a step of at most "
                f"{tick * (half / depth[at]) ** 0.5:.2g} s instead of {tick:g} s"
            )
    return [*long_steps, *starts_inside, *deep]


def _text_of(ssd: Path) -> str:
    try:
        return unescape(ssd.read_text(encoding="utf-8"))
    except OSError:
        return ""


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
    except UuvsimError:  # the file was deleted since it was compiled
        pass
    name = names[number - 1] if names else ""
    return f"obstacle {number} of the scene" + (f" ({name})" if name else "")
