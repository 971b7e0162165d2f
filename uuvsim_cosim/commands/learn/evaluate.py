"""`uuvsim evaluate`: figures of policies with intervals, and of the hand-written controller."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.learn.policies import acting_of
from uuvsim_cosim.commands.shared.completion import policies, tasks
from uuvsim_cosim.commands.shared.options import RAY, clustered, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import Shown, file_line, line, table, tilde
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    from uuvsim_cosim.learn.training.statistics import Interval

__all__ = ["evaluate_command", "shown"]

SEED = 2_000_000
HEAD = ("policy", "figure", "value", "low", "high")


def evaluate_command(
    policies: Annotated[
        list[str],
        typer.Argument(
            autocompletion=policies,
            help="Policies: folders of trainings, .npz files, scripted, random.",
        ),
    ],
    task: Annotated[
        str | None,
        typer.Option(
            "--task",
            autocompletion=tasks,
            help="Task, if not the one that the policies were trained in.",
        ),
    ] = None,
    task_set: Annotated[
        list[str] | None,
        typer.Option("--task-set", help="Option of the task: NAME=VALUE, such as n_trackers=3."),
    ] = None,
    episodes: Annotated[
        int, typer.Option("--episodes", help="Number of episodes per policy.")
    ] = 100,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the first episode.")] = SEED,
    last: Annotated[
        bool, typer.Option("--last", help="Use the last policy of a training instead of the best.")
    ] = False,
    ray: Annotated[str | None, typer.Option("--ray", help=RAY)] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Table to write, as CSV.")] = None,
) -> None:
    """Evaluate policies on seeds not used in training: means with 95 % bootstrap intervals."""
    if not 1 <= episodes <= 100_000:
        raise InputInvalid(f"--episodes {episodes}: expected 1 … 100000")
    if seed < 0:
        raise InputInvalid(f"--seed {seed}: expected 0 or more")
    if out is not None:
        _refuse_other(out)
    options = nested("--task-set", task_set or [], "NAME=VALUE, such as n_trackers=3")
    with StudyProgress("parts") as progress:
        progress.say("building (once)")
        found = acting_of(list(dict.fromkeys(policies)), task, options, last=last)
        from uuvsim_cosim.learn.training.judging import evaluate_all, judge_scripted, judged

        with clustered(ray) as cluster:
            given = evaluate_all(
                found.name, found.options, found.policies, episodes, seed, cluster=cluster,
                progress=progress,
            )  # fmt: skip
        rows = {
            (name if "/" not in name.rstrip("/") else tilde(name)): judged([e])
            for name, e in given.items()
        }
        learned = [e for name, e in given.items() if name not in ("scripted", "random")]
        if len(learned) > 1:
            rows["together"] = judged(learned)
        if "scripted" not in rows and (yardstick := judge_scripted(found.task, episodes, seed)):
            rows["scripted"] = yardstick
    line()
    line(f"{found.name}: {episodes} episodes from seed {seed}, 95 % bootstrap intervals")
    for note in found.notes:
        line(f"note: {note}")
    figures = list(next(iter(rows.values())))
    table(("figure", *rows), [(f, *(shown(r[f]) for r in rows.values())) for f in figures],
          key="figures")  # fmt: skip
    if out is not None:
        try:
            with out.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(HEAD)
                for who, of_policy in rows.items():
                    writer.writerows((who, k, i.value, i.low, i.high) for k, i in of_policy.items())
        except OSError as error:
            raise InputInvalid(f"{out}: cannot be written ({error.strerror})") from None
        line()
        file_line(out, f"written: {tilde(out)}")


def shown(i: Interval) -> Shown:
    """Return a figure with its interval as text."""
    text = f"{i.value:.4g} [{i.low:.4g}, {i.high:.4g}]"
    return Shown({"value": i.value, "low": i.low, "high": i.high}, text)


def _refuse_other(path: Path) -> None:
    """Raise InputInvalid if a table cannot be written, or would replace another file."""
    if path.suffix.lower() != ".csv":
        raise InputInvalid(f"--out {path}: expected a table's name, FILE.csv")
    if path.is_dir() or not path.parent.is_dir():
        raise InputInvalid(f"--out {path}: expected a file in an existing folder")
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            first = file.readline().strip()
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputInvalid(f"--out {path}: cannot be read ({error.strerror})") from None
    if first not in ("", ",".join(HEAD)):
        raise InputInvalid(
            f"--out {path}: exists and is no table of `uuvsim evaluate`", "another name"
        )
