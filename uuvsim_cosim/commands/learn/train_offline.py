"""`uuvsim train-offline`: train a policy on a dataset, and evaluate it in the task."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.learn.evaluate import SEED, shown
from uuvsim_cosim.commands.shared.completion import of, tasks
from uuvsim_cosim.commands.shared.options import folder_option, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, number, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["train_offline_command"]


def train_offline_command(
    dataset: Annotated[Path, typer.Argument(help="A folder of Minari's, or .npz.")],
    algorithm: Annotated[
        str, typer.Option("--algo", autocompletion=of("bc", "iql", "dt"), help="bc, iql or dt.")
    ] = "dt",
    seed: Annotated[int, typer.Option("--seed", help="Of networks and draws.")] = 0,
    task: Annotated[
        str | None,
        typer.Option(
            "--task", autocompletion=tasks, help="Where the dataset tells none, or of like spaces."
        ),
    ] = None,
    task_set: Annotated[
        list[str] | None, typer.Option("--task-set", help="The task's NAME=VALUE: n_trackers=3.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="The algorithm's NAME=VALUE, as context=10.")
    ] = None,
    episodes: Annotated[
        int, typer.Option("--episodes", help="To evaluate what was learned on; 0: none.")
    ] = 100,
    out: Annotated[Path | None, folder_option("A new folder.")] = None,
) -> None:
    """Learn from a dataset alone: behaviour cloning, implicit Q-learning, decision transformer."""
    if seed < 0 or not 0 <= episodes <= 100_000:
        raise InputInvalid(f"--seed {seed}, --episodes {episodes}: expected 0 or more, and 0 … "
                           "100000")  # fmt: skip
    settings = nested("--set", set_ or [], "NAME=VALUE, as context=10")
    options = nested("--task-set", task_set or [], "NAME=VALUE, as n_trackers=3")
    with StudyProgress() as progress:
        progress.say("reading")
        from uuvsim_cosim.envs.tasks.evaluation import evaluate
        from uuvsim_cosim.learn.offline.offline import train_offline
        from uuvsim_cosim.learn.shared.task_ids import make_task
        from uuvsim_cosim.learn.training.judging import judged
        from uuvsim_cosim.learn.training.loading import acting_in

        def report(done: int, of: int, losses: Mapping[str, float]) -> None:
            progress("updates", done, of)

        learned = train_offline(
            dataset, algorithm, seed=seed, settings=settings, task=task, options=options,
            folder=out, progress=report,
        )  # fmt: skip
        figures = {}
        policy = learned.policy
        if episodes and not learned.interrupted:
            progress.say("evaluating")
            made = make_task(policy.task, policy.options)
            acts = acting_in(made, [policy], policy.task)
            figures = judged([evaluate(made, acts, episodes, seed=SEED)])
    line()
    line(f"{policy.task}, {algorithm}, seed {seed}: {learned.updates} updates, "
         f"{learned.cpu:.1f} CPU s")  # fmt: skip
    if learned.interrupted:
        line("interrupted; what had been learned is kept")
    rows = [(k, number(v, ".4g")) for k, v in learned.losses.items()]
    rows += [("return of the dataset", number(learned.data.returns.mean(), ".4g"))]
    table(("figure", "value"), rows + [(k, shown(v)) for k, v in figures.items()],
          key="figures")  # fmt: skip
    line()
    files = sorted(f for f in learned.folder.iterdir() if f.is_file())
    file_table(files)
    if learned.interrupted:
        raise typer.Exit(130)
