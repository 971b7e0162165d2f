"""Learning: algorithms, trainings, curricula, datasets, and export of policies as components.

It may import `envs`, `bridge`, `kernels`, `scene`, `orchestrator` and below; torch comes with the
extra `rl` and is imported where it is used. Start with `training/train.py`, then
`algorithms/ppo.py` and `policies/policy.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.learn.data.collect import collect
    from uuvsim_cosim.learn.offline.offline import train_offline
    from uuvsim_cosim.learn.paper.anticipation import Anticipating
    from uuvsim_cosim.learn.policies.policy import Policy
    from uuvsim_cosim.learn.shared.task_ids import make_task
    from uuvsim_cosim.learn.training.curriculum import CURRICULA, Curriculum, Promotion, Stage
    from uuvsim_cosim.learn.training.loading import acting_in, load_policies
    from uuvsim_cosim.learn.training.train import train
    from uuvsim_cosim.learn.training.train_curriculum import train_curriculum

__all__ = [
    "CURRICULA",
    "Anticipating",
    "Curriculum",
    "Policy",
    "Promotion",
    "Stage",
    "acting_in",
    "collect",
    "load_policies",
    "make_task",
    "train",
    "train_curriculum",
    "train_offline",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Anticipating": "paper.anticipation",
        "CURRICULA": "training.curriculum",
        "Curriculum": "training.curriculum",
        "Policy": "policies.policy",
        "Promotion": "training.curriculum",
        "Stage": "training.curriculum",
        "acting_in": "training.loading",
        "collect": "data.collect",
        "load_policies": "training.loading",
        "make_task": "shared.task_ids",
        "train": "training.train",
        "train_curriculum": "training.train_curriculum",
        "train_offline": "offline.offline",
    },
)
