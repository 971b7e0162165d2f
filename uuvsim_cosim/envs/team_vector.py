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
from uuvsim_cosim.envs.episodes.environment import Environment
from uuvsim_cosim.envs.episodes.multi_agent import TeamMoment, TeamSimulation
from uuvsim_cosim.envs.plants.choice import Backend, DType
from uuvsim_cosim.envs.task.checks import base_seed, whole
from uuvsim_cosim.envs.task.task import Array, Mask, TeamTask
from uuvsim_cosim.errors import InputInvalid

__all__ = ["CosimTeamVectorEnv"]

Step = tuple[NDArray[np.float32], Array, Mask, Mask, dict[str, Any]]


@final
class CosimTeamVectorEnv(Environment[TeamSimulation]):
    """Vector of n = `num_envs` environments of N agents each, as arrays for a learner.

    Each runs a `team_task` in a copy of its system. Environment i of seed s has the same bits as
    `CosimParallelEnv` of seed s + i. Observations have the shape (n, N, width), actions
    (n, N, width), rewards, terminated and truncated (n, N). The numbers of an absent agent are
    zero, and its actions are ignored. `infos["acted"]` marks the agents whose action led here.

    An episode is over when no agent is present. Then its environment is reset according to
    `autoreset_mode`, one of Gymnasium's modes as in `CosimVectorEnv`. With "SameStep", infos have
    "final_obs" (n, N, width), "final_state" and the mask "_final_obs" (n,). `backend`, `threads`,
    `dtype` and `processes` are those of `CosimVectorEnv`. Raises InputInvalid for agents whose
    spaces differ.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import CosimTeamVectorEnv
    >>> from uuvsim_cosim.envs.tasks import TargetTracking
    >>> envs = CosimTeamVectorEnv(TargetTracking(n_trackers=2), num_envs=16)
    >>> observations, infos = envs.reset(seed=0)
    >>> observations, rewards, terminated, truncated, infos = envs.step(np.zeros((16, 2, 2)))
    >>> observations.shape, rewards.shape, envs.state().shape
    ((16, 2, 31), (16, 2), (16, 14))
    >>> envs.present.all()  # no agent has ended
    np.True_
    >>> envs.close()
    """

    _closed = ("the environments are closed", "new ones")

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
        num_envs = whole(num_envs, "num_envs")
        self._mode = vector_info.autoreset_of(autoreset_mode)
        simulation = TeamSimulation(
            team_task, num_envs, backend=backend, threads=threads, dtype=dtype,
            processes=processes,
        )  # fmt: skip
        self._simulation = simulation
        _refuse_mixed(simulation)
        self.task = team_task
        self.num_envs = num_envs
        self.agents = simulation.agents
        self.metadata: dict[str, object] = {
            "name": type(team_task).__name__,
            "render_modes": [],
            "autoreset_mode": self._mode,
        }
        first = self.agents[0]
        self.single_observation_space = simulation.spaces[first]
        shape = (len(self.agents), simulation.boxes[first].width)
        self.single_action_space = gymnasium.spaces.Box(-1.0, 1.0, shape[1:], np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (num_envs, *shape), np.float32)
        self.single_state_space = simulation.state_space
        self._ended = np.zeros(num_envs, bool)

    @property
    def present(self) -> NDArray[np.bool_]:
        """The mask of the agents that act next, Booleans of shape (n, N)."""
        return self._live().now.present.copy()

    def state(self) -> NDArray[np.float32]:
        """Return the states for a central critic, of shape (n, width of the state)."""
        return self._live().state()

    def reset(
        self,
        *,
        seed: int | Sequence[int] | None = None,
        options: Mapping[str, object] | None = None,
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin episodes; return the first observations and infos.

        `seed` and `options` are those of `CosimVectorEnv.reset`. Raises ComponentFailed if no
        environment can start.
        """
        simulation = self._live()
        start, mask = vector_info.reset_options(options, self._mode, simulation)
        team = simulation.reset(mask, seeds=self._seeds(seed), start=start)
        self._ended = np.zeros(self.num_envs, bool) if mask is None else self._ended & ~mask
        return _observations(simulation, team), self._infos(simulation, team)

    def step(self, actions: Array) -> Step:
        """Act in all environments for one action step; `actions` are (n, N, width) in [-1, 1].

        Returns observations, rewards, terminated, truncated and infos. Raises InputInvalid for
        other shapes and for NaN.
        """
        simulation, ended = self._live(), self._ended
        if self._mode is AutoresetMode.DISABLED and ended.any():
            vector_info.refuse_ended(simulation.place, ended)
        given = self._by_agent(simulation, actions)
        team = simulation.act({a: given[:, j] for j, a in enumerate(self.agents)})
        if ended.any():
            team = simulation.reset(ended)
        over = team.over
        observations, infos = _observations(simulation, team), self._infos(simulation, team)
        if simulation.episodes.failed.any():
            vector_info.add_failures(infos, simulation.episodes, over)
        step = team.reward.copy(), team.terminated.copy(), team.truncated.copy()
        if self._mode is AutoresetMode.SAME_STEP and over.any():
            infos["final_obs"], infos["_final_obs"] = observations, over
            infos["final_state"] = simulation.state()
            acted = infos["acted"]
            team = simulation.reset(over)
            observations = _observations(simulation, team)
            infos |= {**self._infos(simulation, team), "acted": acted}
            over = np.zeros(self.num_envs, bool)
        self._ended = over
        return observations, *step, infos

    # ---- inside ---------------------------------------------------------------------------

    def _by_agent(self, simulation: TeamSimulation, actions: object) -> Array:
        given = np.asarray(actions)
        if given.shape != self.action_space.shape or given.dtype.kind not in "fiu":
            raise InputInvalid(
                simulation.place,
                f"actions of type {given.dtype} and shape {given.shape}",
                f"numbers of shape {self.action_space.shape}: environments, agents, widths",
            )
        acting = simulation.now.present & ~self._ended[:, None]
        return np.where(acting[:, :, None], given, 0.0)

    def _infos(self, simulation: TeamSimulation, team: TeamMoment) -> dict[str, Any]:
        infos = vector_info.of(simulation.info(team.moment), None, self.num_envs)
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


def _observations(simulation: TeamSimulation, team: TeamMoment) -> NDArray[np.float32]:
    """Return observations (n, N, d): zeros for agents that did not act and are not present."""
    every = np.stack([team.observation[a] for a in simulation.agents], axis=1)
    return np.where(team.seen[:, :, None], every, np.float32(0))


def _refuse_mixed(simulation: TeamSimulation) -> None:
    first = simulation.agents[0]
    for agent in simulation.agents:
        pairs = (
            ("observations", simulation.spaces[agent].shape, simulation.spaces[first].shape),
            ("actions", (simulation.boxes[agent].width,), (simulation.boxes[first].width,)),
        )
        for what, own, other in pairs:
            if own != other:
                simulation.episodes.close()
                raise InputInvalid(
                    simulation.place,
                    f"{what} of {agent!r} have shape {own}, those of {first!r} {other}",
                    "equal shapes (CosimParallelEnv takes unequal ones)",
                )
        if simulation.spaces[agent] != simulation.spaces[first]:
            simulation.episodes.close()
            raise InputInvalid(
                simulation.place,
                f"observation limits of {agent!r} differ from those of {first!r}",
                "equal limits (CosimParallelEnv takes unequal ones)",
            )
