"""A task of functions: an environment of one's own system in a few lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Channel, Mask, Moment, Randomised, Task
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["FunctionTask"]


@final
class FunctionTask(Task):
    """A task whose reward, start and end are functions of a moment, over n environments.

    `system` is a system, the name of one that ships, or a file (.ssd, .ssp, .fmu). Channels may
    be names alone. See `Task` for what the functions get and give.
    """

    def __init__(
        self,
        system: System | str | Path,
        *,
        actions: Sequence[Channel | str],
        observations: Sequence[Channel | str],
        reward: Callable[[Moment], Array],
        action_step: Fraction | str | float,
        horizon: Fraction | str | float,
        signals: Sequence[str] = (),
        terminated: Callable[[Moment], Mask] | None = None,
        start: Callable[[Draws], Mapping[str, Array]] | None = None,
        info: Callable[[Moment], Mapping[str, NDArray[np.generic]]] | None = None,
        randomisation: Randomised | None = None,
        failure_reward: float = 0.0,
    ) -> None:
        functions = {"reward": reward, "terminated": terminated, "start": start, "info": info}
        for name, function in functions.items():
            if not callable(function) and (function is not None or name == "reward"):
                raise InputInvalid(f"{name} {function!r}", "a function")
        if not isinstance(system, System):
            from uuvsim_cosim.orchestrator.running.library import load

            system = load(system)
        super().__init__(
            system,
            actions=_named(actions),
            observations=_named(observations),
            action_step=action_step,
            horizon=horizon,
            signals=signals,
            randomisation=randomisation,
        )
        self._reward, self._terminated = reward, terminated
        self._start, self._info = start, info
        self.failure_reward = failure_reward

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw an episode's start values: the randomisation's, then those of the function."""
        drawn = super().start(draws)
        if self._start is None:
            return drawn
        own = self._start(draws)
        if not isinstance(own, Mapping):
            raise InputInvalid("start()", f"{own!r}", "start values by name")
        return {**drawn, **own}

    def reward(self, m: Moment) -> Array:
        """Return the function's reward."""
        return self._reward(m)

    def terminated(self, m: Moment) -> Mask:
        """Return the function's ends, if there is one."""
        return np.zeros(m.n, bool) if self._terminated is None else self._terminated(m)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the function's infos, if there is one."""
        return {} if self._info is None else self._info(m)


def _named(channels: Any) -> Any:
    """Make channels of names; `Task` refuses a value that is not a list."""
    if not isinstance(channels, Sequence) or isinstance(channels, str):
        return channels
    return [Channel(c) if isinstance(c, str) else c for c in channels]
