"""Warnings about vehicles outside of the terrain of a scene, where sensors get no echo."""

from __future__ import annotations

import re
from collections.abc import Mapping
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import UuvsimError
from uuvsim_cosim.models.worlds.ground import scene_named
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["left_terrain"]

Array = NDArray[np.float64]


def left_terrain(ssd: Path, time: Array, signals: Mapping[str, Array]) -> list[str]:
    """Return a warning for each hull of a run that left a scene; `ssd` names the scenes.

    A hull is a signal `hull.eta` (T, 6), below any path; `time` is (T,) [s].
    """
    try:
        text = unescape(ssd.read_text(encoding="utf-8"))
    except OSError:
        return []
    named = re.findall(r"[?&]scene=([^&\"'\s<]+)", text)
    scenes = [s for s in dict.fromkeys(unquote(n) for n in named) if s != "flat"]
    hulls = [n for n in signals if n == "hull.eta" or n.endswith(".hull.eta")]
    return [
        warning
        for scene in scenes
        for hull in hulls
        if (warning := _apart(scene, hull.removesuffix(".eta"), time, signals[hull]))
    ]


def _apart(scene: str, hull: str, time: Array, eta: Array) -> str:
    """Return the warning on a hull that left a scene; empty if it did not."""
    try:
        terrain = scene_named(scene).terrain
    except UuvsimError:  # gone since it was compiled
        return ""
    if terrain is None or not len(time):
        return ""
    z = Caster(terrain).height(eta[:, 0], eta[:, 1])
    unknown = np.isnan(z)
    under = eta[:, 2] > z
    if not (unknown | under).any():
        return ""
    if not unknown.any():
        share, first = float(np.mean(under)), float(time[np.argmax(under)])
        return (
            f"{hull} was below the seabed of scene {scene} for {100 * share:.0f} % of the time, "
            f"first at t = {first:g} s: sensors hear nothing there"
        )
    low = np.array(terrain.origin)
    high = low + terrain.spacing * (np.array(terrain.z.shape) - 1)
    share, first = float(np.mean(unknown)), float(time[np.argmax(unknown)])
    beside = np.any((eta[:, :2] < low) | (eta[:, :2] > high))
    where = "left the terrain" if beside else "was over a hole in the terrain"
    return (
        f"{hull} {where} of scene {scene} (N {low[0]:.0f} to {high[0]:.0f} m, E {low[1]:.0f} to "
        f"{high[1]:.0f} m) for {100 * share:.0f} % of the time, first at t = {first:g} s: sensors "
        "hear nothing there, and there is no bed to touch"
    )
