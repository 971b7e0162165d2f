"""Autoreset modes and infos of many environments, in Gymnasium's form."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from uuvsim_cosim.envs.episodes.episodes import Episodes
from uuvsim_cosim.envs.episodes.multi_agent import TeamSimulation
from uuvsim_cosim.envs.episodes.single_agent import TaskSimulation
from uuvsim_cosim.envs.task.checks import mask_of, start_of
from uuvsim_cosim.errors import InputInvalid

__all__ = ["add_failures", "autoreset_of", "final", "of", "refuse_ended", "reset_options"]

Mask = NDArray[np.bool_]


def autoreset_of(given: AutoresetMode | str) -> AutoresetMode:
    """Return an autoreset mode; raises InputInvalid."""
    try:
        return AutoresetMode(given)
    except ValueError:
        words = ", ".join(repr(m.value) for m in AutoresetMode)
        raise InputInvalid(f"autoreset_mode {given!r}", f"one of {words}") from None


def reset_options(
    options: Mapping[str, object] | None,
    mode: AutoresetMode,
    simulation: TaskSimulation | TeamSimulation,
) -> tuple[Mapping[str, object], Mask | None]:
    """Return start values and mask of the options of a reset; raises InputInvalid."""
    wants = None if mode is AutoresetMode.DISABLED else "autoreset mode 'Disabled'"
    start, mask = start_of(options, mask=wants), mask_of(options, simulation.episodes.n)
    if mask is not None and not simulation.episodes.begun:
        raise InputInvalid(simulation.place, "reset_mask before any reset", "a whole one")
    return start, mask


def refuse_ended(place: str, ended: Mask) -> None:
    """Raise InputInvalid for a step after the end of episodes, in autoreset mode DISABLED."""
    rows = ", ".join(map(str, np.flatnonzero(ended)[:8]))
    raise InputInvalid(
        f"{place}: the episodes of environments {rows} have ended; expected "
        'reset(options={"reset_mask": …}) before step()'
    )


def of(info: Mapping[str, NDArray[np.generic]], mask: Mask | None, n: int) -> dict[str, Any]:
    """Return a task's infos, of the environments of the mask."""
    infos: dict[str, Any] = {}
    for key, values in info.items():
        infos[key] = np.array(values)
        infos[f"_{key}"] = np.ones(n, bool) if mask is None else mask.copy()
    return infos


def add_failures(infos: dict[str, object], episodes: Episodes, terminated: Mask) -> None:
    """Add a message for each environment in which a component has failed."""
    failed = episodes.failed & terminated
    if failed.any():
        texts = np.full(len(failed), None, object)
        for row in np.flatnonzero(failed):
            texts[row] = episodes.failure(int(row))
        infos["failure"], infos["_failure"] = texts, failed


def final(
    infos: Mapping[str, Any],
    observations: NDArray[np.float32],
    ended: Mask,
    begun: Mapping[str, NDArray[np.generic]],
) -> dict[str, Any]:
    """Move infos of episodes that have ended to "final_info", and add "final_obs"."""
    n = len(ended)
    last = {k: v for k, v in infos.items() if not k.startswith("_")}
    result: dict[str, Any] = {}
    for key, values in last.items():
        mine = infos[f"_{key}"] & ~ended
        if key in begun:
            shaped = ended.reshape(n, *(1,) * (np.ndim(values) - 1))
            result[key] = np.where(shaped, begun[key], values)
            result[f"_{key}"] = np.ones(n, bool)
        elif mine.any():
            result[key], result[f"_{key}"] = values, mine
    kept = np.full(n, None, object)
    for row in np.flatnonzero(ended):
        kept[row] = observations[row].copy()
    result["final_obs"], result["_final_obs"] = kept, ended.copy()
    inner = {}
    for key, values in last.items():
        inner[key], inner[f"_{key}"] = values, infos[f"_{key}"] & ended
    result["final_info"], result["_final_info"] = inner, ended.copy()
    return result
