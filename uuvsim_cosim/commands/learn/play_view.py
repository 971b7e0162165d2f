"""One episode of a policy as a scene and its motion, for `uuvsim play --view`."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from viser import ViserServer

    from uuvsim_cosim.envs.pictures.drawn import View
    from uuvsim_cosim.envs.task.task import Moment, Task, TeamTask
    from uuvsim_cosim.orchestrator.plan.plan import Plan
    from uuvsim_cosim.view.recorded.traces import Array, Traces
    from uuvsim_cosim.view.scene3d.motion import Motion
    from uuvsim_cosim.view.scene3d.scene import Scene3D, Solid

__all__ = ["Page", "episode_of"]

GOAL = "goal"


class Page:
    """The page of an episode, if it was `asked` for; its port is opened at once."""

    def __init__(self, port: int | None, asked: bool) -> None:
        self._server: ViserServer | None = None
        self._recorded: tuple[Scene3D, Motion, Traces] | None = None
        if port is not None and not asked:
            raise InputInvalid(f"--port {port}: is where --view shows it", "--view")
        if asked:
            from uuvsim_cosim.view.scene3d.viser_server import open_server

            self._server = open_server(port)

    def record(self, task: Task | TeamTask, policy: Any, seed: int, name: str) -> None:
        """Play the episode, and record the motion."""
        from uuvsim_cosim.learn.shared.task_ids import short_name

        self._recorded = episode_of(task, policy, seed, short_name(name))

    def serve(self, what: str, *, show: bool) -> None:
        """Replay the recording until Ctrl-C; do nothing without a page."""
        if self._server is None or self._recorded is None:
            return
        from uuvsim_cosim.commands.run.view import serve
        from uuvsim_cosim.view.scene3d.viser_server import close_server

        try:
            serve(self._server, what, self._recorded, show=show)
        finally:
            close_server(self._server)


def episode_of(
    task: Task | TeamTask, policy: Any, seed: int, name: str
) -> tuple[Scene3D, Motion, Traces]:
    """Play episode 0 of a seed and return its motion; raises InputInvalid without a pose.

    The task is not changed: a copy of it reads the signals that move its scene as well.
    """
    from uuvsim_cosim.learn.policies.playing import frames_of
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.view.scene3d.motion import motion_of
    from uuvsim_cosim.view.scene3d.scene import Marker
    from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan

    plan = flatten(task.system)
    scene3d = scene3d_of_plan(plan, name)
    if not scene3d.bodies:
        raise InputInvalid(
            f"--view: no component of {name} has a pose (eta) that tau moves",
            "a task with a vehicle, or no --view",
        )
    watched: Any = copy.copy(task)  # its method `view` is replaced
    watched.signals = tuple(dict.fromkeys((*task.signals, *scene3d.signals)))
    seen = _Seen(task, scene3d)
    watched.view = seen.view
    for _ in frames_of(watched, policy, seed):
        pass
    if seen.goals:
        scene3d = replace(
            scene3d, markers=(*scene3d.markers, Marker(GOAL, f"{GOAL}.position", 0.08))
        )
    scene3d = replace(scene3d, solids=tuple(_solids(plan, seen.start, scene3d)))
    units = {
        f"{c.path}.{v.name}": ", ".join(dict.fromkeys(u or "1" for u in v.units))
        for c in plan.components
        for v in c.description.variables.values()
    }
    traces = seen.traces(units)
    return scene3d, motion_of(scene3d, traces), traces


class _Seen:
    """Recorder of a task's moments while their pictures are drawn."""

    def __init__(self, task: Task | TeamTask, scene3d: Scene3D) -> None:
        self._task, self._names = task, scene3d.signals
        self.time: list[float] = []
        self.rows: dict[str, list[Array]] = {name: [] for name in self._names}
        self.goals: list[Array] = []
        self.start: dict[str, Array] = {}

    def view(self, m: Moment, row: int) -> View | None:
        """Record a moment, and return the task's view of it."""
        import numpy as np

        self.time.append(float(m.time[row]))
        for name in self._names:
            self.rows[name].append(np.array(m[name][row], float))
        if not self.start:
            self.start = {key: np.array(value[row]) for key, value in m.start.items()}
        view = self._task.view(m, row)
        if view is not None and view.goals and len(view.goals[0].position) == 3:
            self.goals.append(np.array(view.goals[0].position))
        return view

    def traces(self, units: dict[str, str]) -> Traces:
        """Return the recorded signals; a moment that was drawn twice counts once."""
        import numpy as np

        from uuvsim_cosim.view.recorded.traces import Traces

        time, picks = np.unique(np.array(self.time), return_index=True)
        values = {name: np.array(rows)[picks] for name, rows in self.rows.items()}
        if len(self.goals) == len(self.time):
            values[f"{GOAL}.position"] = np.array(self.goals)[picks]
        return Traces(time, values, units)


def _solids(plan: Plan, start: dict[str, Array], scene3d: Scene3D) -> Iterator[Solid]:
    """Yield the still bodies of this episode: pools and obstacles may be random."""
    from uuvsim_cosim.view.scene3d.scene_of_plan import pool_solids

    found: dict[str, Solid] = {}
    for c in plan.components:
        if {"origin", "size", "obstacles"} & set(c.description.variables):
            names = ("origin", "size", "obstacles")
            keys = {n: f"{c.path}.{n}" for n in names if f"{c.path}.{n}" in start}
            found |= {s.name: s for s in pool_solids(c, {n: start[k] for n, k in keys.items()})}
    pools = list(found.values())
    yield from pools or scene3d.solids
