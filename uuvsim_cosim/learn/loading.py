"""Policies from files and folders, as what acts in a task."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.envs.options import near
from uuvsim_cosim.envs.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.curriculum_folder import ABOUT, last_done
from uuvsim_cosim.learn.policy import Policy
from uuvsim_cosim.learn.sequence_runner import SequenceRunner

__all__ = ["acting_in", "load_policies", "policy_path", "random_policy"]

Act = Callable[[NDArray[Any]], NDArray[np.float64]]


def policy_path(given: str | Path) -> Path:
    """Give a file or folder as it is, or the file of a policy that ships, by its name.

    A curriculum's folder stands for that of its last finished stage. Raises InputInvalid where
    there is none of these.
    """
    path = Path(given).expanduser()
    if (path / ABOUT).is_file():
        return last_done(path)
    if path.exists():
        return path
    ships = {p.stem: p for p in content("models", "policies").glob("*.npz")}
    if str(given) in ships:
        return ships[str(given)]
    raise InputInvalid(
        f"{given}: no such file or folder; expected a policy (.npz), a training's folder, or one "
        f"that ships: {near(str(given), ships)}"
    )


def load_policies(path: str | Path, which: str = "best") -> list[Policy]:
    """Read the policies of a training's folder, or a file and those of the same team beside it.

    A curriculum's folder gives those of its last finished stage. `which` is "best" or "policy", the
    last; a folder with one kind only gives that. One that ships may be given by its name,
    "target_masac".
    """
    path = policy_path(path)
    if not path.is_dir():
        first = Policy.load(path)
        stem = path.stem.removesuffix(f"-{first.agent}")
        if not first.agent or stem == path.stem:
            return [first]
        found = sorted(path.parent.glob(f"{stem}-*.npz"))
    else:
        found = []
        for kind in (which, "best", "policy"):
            found = found or sorted({*path.glob(f"{kind}.npz"), *path.glob(f"{kind}-*.npz")})
        if not found:
            raise InputInvalid(f"{path}: holds no policy; expected best.npz, or a policy (.npz)")
    return [Policy.load(file) for file in found]


def acting_in(task: Task | TeamTask, policies: Sequence[Policy], name: str) -> Any:
    """Give policies as `evaluate` takes them; raises InputInvalid if they see or do other things.

    Agents that no policy is named after take the policies in turn: a team of two can be three.
    """
    from uuvsim_cosim.learn.train import agents_of, widths

    observed, acted = widths(task)
    for p in policies:
        if (len(p.observation), len(p.action)) != (observed, acted):
            raise InputInvalid(
                f"policy of {p.task}: observes {len(p.observation)} numbers and acts on "
                f"{len(p.action)}; expected {observed} and {acted}, for {name} (target tracking "
                "has an option slots)"
            )
    if not isinstance(task, TeamTask):
        return _act(policies[0])
    named = {p.agent: p for p in policies}
    return {
        agent: _act(named.get(agent, policies[i % len(policies)]))
        for i, agent in enumerate(agents_of(task))
    }


def random_policy(task: Task | TeamTask, seed: int | Sequence[int] = 0) -> Mapping[str, Act] | Act:
    """Give what acts at random, uniformly."""
    from uuvsim_cosim.learn.train import agents_of, widths

    _, acted = widths(task)
    random = np.random.default_rng(seed)

    def act(observation: NDArray[Any]) -> NDArray[np.float64]:
        return random.uniform(-1.0, 1.0, (len(observation), acted))

    return dict.fromkeys(agents_of(task), act) if isinstance(task, TeamTask) else act


def _act(policy: Policy) -> Act:
    return SequenceRunner(policy) if policy.kind == "sequence" else policy
