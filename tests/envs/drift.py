"""A hull in a current that wanders: the smallest system with noise, and tasks in it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Channel, Mask, Moment, Task
from uuvsim_cosim.orchestrator.system.system import System

LIMIT = 8  # actions of an episode


def drifting() -> System:
    return (
        System("drifting", "0.05")
        .add("current", "model:current_gauss_markov")
        .add("hull", "model:bluerov2_heavy", start={"eta_0": (0, 0, 2, 0, 0, 0)})
        .connect("current.v_c", "hull.v_c")
    )


class Drift(Task):
    """Stay near N = E = 0; an action takes four communication steps, an episode `LIMIT`."""

    def __init__(self, *, reach: float = 1e9, force: float = 40.0, system: Any = None) -> None:
        super().__init__(
            drifting() if system is None else system,
            actions=[Channel("hull.tau[1:2]", -force, force), Channel("hull.tau[6]", -5, 5)],
            observations=[
                Channel("hull.eta[1:3]", -50, 50),
                Channel("hull.eta[6]", sin_cos=True),
                Channel("hull.nu", -5, 5),
            ],
            signals=("current.v_c", "hull.eta"),
            action_step="0.2",
            horizon=f"{0.2 * LIMIT:.1f}",
        )
        self.reach = reach

    def start(self, draws: Draws) -> Mapping[str, Array]:
        eta = np.zeros((draws.n, 6))
        eta[:, :3] = draws.uniform("place", (-1, -1, 4), (1, 1, 6), (3,))
        eta[:, 5] = draws.uniform("heading", -np.pi, np.pi)
        return {"hull.eta_0": eta}

    def reward(self, m: Moment) -> Array:
        moved = m["hull.eta"][:, :2] - m.before["hull.eta"][:, :2]
        return np.asarray(-np.hypot(*m["hull.eta"][:, :2].T) + np.hypot(*moved.T))

    def terminated(self, m: Moment) -> Mask:
        return np.asarray(np.hypot(*m["hull.eta"][:, :2].T) > self.reach)

    def extra(self, m: Moment) -> Array:
        return np.asarray(m["current.v_c"][:, :2])

    extra_limits = ((-5.0, -5.0), (5.0, 5.0))

    def info(self, m: Moment) -> Mapping[str, Array]:
        return {"depth": m["hull.eta"][:, 2]}


class Lag(Task):
    """The hand-written first-order FMU; `fault` of environment 1 of a vector, from 0.4 s on."""

    def __init__(self, fmu: Path, *, fault: int = 0, only: int | None = None) -> None:
        super().__init__(
            System("lag", "0.1").add("lag", str(fmu)),
            actions=[Channel("lag.u")],
            observations=[Channel("lag.y", -10, 10)],
            action_step="0.1",
            horizon=100,
        )
        self.fault, self.only = fault, only

    def start(self, draws: Draws) -> Mapping[str, Array]:
        fault = np.full(draws.n, self.fault)
        if self.only is not None:
            fault[draws._seeds != self.only] = 0
        return {"lag.fault": fault, "lag.fault_time": np.full(draws.n, 0.4)}

    def reward(self, m: Moment) -> Array:
        return np.asarray(m["lag.y"] + 1)
