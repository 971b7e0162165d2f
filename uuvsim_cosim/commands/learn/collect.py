"""`uuvsim collect`: a dataset from a policy that acts, or from recorded runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from uuvsim_cosim.commands.shared.completion import policies, tasks
from uuvsim_cosim.commands.shared.options import RAY, assignments, clustered, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, number, put, remark, table
from uuvsim_cosim.errors import InputInvalid

__all__ = ["collect_command"]


def collect_command(
    task: Annotated[
        str,
        typer.Argument(
            autocompletion=tasks, help="Task, such as transition_1 or uuvsim/StationKeeping-v0."
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            "-o",
            help="File NAME.npz (half precision), or new folder NAME-v0 in Minari's format.",
        ),
    ],
    policy: Annotated[
        str | None,
        typer.Option(
            "--policy",
            "-p",
            autocompletion=policies,
            help="Policy: scripted, random, mixed, a training's folder or an .npz file.",
        ),
    ] = None,
    recorded: Annotated[
        list[Path] | None,
        typer.Option(
            "--recorded",
            help="Recording to read instead of running a policy: a run's folder, .parquet or "
            ".mcap.",
        ),
    ] = None,
    signal: Annotated[
        list[str] | None,
        typer.Option(
            "--signal",
            help="NAME=RECORDED: a signal of the task and its name in the recording, if they "
            "differ.",
        ),
    ] = None,
    episodes: Annotated[
        int | None,
        typer.Option("--episodes", "-n", help="Number of episodes of the policy; default 100."),
    ] = None,
    seed: Annotated[int | None, typer.Option("--seed", help="Seed of the first episode.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace an existing .npz file.")
    ] = False,
    ray: Annotated[str | None, typer.Option("--ray", help=RAY)] = None,
    task_set: Annotated[
        list[str] | None,
        typer.Option("--task-set", help="Option of the task: NAME=VALUE, such as n_trackers=3."),
    ] = None,
) -> None:
    """Collect episodes for `uuvsim train-offline`."""
    if recorded and policy is not None:
        raise InputInvalid(f"--policy {policy} and --recorded: expected one of them")
    if signal and not recorded:
        raise InputInvalid("--signal: applies to --recorded runs", "--recorded as well")
    if ray is not None and recorded:
        raise InputInvalid(f"--ray {ray}: distributes episodes of a policy", "no --recorded")
    drawn = {"--episodes": episodes, "--seed": seed}
    given = " and ".join(f"{k} {v}" for k, v in drawn.items() if v is not None)
    if recorded and given:
        raise InputInvalid(given, "applies to episodes of a policy", "no --recorded")
    if seed is not None and seed < 0:
        raise InputInvalid(f"--seed {seed}: expected 0 or more")
    options = nested("--task-set", task_set or [], "NAME=VALUE, such as n_trackers=3")
    with StudyProgress() as progress:
        progress.say("building (once)")
        from uuvsim_cosim.learn.data.dataset_files import refuse_taken, write_dataset

        refuse_taken(out, overwrite)
        if recorded:
            from uuvsim_cosim.learn.data.recorded import from_recordings

            expected = "NAME=RECORDED, such as tracker_1.pilot.a=joystick.a"
            renamed = assignments("--signal", signal or [], expected, dotted=False)
            data = from_recordings(task, recorded, options=options, renamed=renamed)
        else:
            from uuvsim_cosim.learn.data.collect import COLLECTING_SEED, collect

            first = COLLECTING_SEED if seed is None else seed
            with clustered(ray) as cluster:
                data = collect(
                    task, policy or "scripted", 100 if episodes is None else episodes,
                    options=options, seed=first, cluster=cluster,
                )  # fmt: skip
        written = write_dataset(data, out, overwrite=overwrite)
    returns = data.returns
    line()
    line(f"{task}: {len(data.episodes)} episodes, {data.steps} actions")
    put("episodes", len(data.episodes))
    put("actions", data.steps)
    figures = {"return": returns.mean(), "least": returns.min(), "most": returns.max()}
    table(("figure", "value"), [(k, number(v, ".4g")) for k, v in figures.items()], key="returns")
    numbers = {"observations": (data.steps + len(data.episodes)) * len(data.observation),
               "actions": data.steps * len(data.action)}  # fmt: skip
    for what, clipped in data.told.get("clipped", {}).items():
        if clipped:
            remark(
                "warning",
                f"{clipped} of {numbers[what]} numbers in {what} clipped to their limits",
            )
    line()
    file_table([written])
