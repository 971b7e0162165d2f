"""Path of a mission: waypoints for a system's guidance, and the time that the path takes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.fmus.description import Description, Variable
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["duration", "has_path", "path_of", "with_waypoints"]

PER_WAYPOINT = 12.0  # s, for slowing down and turning the bow
AT_THE_END = 45.0  # s, for holding station
OTHERWISE = 60.0  # s, for a system without a path


def with_waypoints(system: System, waypoints: NDArray[np.float64]) -> System:
    """Return the system with these waypoints (n, 3) in its guidance.

    The guidance is the component that has a parameter ``waypoints`` with three columns. Spare rows
    repeat the last waypoint; its parameter ``count``, if any, is the number of waypoints.
    """
    found = _guidances(system)
    if len(found) != 1:
        raise InputInvalid(
            system.name,
            f"{len(found)} components have a parameter 'waypoints'",
            "one, to give --waypoints to",
        )
    name, description, variable = found[0]
    rows = variable.shape[0]
    if len(waypoints) > rows:
        raise InputInvalid(
            f"{len(waypoints)} waypoints were read",
            f"at most {rows}, which is what {name}.waypoints holds",
        )
    spare = np.repeat(waypoints[-1:], rows - len(waypoints), axis=0)
    system = system.set(f"{name}.waypoints", np.vstack([waypoints, spare]).tolist())
    if "count" in description.variables:
        system = system.set(f"{name}.count", len(waypoints))
    return system


def has_path(system: System) -> bool:
    """Return whether a guidance of the system follows waypoints."""
    return bool(_guidances(system))


def _guidances(system: System) -> list[tuple[str, Description, Variable]]:
    return [
        (name, description, variable)
        for name, description in system.checked.descriptions.items()
        if (variable := _table(description)) is not None
    ]


def path_of(plan: Plan) -> NDArray[np.float64] | None:
    """Return the waypoints (n, 3) of the plan's guidance; None if it has none."""
    for component in plan.components:
        variable = _table(component.description)
        if variable is None:
            continue
        value = _start(component.start, component.description, "waypoints")
        if value is None:
            continue
        rows = np.asarray(value, dtype=float).reshape(variable.shape)
        count = _start(component.start, component.description, "count")
        return rows if count is None else rows[: int(np.asarray(count).item())]
    return None


def duration(plan: Plan) -> float:
    """Return the default duration of a run [s], a multiple of 10 s.

    Along a path: its length, from the surface above its first waypoint, at the guidance's
    speed, 12 s for each waypoint, and 45 s of station-keeping; otherwise 60 s.
    """
    path = path_of(plan)
    if path is None:
        return OTHERWISE
    legs = np.diff(path, axis=0)
    length = float(np.sum(np.linalg.norm(legs, axis=1))) + abs(float(path[0, 2]))
    speed = next(
        (
            _start(c.start, c.description, "speed")
            for c in plan.components
            if _table(c.description) is not None
        ),
        None,
    )
    metres_per_second = float(np.asarray(speed).item()) if speed is not None else 0.5
    seconds = length / max(metres_per_second, 1e-3) + PER_WAYPOINT * len(path) + AT_THE_END
    return 10.0 * math.ceil(seconds / 10.0)


def _table(description: Description) -> Variable | None:
    """Return the parameter ``waypoints`` with three columns, if there is one."""
    variable = description.variables.get("waypoints")
    fits = variable is not None and variable.causality == "parameter" and len(variable.shape) == 2
    return variable if fits and variable is not None and variable.shape[1] == 3 else None


def _start(start: Mapping[str, object], description: Description, name: str) -> Any:
    """Return a variable's start value, by default that of its description; None: no variable."""
    if name in start:
        return start[name]
    variable = description.variables.get(name)
    return None if variable is None else variable.start
