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
    """Task of one agent whose reward, start and end are functions, over n environments.

    `system` is a system, the name of one that ships, or a file (.ssd, .ssp, .fmu). `actions` and
    `observations` are channels, or only their names. `reward`, `terminated` and `info` are
    functions of a moment `m`, `start` is a function of draws; `Task` has methods of these names and
    describes their results. The other arguments are also those of `Task`: `action_step` and
    `horizon` in seconds, `signals`, `randomisation`, `failure_reward`. Raises InputInvalid for an
    argument of the wrong type, and for a system that cannot be loaded. To test the functions, call
    them with arrays of your own.

    Example:

    >>> import numpy as np
    >>> from uuvsim_cosim.envs import Channel, CosimEnv, Draws, FunctionTask
    >>> task = FunctionTask(
    ...     "bluerov2_task",
    ...     actions=[Channel("allocation.tau_d[3]", -100, 100, "N")],
    ...     observations=["hull.eta[3]"],  # the depth [m]
    ...     reward=lambda m: -np.abs(m["hull.eta"][:, 2] - 12.0),  # reach a depth of 12 m
    ...     terminated=lambda m: m["hull.eta"][:, 2] > 15.0,
    ...     info=lambda m: {"north": m["hull.eta"][:, 0]},
    ...     start=lambda draws: {"current.speed": draws.uniform("current", 0.0, 0.3)},  # m/s
    ...     action_step="0.1",
    ...     horizon=20,
    ... )
    >>> CosimEnv(task).reset(seed=0)
    (array([10.], dtype=float32), {'north': np.float64(0.0)})
    >>> m = {"hull.eta": np.array([[0, 0, 12.0, 0, 0, 0], [2.0, 0, 16.0, 0, 0, 0]])}
    >>> task.reward(m), task.terminated(m), task.info(m)["north"]  # of two environments
    (array([-0., -4.]), array([False,  True]), array([0., 2.]))
    >>> task.start(Draws(seeds=[0, 1], episodes=[0, 0]))["current.speed"].round(2)
    array([0.23, 0.16])
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
        """Return start values: those of the randomisation, then those of the function `start`.

        They are arrays by variable, of shape (n, *shape), for the n episodes of `draws`. Raises
        InputInvalid if the function does not return a mapping.
        """
        drawn = super().start(draws)
        if self._start is None:
            return drawn
        own = self._start(draws)
        if not isinstance(own, Mapping):
            raise InputInvalid("start()", f"{own!r}", "start values by name")
        return {**drawn, **own}

    def reward(self, m: Moment) -> Array:
        """Return the result of the function `reward`, of shape (n,)."""
        return self._reward(m)

    def terminated(self, m: Moment) -> Mask:
        """Return the result of the function `terminated`, of shape (n,); False without it."""
        return np.zeros(m.n, bool) if self._terminated is None else self._terminated(m)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the result of the function `info`, arrays of shape (n, …); none without it."""
        return {} if self._info is None else self._info(m)


def _named(channels: Any) -> Any:
    """Make channels of names; `Task` refuses a value that is not a list."""
    if not isinstance(channels, Sequence) or isinstance(channels, str):
        return channels
    return [Channel(c) if isinstance(c, str) else c for c in channels]
