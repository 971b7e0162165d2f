"""Gymnasium and PettingZoo environments of any system, and the tasks that ship.

Importing this registers the tasks with Gymnasium. `single.py`, `vector.py`, `team.py` and
`team_vector.py` are the four interfaces; `tasks/` holds the tasks, `plants/` what steps. It may
import `kernels`, `scene`, `orchestrator` and below. Start with `single.py`, then `task/task.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.envs.registration import register, register_shipped
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Logical, Symbols
from uuvsim_cosim.envs.task.task import Channel, Moment, Randomised, Symmetry, Task, TeamTask
from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.envs.randomisation.distributions import Uniform
    from uuvsim_cosim.envs.randomisation.privileged import with_privileged
    from uuvsim_cosim.envs.randomisation.published import current, published
    from uuvsim_cosim.envs.randomisation.randomisation import Randomisation, Vary
    from uuvsim_cosim.envs.single import CosimEnv
    from uuvsim_cosim.envs.solo import Solo
    from uuvsim_cosim.envs.task.function_task import FunctionTask
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
    "Logical",
    "Moment",
    "Randomisation",
    "Randomised",
    "Solo",
    "Symbols",
    "Symmetry",
    "Task",
    "TeamTask",
    "Uniform",
    "Vary",
    "current",
    "published",
    "register",
    "with_privileged",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "CosimEnv": "single",
        "CosimParallelEnv": "team",
        "CosimTeamVectorEnv": "team_vector",
        "CosimVectorEnv": "vector",
        "FunctionTask": "task.function_task",
        "Randomisation": "randomisation.randomisation",
        "Solo": "solo",
        "Uniform": "randomisation.distributions",
        "Vary": "randomisation.randomisation",
        "current": "randomisation.published",
        "published": "randomisation.published",
        "with_privileged": "randomisation.privileged",
    },
)

register_shipped()
