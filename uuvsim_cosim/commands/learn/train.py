"""`uuvsim train`: an algorithm learns a task; checkpoints, curves, policies and a report."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.cache import write_whole
from uuvsim_cosim.commands.learn.training_progress import TrainingProgress
from uuvsim_cosim.commands.shared.completion import of, tasks
from uuvsim_cosim.commands.shared.options import RAY, clustered, folder_option, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.system_options import Force
from uuvsim_cosim.commands.shared.terminal import (
    file_line,
    file_table,
    line,
    notice,
    number,
    put,
    remark,
    table,
    tilde,
)
from uuvsim_cosim.commands.shared.termination import Termination
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.training_seeds import EVALUATION_SEED

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.config import TrainingConfig
    from uuvsim_cosim.learn.training.statistics import Interval
    from uuvsim_cosim.learn.training.train import Trained
    from uuvsim_cosim.learn.training.train_curriculum import StageTrained
    from uuvsim_cosim.learn.training.training import Progress

__all__ = ["seeds_of", "train_command", "train_seeds", "train_through", "write_judged"]


def train_command(
    task: Annotated[
        str | None,
        typer.Argument(
            autocompletion=tasks,
            help="Task, such as transition_1, uuvsim/StationKeeping-v0 or pkg.module:Task.",
        ),
    ] = None,
    algorithm: Annotated[
        str | None,
        typer.Option(
            "--algo",
            autocompletion=of("sac", "masac", "isac", "ppo", "ippo", "mappo", "dqn", "idqn"),
            help="Algorithm: sac, masac, isac, ppo, ippo, mappo, dqn or idqn.",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--seed", help="Seed of environments and learner.")
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            "--seeds",
            help="Train with several seeds: their number, counted from --seed, or a list such as "
            "3,7,11.",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(
            "--config", help="Training file (YAML); options of the command line override it."
        ),
    ] = None,
    curriculum: Annotated[
        str | None,
        typer.Option("--curriculum", help="Curriculum (a sequence of tasks): stt, or a YAML file."),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option("--set", help="Setting of the algorithm: NAME=VALUE, such as lr=1e-3."),
    ] = None,
    task_set: Annotated[
        list[str] | None,
        typer.Option("--task-set", help="Option of the task: NAME=VALUE, such as n_trackers=3."),
    ] = None,
    force: Force = False,
    profile: Annotated[
        str | None,
        typer.Option(
            "--profile", help="Set of settings; table1: exactly those of the UUVSim paper."
        ),
    ] = None,
    envs: Annotated[
        int | None, typer.Option("--envs", help="Number of parallel environments.")
    ] = None,
    steps: Annotated[
        int | None, typer.Option("--steps", help="Number of steps, summed over all environments.")
    ] = None,
    evaluate_every: Annotated[
        int | None,
        typer.Option(
            "--evaluate-every", help="Number of environment steps between two evaluations."
        ),
    ] = None,
    evaluation_episodes: Annotated[
        int | None,
        typer.Option(
            "--evaluation-episodes", help="Number of episodes per evaluation, on held-out seeds."
        ),
    ] = None,
    out: Annotated[Path | None, folder_option("Folder to write, or to continue.")] = None,
    restart: Annotated[
        bool, typer.Option("--restart", help="Start again in a folder that holds another training.")
    ] = False,
    ray: Annotated[str | None, typer.Option("--ray", help=RAY)] = None,
    no_report: Annotated[bool, typer.Option("--no-report", help="Write no report.html.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the report in a browser.")] = False,
) -> None:
    """Train a policy; an interrupted training continues with the same command, bit for bit."""
    given = {
        "algorithm": algorithm, "seed": seed, "profile": profile, "envs": envs, "steps": steps,
        "evaluate_every": evaluate_every, "evaluation_episodes": evaluation_episodes,
    }  # fmt: skip
    changes: dict[str, Any] = {k: v for k, v in given.items() if v is not None}
    changes["settings"] = nested("--set", set_ or [], "NAME=VALUE, such as lr=1e-3")
    changes["task_options"] = nested(
        "--task-set", task_set or [], "NAME=VALUE, such as n_trackers=3"
    )
    if force:
        changes["task_options"]["mismatches"] = "warn"
    if curriculum is not None:
        unused = {"--force": force or None, "--config": config, "--seeds": seeds, "--ray": ray}
        train_through(
            curriculum, task, changes, out, restart=restart, report=not no_report, show=open_,
            refused=[k for k, v in unused.items() if v is not None],
        )  # fmt: skip
        return
    from uuvsim_cosim.learn.training.config import TrainingConfig, read_config

    if task is not None:
        changes["task"] = task
    elif config is None:
        raise InputInvalid("no task", "a task, as in `uuvsim train transition_1`, or --config")
    asked = TrainingConfig(**changes) if config is None else read_config(config, **changes)
    if force:
        _warn_of_mismatches(asked)
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
                from uuvsim_cosim.view.reports.training_report import write_training_report

                progress.say("evaluating and drawing the best policy")
                write_judged(done.folder)
                report = write_training_report(done.folder)
        except KeyboardInterrupt as interrupted:
            progress.close()
            notice(str(interrupted) or "interrupted; repeat the command to continue")
            raise typer.Exit(getattr(interrupted, "status", 130)) from None
    _show(done, report)
    if open_ and report is not None:
        typer.launch(str(report))


def _warn_of_mismatches(config: TrainingConfig) -> None:
    from uuvsim_cosim.learn.shared.task_ids import make_task
    from uuvsim_cosim.orchestrator.plan.flatten import flatten

    task = make_task(config.task, config.task_options, profile=config.profile)
    drawn = getattr(task.randomisation, "remarks", ())
    for text in (*flatten(task.system).warnings, *drawn):
        remark("warning", text)


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


MOST = 10_000


def seeds_of(text: str, first: int = 0) -> list[int]:
    """Read ``5``, a number of seeds from `first`, or a list ``3,7,11``; raises InputInvalid."""
    wrong = InputInvalid(
        f"--seeds {text}: expected a number of seeds, 1 … {MOST}, or distinct seeds such as 3,7,11"
    )
    try:
        read = [int(part) for part in text.split(",") if part.strip()]
    except ValueError:
        raise wrong from None
    if "," not in text and read:
        if not 1 <= read[0] <= MOST:
            raise wrong
        return list(range(first, first + read[0]))
    if not read or len(set(read)) != len(read) or len(read) > MOST:
        raise wrong
    return read


def train_seeds(
    configs: Sequence[TrainingConfig], folders: Sequence[Path], restart: bool, report: bool,
    ray: str | None,
) -> list[Trained]:  # fmt: skip
    """Train each in its folder; write a report of each, and a table of all."""
    from uuvsim_cosim.learn.training.ray_training import ALIKE, train_on
    from uuvsim_cosim.learn.training.train import train
    from uuvsim_cosim.view.reports.training_report import write_training_report

    done: list[Trained] = []
    with Termination() as termination, StudyProgress("steps") as bar:
        try:
            bar.say("building (once)")
            with clustered(ray, alike=ALIKE) as cluster:
                if cluster is not None:
                    done = train_on(cluster, configs, folders, restart=restart, progress=bar)
            for config, folder in zip(configs, folders, strict=True) if ray is None else ():
                before, total = sum(d.config.steps for d in done), sum(c.steps for c in configs)

                def show(progress: Progress, before: int = before, total: int = total) -> None:
                    bar("training", before + progress.step, total)

                done.append(train(config, folder=folder, restart=restart, observers=(show,)))
            for k, each in enumerate(done if report else ()):
                bar.say(
                    f"evaluating and drawing the best policy of training {k + 1} of {len(done)}"
                )
                write_judged(each.folder)
                write_training_report(each.folder)
        except KeyboardInterrupt as interrupted:
            bar.close()
            notice(str(interrupted) or "interrupted; repeat the command to continue")
            status = max(termination.status, getattr(interrupted, "status", 130))
            raise typer.Exit(status) from None
    _show_seeds(done)
    return done


def _show_seeds(done: Sequence[Trained]) -> None:
    line()
    first = done[0].config
    line(f"{first.task}, {first.algorithm}: {len(done)} trainings")
    names = [k for k in ("track", "clean", "success") if k in done[0].evaluations[-1]]
    rows = []
    for each in done:
        best = max(each.evaluations, key=lambda row: row["return"])
        rows.append(
            (each.config.seed, number(each.cpu, ".1f"), number(best["step"], ".0f"),
             number(best["return"], ".4g"),
             *(number(best[k], ".4g") for k in names), tilde(each.folder))
        )  # fmt: skip
    table(("seed", "CPU s", "best at step", "return", *names, "written"), rows, key="trainings")
    for each in done:
        if each.note is not None:
            line(f"seed {each.config.seed}: {each.note}")


SHOWN = ("return", "track", "dist", "viol", "clean")


def train_through(
    name: str,
    task: str | None,
    changes: Mapping[str, Any],
    out: Path | None,
    *,
    restart: bool,
    report: bool,
    show: bool,
    refused: Sequence[str],
) -> None:
    """Train through a curriculum with the options of `uuvsim train`.

    `changes` are fields of TrainingConfig that override the curriculum's. `refused` are given
    options that a curriculum does not have. `task` must be the last task of the curriculum.
    """
    if refused:
        raise InputInvalid(refused[0], "applies to one training", "--curriculum without it")
    from uuvsim_cosim.learn.training.curriculum import curriculum_of
    from uuvsim_cosim.learn.training.interruption import Interruption
    from uuvsim_cosim.learn.training.train_curriculum import train_curriculum

    curriculum = curriculum_of(name)
    last = curriculum.stages[-1].task
    if task not in (None, "target-tracking", last):
        raise InputInvalid(
            f"task {task!r}", f"curriculum {curriculum.name} ends with {last}", "that task, or none"
        )
    given = {k: v for k, v in changes.items() if v not in (None, {})}
    seed = given.pop("seed", 0)
    if not 0 <= seed < EVALUATION_SEED:
        raise InputInvalid(f"--seed {seed}: expected 0 … {EVALUATION_SEED - 1}")
    options = dict(given.pop("task_options", {}))
    if given.get("profile"):
        options["profile"] = given.pop("profile")
    if "steps" in given:
        raise InputInvalid(
            "--steps: applies to one training",
            "the steps of each stage, in a YAML file of a curriculum",
        )
    curriculum = curriculum.changed(options=options, **given)
    folder = out or Path("runs") / "train" / f"{curriculum.name}-{curriculum.algorithm}-{seed}"
    interruption = Interruption()
    with TrainingProgress() as progress:
        try:
            with interruption:
                done = train_curriculum(
                    curriculum, folder, seed=seed, restart=restart, observers=(progress,),
                    interrupted=interruption,
                    stage_begins=lambda k, s: progress.say(f"stage {k + 1}, {s.task}"),
                )  # fmt: skip
            written = None
            if report:
                from uuvsim_cosim.view.reports.training_report import write_curriculum_report

                progress.say("evaluating and drawing the best policy of the last stage")
                write_judged(folder)
                written = write_curriculum_report(folder, [stage.folder for stage in done])
        except KeyboardInterrupt:
            progress.close()
            notice("interrupted; repeat the command to continue")
            raise typer.Exit(interruption.status) from None
    _show_stages(done, folder, written)
    if show and written is not None:
        typer.launch(str(written))


def _show_stages(done: Sequence[StageTrained], folder: Path, report: Path | None) -> None:
    line()
    rows = []
    for stage in done:
        first, last = stage.evaluations[0], stage.evaluations[-1]
        scripted = "" if stage.scripted is None else number(stage.scripted, ".4g")
        rows.append(
            [stage.task, number(last["step"], ".0f"), number(stage.cpu, ".0f"),
             number(first["return"], ".4g"), scripted,
             *(number(last[k], ".4g") if k in last else "" for k in SHOWN),
             "promoted" if stage.promoted else "all steps"]
        )  # fmt: skip
    table(("stage", "steps", "CPU s", "first", "scripted", *SHOWN, "ended by"), rows, key="stages")
    for k, stage in enumerate(done):
        if stage.note is not None:
            remark("note", f"stage {k + 1}, {stage.task}: {stage.note}")
    line()
    file_line(report or folder, f"written: {tilde(report or folder)}")


PICTURES = 4  # episodes drawn
EPISODES = 100


def write_judged(folder: Path) -> None:
    """Evaluate the best policy of a training; write judged.json and pictures/ into its folder."""
    from uuvsim_cosim.commands.learn.policies import acting_of
    from uuvsim_cosim.learn.policies.playing import frames_of
    from uuvsim_cosim.learn.training.judging import judge, judge_scripted
    from uuvsim_cosim.learn.training.training_seeds import JUDGING_SEED
    from uuvsim_cosim.view.plots.png import png

    found = acting_of([str(folder)], None, {})
    (acts,) = found.policies.values()
    rows: dict[str, Mapping[str, Interval]] = {"best": judge(found.task, [acts], EPISODES)}
    if yardstick := judge_scripted(found.task, EPISODES):
        rows["scripted"] = yardstick
    (folder / "pictures").mkdir(exist_ok=True)
    for k in range(PICTURES):
        *_, last = frames_of(found.task, acts, JUDGING_SEED + k)
        write_whole(folder / "pictures" / f"{JUDGING_SEED + k}.png", png(last))
    content = {
        "episodes": EPISODES,
        "seed": JUDGING_SEED,
        "figures": {who: {k: asdict(i) for k, i in r.items()} for who, r in rows.items()},
    }
    write_whole(folder / "judged.json", (json.dumps(content, indent=1) + "\n").encode())
