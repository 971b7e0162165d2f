"""A system becomes an environment: Gymnasium, PettingZoo, and tasks over arrays.

Importing this registers the tasks that ship with Gymnasium.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from uuvsim_cosim.envs.channel import Channel
from uuvsim_cosim.envs.draws import Draws
from uuvsim_cosim.envs.registration import register, register_shipped
from uuvsim_cosim.envs.symmetry import Symmetry
from uuvsim_cosim.envs.task import Moment, Randomised, Task, TeamTask

if TYPE_CHECKING:
    from uuvsim_cosim.envs.function_task import FunctionTask
    from uuvsim_cosim.envs.randomisation_sets import published
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.solo import Solo
    from uuvsim_cosim.envs.team import CosimParallelEnv
    from uuvsim_cosim.envs.team_vector import CosimTeamVectorEnv
    from uuvsim_cosim.envs.vector import CosimVectorEnv

__all__ = [
    "Channel",
    "CosimEnv",
    "CosimParallelEnv",
    "CosimTeamVectorEnv",
    "CosimVectorEnv",
    "Draws",
    "FunctionTask",
    "Moment",
    "Randomised",
    "Solo",
    "Symmetry",
    "Task",
    "TeamTask",
    "published",
    "register",
]

_HOME = {
    "CosimEnv": "single",
    "CosimParallelEnv": "team",
    "CosimTeamVectorEnv": "team_vector",
    "CosimVectorEnv": "vector",
    "FunctionTask": "function_task",
    "Solo": "solo",
    "published": "randomisation_sets",
}


def __getattr__(name: str) -> Any:
    """Import a public name on first use."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    value = getattr(import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


register_shipped()
