"""Environments of a team's task as arrays (environments, agents, numbers), for learners."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from uuvsim_cosim.envs import vector_info
from uuvsim_cosim.envs.episodes.multi_agent import TeamMoment, TeamStage
from uuvsim_cosim.envs.plants.choice import Backend, DType
from uuvsim_cosim.envs.task.checks import base_seed, mask_of, start_of, whole
from uuvsim_cosim.envs.task.task import TeamTask
from uuvsim_cosim.errors import InputInvalid

__all__ = ["CosimTeamVectorEnv"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Step = tuple[NDArray[np.float32], Array, Mask, Mask, dict[str, Any]]


@final
class CosimTeamVectorEnv:
    """A team's task in n = `num_envs` copies of its system, each with N agents.

    Row i of seed s is CosimParallelEnv of s + i. Observations are (n, N, d), actions (n, N, a),
    rewards, terminated and truncated (n, N), `state()` (n, s). The mask `present` (n, N) marks the
    agents that act next, infos["acted"] those whose action led here. The numbers of an absent
    agent are zero, and its actions are ignored. An episode is over when no agent is present; then
    the row is reset according to Gymnasium's autoreset mode, with infos "final_obs" (n, N, d),
    "final_state" and "_final_obs" (n,) in SAME_STEP. Raises InputInvalid for agents whose spaces
    differ.
    """

    def __init__(
        self,
        team_task: TeamTask,
        num_envs: int,
        *,
        backend: Backend = "auto",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int = 1,
        dtype: DType = "float64",
        processes: int | None = None,
    ) -> None:
        self._stage: TeamStage | None = None
        num_envs = whole(num_envs, "num_envs")
        self._mode = vector_info.autoreset_of(autoreset_mode)
        stage = TeamStage(
            team_task, num_envs, backend=backend, threads=threads, dtype=dtype,
            processes=processes,
        )  # fmt: skip
        self._stage = stage
        _refuse_mixed(stage)
        self.task = team_task
        self.num_envs = num_envs
        self.agents = stage.agents
        self.metadata: dict[str, object] = {
            "name": type(team_task).__name__,
            "render_modes": [],
            "autoreset_mode": self._mode,
        }
        first = self.agents[0]
        self.single_observation_space = stage.spaces[first]
        shape = (len(self.agents), stage.boxes[first].width)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, shape[1:], np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (num_envs, *shape), np.float32)
        self.single_state_space = stage.state_space
        self._ended = np.zeros(num_envs, bool)

    @property
    def present(self) -> NDArray[np.bool_]:
        """The mask of the agents that act next, of shape (n, N)."""
        return self._live().now.present.copy()

    def state(self) -> NDArray[np.float32]:
        """Return the states for a central critic, of shape (n, s)."""
        return self._live().state()

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: Mapping[str, object] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin episode 0 of seeds s, s + 1, …, or without any the next of the same seeds."""
        stage = self._live()
        wants = None if self._mode is AutoresetMode.DISABLED else "autoreset mode 'Disabled'"
        start, mask = start_of(options, mask=wants), mask_of(options, self.num_envs)
        if mask is not None and not stage.episodes.begun:
            raise InputInvalid(stage.place, "reset_mask before any reset", "a whole one")
        team = stage.reset(mask, seeds=self._seeds(seed), start=start)
        self._ended = np.zeros(self.num_envs, bool) if mask is None else self._ended & ~mask
        return _observations(stage, team), self._infos(stage, team)

    def step(self, actions: Array) -> Step:
        """Act in all environments for one action step; `actions` are (n, N, a) in [-1, 1]."""
        stage, ended = self._live(), self._ended
        if self._mode is AutoresetMode.DISABLED and ended.any():
            vector_info.refuse_ended(stage.place, ended)
        given = self._by_agent(stage, actions)
        team = stage.act({a: given[:, j] for j, a in enumerate(self.agents)})
        if ended.any():
            team = stage.reset(ended)
        over = team.over
        observations, infos = _observations(stage, team), self._infos(stage, team)
        if stage.episodes.failed.any():
            vector_info.add_failures(infos, stage.episodes, over)
        step = team.reward.copy(), team.terminated.copy(), team.truncated.copy()
        if self._mode is AutoresetMode.SAME_STEP and over.any():
            infos["final_obs"], infos["_final_obs"] = observations, over
            infos["final_state"] = stage.state()
            acted = infos["acted"]
            team = stage.reset(over)
            observations = _observations(stage, team)
            infos |= {**self._infos(stage, team), "acted": acted}
            over = np.zeros(self.num_envs, bool)
        self._ended = over
        return observations, *step, infos

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        stage, self._stage = self._stage, None
        if stage is not None:
            stage.episodes.close()

    def __del__(self) -> None:
        """Free everything."""
        if getattr(self, "_stage", None) is not None:
            self.close()

    # ---- inside ---------------------------------------------------------------------------

    def _live(self) -> TeamStage:
        if self._stage is None:
            raise InputInvalid("the environments are closed", "new ones")
        return self._stage

    def _by_agent(self, stage: TeamStage, actions: object) -> Array:
        given = np.asarray(actions)
        if given.shape != self.action_space.shape or given.dtype.kind not in "fiu":
            raise InputInvalid(
                stage.place,
                f"actions of type {given.dtype} and shape {given.shape}",
                f"numbers of shape {self.action_space.shape}: environments, agents, widths",
            )
        acting = stage.now.present & ~self._ended[:, None]
        return np.where(acting[:, :, None], given, 0.0)

    def _infos(self, stage: TeamStage, team: TeamMoment) -> dict[str, Any]:
        infos = vector_info.of(stage.info(team.moment), None, self.num_envs)
        return {**infos, "present": team.present.copy(), "acted": team.acted.copy()}

    def _seeds(self, seed: int | Sequence[int] | None) -> list[int] | None:
        if seed is None:
            if self._live().episodes.seeded:
                return None
            seed = int(seeding.np_random()[1]) % 2**63
        if isinstance(seed, Sequence) and not isinstance(seed, str):
            if len(seed) != self.num_envs:
                raise InputInvalid("seed", f"{len(seed)} numbers", f"one, or {self.num_envs}")
            return [base_seed(s) for s in seed]
        first = base_seed(seed, self.num_envs)
        return [first + i for i in range(self.num_envs)]


def _observations(stage: TeamStage, team: TeamMoment) -> NDArray[np.float32]:
    """Return observations (n, N, d): zeros for agents that did not act and are not present."""
    every = np.stack([team.observation[a] for a in stage.agents], axis=1)
    return np.where(team.seen[:, :, None], every, np.float32(0))


def _refuse_mixed(stage: TeamStage) -> None:
    first = stage.agents[0]
    for agent in stage.agents:
        pairs = (
            ("observations", stage.spaces[agent].shape, stage.spaces[first].shape),
            ("actions", (stage.boxes[agent].width,), (stage.boxes[first].width,)),
        )
        for what, own, other in pairs:
            if own != other:
                stage.episodes.close()
                raise InputInvalid(
                    stage.place,
                    f"{what} of {agent!r} have shape {own}, those of {first!r} {other}",
                    "equal shapes (CosimParallelEnv takes unequal ones)",
                )
        if stage.spaces[agent] != stage.spaces[first]:
            stage.episodes.close()
            raise InputInvalid(
                stage.place,
                f"observation limits of {agent!r} differ from those of {first!r}",
                "equal limits (CosimParallelEnv takes unequal ones)",
            )
