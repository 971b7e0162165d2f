"""A small system of several vehicles, each a nested system, and a task in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Channel, TeamTask
from uuvsim_cosim.orchestrator.system.system import System


def vehicle() -> System:
    """One thruster that pushes a hull forwards, and a compass with noise."""
    return (
        System("vehicle", "0.1")
        .add("thruster", "model:thruster_t200")
        .add("hull", "model:bluerov2_heavy")
        .add("compass", "model:compass")
        .connect("thruster.thrust", "hull.tau[1]")
        .connect("hull.eta", "compass.eta")
        .expose("u", "thruster.u")
        .expose("eta", "hull.eta")
    )


def vehicles(n: int) -> System:
    system = System("vehicles", "0.1", "Several vehicles beside each other")
    for i in range(1, n + 1):
        system = system.add(f"rov_{i}", vehicle())
    return system


class Advance(TeamTask):
    """Come forward; `late` says after how many seconds each agent comes."""

    def __init__(
        self,
        n: int = 2,
        *,
        system: System | None = None,
        late: Sequence[float] = (),
        leaves: Mapping[str, float] | None = None,
        wall: float = np.inf,
        agents: int | None = None,
        horizon: str = "3",
        action_step: str = "0.3",
    ) -> None:
        names = [f"rov_{i}" for i in range(1, (agents or n) + 1)]
        self.late = dict(zip(names, [*late, *[0.0] * len(names)], strict=False))
        self.leaves, self.wall = dict(leaves or {}), wall
        super().__init__(
            vehicles(n) if system is None else system,
            agents=names,
            actions={a: [Channel(f"{a}.thruster.u", -1, 1)] for a in names},
            action_step=action_step,
            horizon=horizon,
            signals=[f"{a}.{s}" for a in names for s in ("hull.eta", "hull.nu", "compass.psi")],
        )

    def start(self, draws: Draws) -> Mapping[str, Any]:
        poses = {}
        for i, a in enumerate(self.agents):
            pose = np.zeros((draws.n, 6))
            pose[:, 0] = draws.uniform(f"{a}/north", -0.5, 0.5)
            pose[:, 1], pose[:, 2] = i, 1.0
            poses[f"{a}.hull.eta_0"] = pose
        return poses

    def limits(self, agent: str) -> tuple[Any, Any]:
        return -np.full(4, 10.0), np.full(4, 10.0)

    def observe(self, m: Any) -> dict[str, Any]:
        north = {a: m[f"{a}.hull.eta"][:, 0] for a in self.agents}
        own = {a: (m[f"{a}.hull.nu"][:, 0], m[f"{a}.compass.psi"]) for a in self.agents}
        team = sum(north.values())
        return {a: np.stack([north[a], *own[a], team], axis=1) for a in self.agents}

    def reward(self, m: Any) -> dict[str, Any]:
        return {a: m[f"{a}.hull.nu"][:, 0] - 0.01 * m.action[a][:, 0] ** 2 for a in self.agents}

    def terminated(self, m: Any) -> dict[str, Any]:
        return {a: m[f"{a}.hull.eta"][:, 0] > self.wall for a in self.agents}

    def present(self, m: Any) -> dict[str, Any]:
        leaves = {a: self.leaves.get(a, np.inf) for a in self.agents}
        return {a: (m.time >= self.late[a]) & (m.time < leaves[a]) for a in self.agents}

    def state(self, m: Any) -> Any:
        return np.concatenate([m[f"{a}.hull.eta"] for a in self.agents], axis=1)

    def state_limits(self) -> tuple[Any, Any]:
        return -np.full(6 * len(self.agents), 10.0), np.full(6 * len(self.agents), 10.0)

    def info(self, m: Any) -> dict[str, Any]:
        return {"time": m.time}
