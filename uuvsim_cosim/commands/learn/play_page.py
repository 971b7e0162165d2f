"""An episode of a trained policy on a page that computes it in the browser."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.commands.learn.policies import Acting
    from uuvsim_cosim.learn.policies.policy import Policy

__all__ = ["write_play_page"]


def write_play_page(found: Acting, given: str, seed: int, out: Path, played: float) -> float:
    """Write the page and return the return of the episode that it computes.

    `given` is the policy as the command line names it, and `played` its return in an environment.
    Raises InputInvalid for policies and tasks that cannot be declared as a component.
    """
    from uuvsim_cosim.kernels import fuse
    from uuvsim_cosim.learn.deployment.task_system import task_system
    from uuvsim_cosim.learn.shared.task_ids import short_name
    from uuvsim_cosim.view.live_page.live_page import write_live_page

    task = found.task
    system = task_system(
        task, _policies(found.policies[given], given), seed, short_name(found.name)
    )
    kernel = fuse(system, lanes=1)
    steps = int(task.horizon / kernel.fused.plan.tick) + 1  # the task shows its end a step later
    with kernel.batch(1, seeds=0) as batch:
        batch.step(steps)
        computed = float(batch.get("task.return")[0])
    remark = (
        f"The component task is the task {found.name} with its policy, in the episode of seed "
        f"{seed}, which ends after at most {float(task.horizon):g} s. The page evaluates the "
        f"network in float64, uuvsim play in float32: the return of the episode is {computed:.9g} "
        f"here and {played:.9g} there."
    )
    shown = ["task.return", *(f"task.{v}" for v in _actions(system))]
    write_live_page(system, out, plots=shown, remark=remark, ended="task.ended")
    return computed


def _policies(acts: Any, given: str) -> dict[str, Policy]:
    """Return the policies by agent; raises InputInvalid for functions that are none."""
    from uuvsim_cosim.learn.policies.policy import Policy, SequenceRunner

    by_agent = acts if isinstance(acts, Mapping) else {"agent": acts}
    found = {a: p.policy if isinstance(p, SequenceRunner) else p for a, p in by_agent.items()}
    if not all(isinstance(p, Policy) for p in found.values()):
        raise InputInvalid(
            f"--live with --policy {given}",
            "a function in Python, which does not run in a browser",
            "a trained policy: a training's folder, or a file .npz",
        )
    return found


def _actions(system: Any) -> list[str]:
    variables = system.describe("task").variables
    return [name for name in variables if name == "action" or name.endswith("_action")]
