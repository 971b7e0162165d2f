"""`uuvsim train`: an algorithm learns a task; checkpoints, curves, policies and a report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.commands.learn.train_seeds import seeds_of, train_seeds
from uuvsim_cosim.commands.learn.training_progress import TrainingProgress
from uuvsim_cosim.commands.shared.completion import of, tasks
from uuvsim_cosim.commands.shared.options import RAY, folder_option, nested
from uuvsim_cosim.commands.shared.terminal import file_table, line, notice, number, put, table
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.config import TrainingConfig
    from uuvsim_cosim.learn.training.train import Trained

__all__ = ["train_command"]


def train_command(
    task: Annotated[
        str | None,
        typer.Argument(
            autocompletion=tasks, help="transition_1, uuvsim/StationKeeping-v0, pkg.module:Task."
        ),
    ] = None,
    algorithm: Annotated[
        str | None,
        typer.Option(
            "--algo",
            autocompletion=of("sac", "masac", "isac", "ppo", "ippo", "mappo", "dqn", "idqn"),
            help="sac, masac, isac, ppo, ippo, mappo, dqn or idqn.",
        ),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Of environments and learner.")] = None,
    seeds: Annotated[
        str | None, typer.Option("--seeds", help="Several: how many from --seed on, or 3,7,11.")
    ] = None,
    config: Annotated[
        Path | None, typer.Option("--config", help="YAML; options here come after it.")
    ] = None,
    curriculum: Annotated[
        str | None, typer.Option("--curriculum", help="stt, or a YAML file: task after task.")
    ] = None,
    set_: Annotated[
        list[str] | None, typer.Option("--set", help="The algorithm's NAME=VALUE, as lr=1e-3.")
    ] = None,
    task_set: Annotated[
        list[str] | None, typer.Option("--task-set", help="The task's NAME=VALUE: n_trackers=3.")
    ] = None,
    profile: Annotated[
        str | None, typer.Option("--profile", help="table1: the UUVSim paper's to the letter.")
    ] = None,
    envs: Annotated[int | None, typer.Option("--envs", help="Environments side by side.")] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", help="Environment steps, of all of them together.")
    ] = None,
    evaluate_every: Annotated[
        int | None, typer.Option("--evaluate-every", help="Environment steps.")
    ] = None,
    evaluation_episodes: Annotated[
        int | None, typer.Option("--evaluation-episodes", help="Each time, on held-out seeds.")
    ] = None,
    out: Annotated[Path | None, folder_option("Folder to write, or to go on with.")] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Begin anew where another training is.")
    ] = False,
    ray: Annotated[str | None, typer.Option("--ray", help=RAY)] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
) -> None:
    """Train; what is interrupted goes on with the same command, to the same bits."""
    given = {
        "algorithm": algorithm, "seed": seed, "profile": profile, "envs": envs, "steps": steps,
        "evaluate_every": evaluate_every, "evaluation_episodes": evaluation_episodes,
    }  # fmt: skip
    changes: dict[str, Any] = {k: v for k, v in given.items() if v is not None}
    changes["settings"] = nested("--set", set_ or [], "NAME=VALUE, as lr=1e-3")
    changes["task_options"] = nested("--task-set", task_set or [], "NAME=VALUE, as n_trackers=3")
    if curriculum is not None:
        from uuvsim_cosim.commands.learn.curriculum import train_through

        unused = {"--config": config, "--seeds": seeds, "--ray": ray}
        train_through(
            curriculum, task, changes, out, restart=restart, report=not no_report, show=open_,
            refused=[k for k, v in unused.items() if v is not None],
        )  # fmt: skip
        return
    asked = _config(task, config, changes)
    if seeds is not None or ray is not None:
        from uuvsim_cosim.learn.training.train import resolved, training_folder

        several = seeds_of(seeds or "1", asked.seed)
        configs = [resolved(asked).changed(seed=s) for s in several]
        parent = () if out is None else (out,)
        folders = [training_folder(c, *parent) for c in configs]
        if out is not None and seeds is None:
            folders = [out]
        last = train_seeds(configs, folders, restart, not no_report, ray)[-1]
        if open_ and not no_report:
            typer.launch(str(last.folder / "report.html"))
        return
    with TrainingProgress() as progress:
        try:
            from uuvsim_cosim.learn.training.train import train

            done = train(asked, folder=out, restart=restart, observers=(progress,))
            report = None
            if not no_report:
                from uuvsim_cosim.commands.learn.training_judged import write_judged
                from uuvsim_cosim.view.reports.training_report import write_training_report

                progress.say("judging the best policy, and drawing it")
                write_judged(done.folder)
                report = write_training_report(done.folder)
        except KeyboardInterrupt as interrupted:
            progress.close()
            message = str(interrupted) or "interrupted; the same command goes on"
            notice(message)
            raise typer.Exit(getattr(interrupted, "status", 130)) from None
    _show(done, report)
    if open_ and report is not None:
        typer.launch(str(report))


def _config(task: str | None, file: Path | None, changes: dict[str, Any]) -> TrainingConfig:
    from uuvsim_cosim.learn.training.config import TrainingConfig, read_config

    if task is not None:
        changes["task"] = task
    if file is not None:
        return read_config(file, **changes)
    if task is None:
        raise InputInvalid("no task", "one, as in `uuvsim train transition_1`, or --config")
    return TrainingConfig(**changes)


def _show(done: Trained, report: Path | None) -> None:
    c = done.config
    line()
    line(f"{c.task}, {c.algorithm}, seed {c.seed}: {done.cpu:.1f} CPU s")
    names = [k for k in done.evaluations[0] if k not in ("stopped", "episodes")]
    chosen = [k for k in names if k not in ("r_c", "r_t", "r_a", "p_1", "p_2", "p_3")]
    rows = [[number(row.get(k, float("nan")), ".6g") for k in chosen] for row in done.evaluations]
    table(chosen, [*rows[:1], *rows[-8:]] if len(rows) > 9 else rows, key="evaluations")
    put("evaluations", done.evaluations)
    put("folder", done.folder.absolute())
    if done.note is not None:
        line()
        line(done.note)
    line()
    files = [done.folder / n for n in ("checkpoint.pt", "evaluations.csv", "episodes.csv")]
    files = [*sorted(done.folder.glob("best*.npz")), *files, *([report] if report else [])]
    file_table(f for f in files if f.exists())
