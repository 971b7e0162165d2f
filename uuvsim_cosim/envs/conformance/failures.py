"""Failures and fixed starts of this package's own environments, for the claims about them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from uuvsim_cosim.envs.conformance.subject import Environment, Make
from uuvsim_cosim.envs.task.episode_draws import Draws

if TYPE_CHECKING:
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.team import CosimParallelEnv

__all__ = ["Fails", "failing_of", "start_of"]


class Fails:
    """Raises in the first communication step that begins at or after `at`."""

    inputs: ClassVar[Mapping[str, str]] = {}
    outputs: ClassVar[Mapping[str, str]] = {"y": "1"}
    parameters: ClassVar[Mapping[str, tuple[float, str]]] = {"at": (0.0, "s")}
    at: float

    def step(self, t: float, dt: float, u: Mapping[str, float]) -> dict[str, float]:
        """Do nothing, until it is time."""
        if t >= self.at:
            raise RuntimeError("fails on purpose")
        return {"y": 0.0}


def failing_of(env: Environment) -> Make | None:
    """Return a function that makes an environment of the same task whose second action fails."""
    kind = _own(env)
    if kind is None:
        return None
    task = copy.copy(env.unwrapped.task)
    task.system = task.system.add(
        "conformance_failure",
        f"{__name__}:{Fails.__name__}",
        {"at": float(task.action_step - task.system.base_step / 2)},
    )
    return lambda: kind(task, backend="master")


def start_of(env: Environment, seed: int) -> dict[str, object] | None:
    """Return the options of a reset that always gives the start of a seed's first episode."""
    if _own(env) is None:
        return None
    drawn = env.unwrapped.task.start(Draws([seed], [0]))
    return {"start": {name: rows[0] for name, rows in drawn.items()}}


def _own(env: Environment) -> type[CosimEnv | CosimParallelEnv] | None:
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.team import CosimParallelEnv

    kind = type(env.unwrapped)
    return kind if kind in (CosimEnv, CosimParallelEnv) else None
