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

__all__ = ["acting_in", "load_policies", "policies_by_agent", "policy_path", "random_policy"]

MARKS = ("-", ".")  # between a file's stem and its agent: of trainings, of kept results


def policy_path(given: str | Path) -> Path:
    """Return a file or folder unchanged, or the file of a shipped policy by its name.

    For the folder of a curriculum, return that of its last finished stage. Raises InputInvalid if
    `given` is none of these.
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
    """Read the policies of an agent or a team from a file or a folder.

    `path` is one of these:

    - the folder of a training; the folder of a curriculum gives the policies of its last finished
      stage;
    - a file `*.npz`. The file of an agent of a team is named after the agent, "best-tracker_1.npz"
      in the folder of a training, "stt-masac-0.tracker_1.npz" among the results of `uuvsim
      reproduce`; then the files of the other agents in the same folder are read, too;
    - the name of a shipped policy, "target_masac".

    `which` is "best" (the policy of the best evaluation) or "policy" (the last policy). If a folder
    has only one of them, that one is read. Raises InputInvalid for a path without a policy.

    Example:

    >>> from uuvsim_cosim.learn import load_policies
    >>> (policy,) = load_policies("source_sac")
    >>> policy.task, len(policy.observation), len(policy.action)
    ('source', 31, 2)
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
    """Return policies in the form that `evaluate` expects: one function, or one for each agent.

    Each function maps observations (n, width) to actions (n, width) in [-1, 1]. `task` is the task
    in which they act, and `name` its name, for messages. An agent of a team acts by the policy that
    is named after it. A policy without an agent's name is that of every agent. If `policies` are
    those of a whole team, further agents use them in turn, so that policies of a team of two can
    act in a team of three. Raises InputInvalid if the widths of observations or actions differ from
    those of the task, and if the policy of an agent is missing.

    Example:

    >>> from uuvsim_cosim.envs.tasks import evaluate
    >>> from uuvsim_cosim.learn import acting_in, load_policies, make_task
    >>> task = make_task("source")
    >>> act = acting_in(task, load_policies("source_sac"), "source")
    >>> evaluate(task, act, episodes=4).returns.shape
    (4,)
    """
    acts = {agent: _act(p) for agent, p in policies_by_agent(task, policies, name).items()}
    return acts if isinstance(task, TeamTask) else acts["agent"]


def policies_by_agent(
    task: Task | TeamTask, policies: Sequence[Policy], name: str
) -> dict[str, Policy]:
    """Return the policy of each agent, as `acting_in` assigns them, with its errors.

    A task of one agent names it "agent".
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
        return {"agent": policies[0]}
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
    return {agent: named.get(agent, policies[i % len(policies)]) for i, agent in enumerate(agents)}


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
