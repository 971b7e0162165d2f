"""Small sound environments, which the tests of the conformance suite break in one way each."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from pettingzoo import ParallelEnv

LIMIT = 20


class Sound(gymnasium.Env):
    """A point that is pushed, and seen with noise; 20 actions of 0.3 s, or until it leaves."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(self, fails_at: int | None = None) -> None:
        self.observation_space = Box(-1, 1, (2,), np.float32)
        self.action_space = Box(-1, 1, (1,), np.float32)
        self.fails_at = fails_at
        self.x, self.k = 0.0, 0

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.x, self.k = float(self.rng().uniform(-0.3, 0.3)), 0
        self.x = (options or {}).get("x", self.x)
        return self.seen(), self.info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.k += 1
        failed = self.k == self.fails_at
        if not failed:
            self.x += 0.05 * float(action[0])
        return self.seen(), -abs(self.x), *self.ends(failed), self.info(failed)

    def ends(self, failed: bool) -> tuple[bool, bool]:
        over = failed or abs(self.x) > 0.9
        return over, self.k >= LIMIT and not over

    def rng(self) -> np.random.Generator:
        return self.np_random

    def seen(self) -> Any:
        noise = self.rng().normal(0, 0.01)
        return np.clip([self.x + noise, self.k / LIMIT], -1, 1).astype(np.float32)

    def info(self, failed: bool = False) -> dict[str, Any]:
        return {"time": self.k * 3 / 10} | ({"failure": "the pump stands"} if failed else {})


class Pair(ParallelEnv):
    """Two such points; the second comes after five steps, and one that leaves is gone."""

    metadata: ClassVar[dict[str, Any]] = {"name": "pair", "render_modes": []}

    def __init__(self, point: Any = Sound) -> None:
        self.possible_agents = ["one", "two"]
        self.agents: list[str] = []
        self.render_mode = None
        self.points = {a: point() for a in self.possible_agents}
        self.k = 0

    def observation_space(self, agent: str) -> Any:
        return self.points[agent].observation_space

    def action_space(self, agent: str) -> Any:
        return self.points[agent].action_space

    def reset(self, seed: Any = None, options: Any = None) -> Any:
        if seed is not None and (not isinstance(seed, int) or seed < 0):
            raise ValueError(f"seed {seed!r}")
        self.agents, self.k = ["one"], 0
        for i, agent in enumerate(self.possible_agents):
            own = None if seed is None else seed + 100 * i
            first = self.points[agent].reset(seed=own, options=options)
            if agent == "one":
                observation, info = first
        return {"one": observation}, {"one": info}

    def step(self, actions: Any) -> Any:
        self.k += 1
        given = {a: self.points[a].step(actions[a]) for a in self.agents}
        if self.k == 5:
            given["two"] = self.points["two"].step(np.zeros(1, np.float32))
        if self.k == LIMIT:
            given = {a: (g[0], g[1], g[2], not g[2], g[4]) for a, g in given.items()}
        self.agents = [a for a, g in given.items() if not (g[2] or g[3])]
        parts: Any = [{a: g[i] for a, g in given.items()} for i in range(5)]
        parts[4] = {a: {"time": self.k * 3 / 10} for a in given}
        return tuple(parts)

    def state(self) -> Any:
        return np.array([p.x for p in self.points.values()], np.float32)

    def close(self) -> None:
        pass


def many(n: int) -> SyncVectorEnv:
    return SyncVectorEnv([Sound] * n, autoreset_mode=AutoresetMode.NEXT_STEP)
