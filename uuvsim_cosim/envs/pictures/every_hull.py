"""The view of a task that has none of its own: every hull of its system, where it is."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from uuvsim_cosim.orchestrator.plan.plan import Plan

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View

__all__ = ["every_hull", "hulls"]


def hulls(plan: Plan) -> list[str]:
    """Return the paths of components that have a pose `eta` (6) and are moved by `tau` (6)."""
    found = []
    for c in plan.components:
        eta, tau = (c.description.variables.get(name) for name in ("eta", "tau"))
        if eta is not None and (eta.causality, eta.shape) == ("output", (6,)) and tau is not None:
            found.append(c.path)
    return found


def every_hull(paths: Sequence[str], moment: Any, row: int) -> View:
    """Draw the hulls at some paths, as bodies of half a metre."""
    from uuvsim_cosim.envs.pictures.picture import Vehicle, View

    vehicles = []
    for path in paths:
        eta = np.asarray(moment[f"{path}.eta"][row], float)
        vehicles.append(Vehicle(path, eta.tolist(), length=0.5, breadth=0.35))
    return View(vehicles=vehicles, time=float(moment.time[row]))
