"""Loading of policies from files and folders, to act in a task."""

from __future__ import annotations

from collections.abc import Sequence
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.content import content
from uuvsim_cosim.envs.task.task import Task, TeamTask
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.policies.policy import Policy, SequenceRunner
from uuvsim_cosim.learn.shared.task_ids import TASKS, make_task
from uuvsim_cosim.learn.training.agents import agents_of, widths
from uuvsim_cosim.learn.training.folders import CURRICULUM, last_done
from uuvsim_cosim.models.declaration.near_names import expected_names

if TYPE_CHECKING:
    from uuvsim_cosim.envs.tasks import scripted
    from uuvsim_cosim.envs.tasks.scripted import Policies

__all__ = ["acting_in", "load_policies", "policy_path", "random_policy"]

MARKS = ("-", ".")  # between a file's stem and its agent: of trainings, of kept results


def policy_path(given: str | Path) -> Path:
    """Return a file or folder as it is, or the file of a policy that ships, by its name.

    A curriculum's folder stands for that of its last finished stage. Raises InputInvalid where
    there is none of these.
    """
    path = Path(given).expanduser()
    if (path / CURRICULUM).is_file():
        return last_done(path)
    if path.exists():
        return path
    ships = {p.stem: p for p in content("models", "policies").glob("*.npz")}
    if str(given) in ships:
        return ships[str(given)]
    raise InputInvalid(
        given,
        "no such file or folder",
        "a policy (.npz), a training's folder, or "
        f"{expected_names(given, ships, 'one that ships')}",
    )


def load_policies(path: str | Path, which: str = "best") -> list[Policy]:
    """Read the policies of a training's folder, or a file and those of the same team beside it.

    A file of a team is named after its agent, "best-tracker_1.npz" in a training's folder and
    "stt-masac-0.tracker_1.npz" among the results of `uuvsim reproduce`. A curriculum's folder gives
    the policies of its last finished stage. `which` is "best" or "policy", the last; a folder with
    one kind only gives that. A policy that ships may be given by its name, "target_masac".
    """
    path = policy_path(path)
    if not path.is_dir():
        policy = Policy.load(path)
        for mark in MARKS if policy.agent else ():  # named after its agent: its team is beside it
            stem = path.stem.removesuffix(f"{mark}{policy.agent}")
            if stem != path.stem:
                return _team(path.parent, f"{stem}{mark}")
        return [policy]
    for kind in (which, "best", "policy"):
        alone = path / f"{kind}.npz"
        found = [Policy.load(alone)] if alone.is_file() else []
        found += _team(path, f"{kind}-")
        if found:
            return found
    raise InputInvalid(path, "holds no policy", "best.npz, or a policy (.npz)")


def acting_in(task: Task | TeamTask, policies: Sequence[Policy], name: str) -> Policies:
    """Return policies as `evaluate` takes them; raises InputInvalid if they see or do other things.

    An agent acts by the policy that is named after it. Only if the policies are those of a whole
    team, agents beyond that team take them in turn: a team of two can be three. A policy without
    an agent's name is every agent's.
    """
    observed, acted = widths(task)
    for p in policies:
        if (len(p.observation), len(p.action)) != (observed, acted):
            raise InputInvalid(
                f"policy of {p.task}",
                f"observes {len(p.observation)} numbers and acts on {len(p.action)}",
                f"{observed} and {acted}, for {name} (target tracking has an option slots)",
            )
    named = {p.agent: p for p in policies}
    if len(named) < len(policies) or ("" in named and len(named) > 1):
        read = ", ".join(p.agent or "every agent" for p in policies)
        raise InputInvalid(f"policies of {read}", "one of each agent, or one for all")
    if not isinstance(task, TeamTask):
        if len(policies) > 1:
            raise InputInvalid(f"policies of {', '.join(named)}", f"one, for {name}")
        return _act(policies[0])
    agents = agents_of(task)
    lacking = [agent for agent in agents if agent not in named]
    if lacking and "" not in named:  # fine only if they are of the whole team that learned
        first, team = policies[0], lacking
        if first.task == name or first.task in TASKS:  # do not import foreign code for a message
            team = list(agents_of(make_task(first.task, first.options)))
        missing = [agent for agent in team if agent not in named]
        if missing:
            raise InputInvalid(
                f"policies of {', '.join(p.agent for p in policies)} alone, none of "
                f"{', '.join(missing)}",
                f"a file of each agent beside the others, as best-{missing[0]}.npz",
            )
    return {
        agent: _act(named.get(agent, policies[i % len(policies)])) for i, agent in enumerate(agents)
    }


def random_policy(task: Task | TeamTask, seed: int | Sequence[int] = 0) -> Policies:
    """Return policies of uniform random actions."""
    _, acted = widths(task)
    random = np.random.default_rng(seed)

    def act(observation: NDArray[np.generic]) -> NDArray[np.float64]:
        return random.uniform(-1.0, 1.0, (len(observation), acted))

    return dict.fromkeys(agents_of(task), act) if isinstance(task, TeamTask) else act


def _act(policy: Policy) -> scripted.Policy:
    return SequenceRunner(policy) if policy.kind == "sequence" else policy


def _team(folder: Path, begins: str) -> list[Policy]:
    """Read the files of a team: those whose names are `begins` and the agent's name."""
    found = [(file, Policy.load(file)) for file in sorted(folder.glob(f"{escape(begins)}*.npz"))]
    return [p for file, p in found if p.agent and file.stem == f"{begins}{p.agent}"]
