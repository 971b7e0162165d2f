"""Several agents in one system: PettingZoo's ParallelEnv over a team's task."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, final

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray
from pettingzoo import ParallelEnv

from uuvsim_cosim.envs.episodes.environment import Environment
from uuvsim_cosim.envs.episodes.multi_agent import TeamMoment, TeamSimulation
from uuvsim_cosim.envs.pictures.screen import Screen
from uuvsim_cosim.envs.plants.choice import Backend
from uuvsim_cosim.envs.task.checks import base_seed, start_of
from uuvsim_cosim.envs.task.task import TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names

__all__ = ["CosimParallelEnv"]

Observation = NDArray[np.float32]


@final
class CosimParallelEnv(
    Environment[TeamSimulation],
    ParallelEnv[str, Observation, NDArray[np.generic]],  # type: ignore[misc]
):
    """Environment of several agents, with the interface of PettingZoo's `ParallelEnv`.

    All agents of a `team_task` act at the same time, each on its own vehicle. The attribute
    `agents` lists the agents that act next. An agent may appear later. An agent that has ended does
    not come back before the next reset, and the episode is over when no agent is present. The
    horizon truncates all agents. A component's failure terminates all of them, with a message in
    `info["failure"]`. Arrays have the shapes of `CosimEnv`, one for each agent; `backend` and
    `render_mode` are those of `CosimEnv`. Raises InputInvalid and SystemInvalid for a task that
    does not fit its system.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import CosimParallelEnv
    >>> from uuvsim_cosim.envs.tasks import TargetTracking
    >>> env = CosimParallelEnv(TargetTracking(n_trackers=2))
    >>> observations, infos = env.reset(seed=0)
    >>> env.action_space("tracker_1").shape, env.observation_space("tracker_1").shape
    ((2,), (31,))
    >>> actions = {agent: np.array([1.0, 0.0]) for agent in env.agents}  # full acceleration
    >>> observations, rewards, terminated, truncated, infos = env.step(actions)
    >>> env.time, env.state().shape  # s; the state is for a central critic
    (0.4, (14,))
    >>> env.close()
    """

    metadata: dict[str, object] = {  # noqa: RUF012  (PettingZoo's own attribute)
        "name": "uuvsim_team",
        "render_modes": ["rgb_array", "human"],
        "is_parallelizable": True,
    }

    def __init__(
        self, team_task: TeamTask, render_mode: str | None = None, backend: Backend = "auto"
    ) -> None:
        self._screen = Screen(render_mode)
        self._simulation = simulation = TeamSimulation(
            team_task, 1, backend=backend, drawn=render_mode is not None
        )
        self.task = team_task
        self._place = simulation.place
        self.render_mode = render_mode
        self.backend = backend
        self.metadata = {
            **self.metadata,
            "name": type(team_task).__name__,
            "render_fps": float(1 / team_task.action_step),
        }
        self.possible_agents = list(simulation.agents)
        self.agents: list[str] = []
        self.observation_spaces: dict[str, gymnasium.spaces.Box] = dict(simulation.spaces)
        self.action_spaces: dict[str, gymnasium.spaces.Box] = {
            agent: gymnasium.spaces.Box(-1.0, 1.0, (box.width,), np.float32)
            for agent, box in simulation.boxes.items()
        }
        self.state_space = simulation.state_space

    def observation_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of observations of an `agent`, the same object each time."""
        return self.observation_spaces[self._known(agent)]

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        """Return the space of actions of an `agent`, the same object each time."""
        return self.action_spaces[self._known(agent)]

    def reset(
        self, seed: int | None = None, options: Mapping[str, object] | None = None
    ) -> tuple[dict[str, Observation], dict[str, dict[str, Any]]]:
        """Begin an episode; return the first observations and infos by agent.

        With a `seed`, it is episode 0 of this seed; without, the next episode of the same seed.
        `options` may be `{"start": {…}}`: start values by name, for this episode. Raises
        ComponentFailed if the episode cannot start.
        """
        simulation = self._live()
        start = start_of(options, mask="a vector in autoreset mode 'Disabled'", others=True)
        seeds = None
        if seed is not None or not simulation.episodes.seeded:
            seeds = [base_seed(seed) if seed is not None else int(seeding.np_random()[1])]
        self.agents = []
        team = simulation.reset(seeds=seeds, start=start)
        self.agents = self._those(team.present)
        result = self._observations(team), self._infos(team)
        self._screen.changed(self.render)
        return result

    def step(
        self, actions: Mapping[str, NDArray[np.generic]]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, dict[str, Any]],
    ]:
        """Act for one action step; return five mappings by agent, as PettingZoo defines them.

        `actions` has an action for each of `agents`. The results are observations, rewards,
        terminated, truncated and infos. Raises InputInvalid for a missing or an absent agent.
        """
        simulation = self._live()
        place = self._place
        if not isinstance(actions, Mapping):
            raise InputInvalid(place, f"actions {actions!r}", "an action by agent")
        if not self.agents:
            raise InputInvalid(place, "no agent is present", "reset() before step()")
        for agent in actions:
            if self._known(agent) not in self.agents:
                read = f"an action for {agent!r}, which has ended or is not present yet"
                raise InputInvalid(place, read, f"actions for {', '.join(self.agents)}")
        missing = [repr(a) for a in self.agents if a not in actions]
        if missing:
            expected = f"one for each of {', '.join(self.agents)}"
            raise InputInvalid(place, f"no action for {', '.join(missing)}", expected)
        idle = {a: np.zeros((1, box.width)) for a, box in simulation.boxes.items()}
        team = simulation.act({**idle, **{a: np.asarray(actions[a])[None] for a in self.agents}})
        self.agents = self._those(team.present)
        seen = self._numbered(team.seen)
        result = (
            self._observations(team),
            {a: float(team.reward[0, j]) for j, a in seen},
            {a: bool(team.terminated[0, j]) for j, a in seen},
            {a: bool(team.truncated[0, j]) for j, a in seen},
            self._infos(team),
        )
        self._screen.changed(self.render)
        return result

    def state(self) -> NDArray[np.float32]:
        """Return the state for a central critic, a float32 array of shape (width,)."""
        return np.asarray(self._live().state()[0])

    @property
    def time(self) -> float:
        """The time since the reset [s]."""
        return float(self._live().episodes.moment.time[0])

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the present state; return pixels (height, width, 3), or None with a window.

        Example:

        >>> from uuvsim_cosim.envs import CosimParallelEnv
        >>> from uuvsim_cosim.envs.tasks import TargetTracking
        >>> env = CosimParallelEnv(TargetTracking(), render_mode="rgb_array")
        >>> _ = env.reset(seed=0)
        >>> env.render().shape
        (480, 640, 3)
        """
        return self._screen.frame(self.task, self._live().now.moment, 0)

    def __getstate__(self) -> dict[str, object]:
        """Return the state of a copy that continues with the next episode."""
        return self._state(
            made=(self.task, self.render_mode, self.backend),
            spaces=(self.action_spaces, self.observation_spaces),
        )

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make a new environment; the next call must be reset()."""
        CosimParallelEnv.__init__(self, *state["made"])
        self.action_spaces, self.observation_spaces = state["spaces"]
        self._continue(state)

    # ---- inside ---------------------------------------------------------------------------

    def _numbered(self, mask: NDArray[np.bool_]) -> list[tuple[int, str]]:
        return [(j, a) for j, a in enumerate(self.possible_agents) if mask[0, j]]

    def _those(self, mask: NDArray[np.bool_]) -> list[str]:
        return [a for _, a in self._numbered(mask)]

    def _observations(self, team: TeamMoment) -> dict[str, Observation]:
        return {a: team.observation[a][0].copy() for a in self._those(team.seen)}

    def _infos(self, team: TeamMoment) -> dict[str, dict[str, object]]:
        simulation = self._live()
        given = simulation.info(team.moment)
        infos = {a: {k: v[0].copy() for k, v in given.items()} for a in self._those(team.seen)}
        if failure := simulation.episodes.failure(0):
            for info in infos.values():
                info["failure"] = failure
        return infos

    def _known(self, agent: str) -> str:
        if agent not in self.possible_agents:
            known = expected_names(agent, self.possible_agents)
            raise InputInvalid(self._place, f"no agent {agent!r}", known)
        return agent
