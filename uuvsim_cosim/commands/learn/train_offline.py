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
    dataset: Annotated[
        Path, typer.Argument(help="Dataset: a folder in Minari's format, or an .npz file.")
    ],
    algorithm: Annotated[
        str,
        typer.Option(
            "--algo", autocompletion=of("bc", "iql", "dt"), help="Algorithm: bc, iql or dt."
        ),
    ] = "dt",
    seed: Annotated[int, typer.Option("--seed", help="Seed of networks and random draws.")] = 0,
    task: Annotated[
        str | None,
        typer.Option(
            "--task",
            autocompletion=tasks,
            help="Task, if the dataset names none, or another task with the same spaces.",
        ),
    ] = None,
    task_set: Annotated[
        list[str] | None,
        typer.Option("--task-set", help="Option of the task: NAME=VALUE, such as n_trackers=3."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Setting of the algorithm: NAME=VALUE, such as context=10."),
    ] = None,
    episodes: Annotated[
        int,
        typer.Option("--episodes", help="Number of episodes of the evaluation; 0: no evaluation."),
    ] = 100,
    out: Annotated[Path | None, folder_option("New folder to write.")] = None,
) -> None:
    """Learn from a dataset alone: behaviour cloning, implicit Q-learning, decision transformer."""
    if seed < 0 or not 0 <= episodes <= 100_000:
        raise InputInvalid(f"--seed {seed}, --episodes {episodes}: expected 0 or more, and 0 … "
                           "100000")  # fmt: skip
    settings = nested("--set", set_ or [], "NAME=VALUE, such as context=10")
    options = nested("--task-set", task_set or [], "NAME=VALUE, such as n_trackers=3")
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
        line("interrupted; the policy learned so far is kept")
    rows = [(k, number(v, ".4g")) for k, v in learned.losses.items()]
    rows += [("return of the dataset", number(learned.data.returns.mean(), ".4g"))]
    table(("figure", "value"), rows + [(k, shown(v)) for k, v in figures.items()],
          key="figures")  # fmt: skip
    line()
    files = sorted(f for f in learned.folder.iterdir() if f.is_file())
    file_table(files)
    if learned.interrupted:
        raise typer.Exit(130)
