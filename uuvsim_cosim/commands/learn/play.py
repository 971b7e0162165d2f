"""`uuvsim play`: one episode of a policy, as an animated picture, a page, pictures or a window."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from uuvsim_cosim.commands.learn.play_view import Page
from uuvsim_cosim.commands.learn.policies import Acting, acting_of
from uuvsim_cosim.commands.shared.completion import policies, tasks
from uuvsim_cosim.commands.shared.options import expect_folder, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, number, table
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["play_command"]

SEED = 2_000_000


def play_command(
    task: Annotated[
        str | None,
        typer.Argument(
            autocompletion=tasks, help="By default the task that the policy was trained in."
        ),
    ] = None,
    policy: Annotated[
        str,
        typer.Option(
            "--policy",
            "-p",
            autocompletion=policies,
            help="scripted, random, a folder or a file (.npz).",
        ),
    ] = "scripted",
    task_set: Annotated[
        list[str] | None, typer.Option("--task-set", help="The task's NAME=VALUE: n_trackers=3.")
    ] = None,
    other_task: Annotated[
        bool, typer.Option("--other-task", help="Play a policy in a task that it does not know.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", help="Of the episode.")] = SEED,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help=".html, .png (animated), else a folder of pictures."),
    ] = None,
    window: Annotated[bool, typer.Option("--window", help="Show it in a window instead.")] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open what was written.")] = False,
    view: Annotated[
        bool, typer.Option("--view", help="Replay it in a browser, in 3-D; Ctrl-C ends it.")
    ] = False,
    port: Annotated[int | None, typer.Option(help="Of --view; by default 8080 or near.")] = None,
) -> None:
    """Play one episode: what the policy does, drawn, and the metrics of it."""
    if seed < 0:
        raise InputInvalid(f"--seed {seed}: expected 0 or more")
    if window and out is not None:
        raise InputInvalid(f"--window and --out {out}: expected one of them")
    if window and view:
        raise InputInvalid("--window and --view: expected one of them")
    if out is not None:
        expect_folder(out, ".html", ".png")
    page = Page(port, view)
    options = nested("--task-set", task_set or [], "NAME=VALUE, as n_trackers=3")
    with StudyProgress() as progress:
        progress.say("building, once")
        from uuvsim_cosim.envs.tasks.evaluation import evaluate
        from uuvsim_cosim.learn.policies.playing import frames_of

        found = acting_of([policy], task, options, own_task=not other_task)
        (acts,) = found.policies.values()
        progress.say("playing")
        frames: list[NDArray[np.uint8]] = []
        if view:
            page.record(found.task, acts, seed, found.name)
        if not view or out is not None:
            frames = list(frames_of(found.task, acts, seed, "human" if window else "rgb_array"))
        if policy == "random":  # it draws new random numbers
            (acts,) = acting_of([policy], task, options).policies.values()
        figures = evaluate(found.task, acts, 1, seed=seed)
    rows = {
        "return": number(float(figures.returns[0]), ".4g"),
        "seconds": number(figures.seconds[0], "g"),
    }
    rows |= {k: number(float(v[0]), ".4g") for k, v in figures.metrics.items()}
    line()
    line(f"{found.name}, {policy}, seed {seed}; metrics are means over the second half")
    table(("figure", "value"), list(rows.items()), key="figures")
    if not window and (out is not None or not view):
        written = _written(found, policy, seed, frames, {k: str(v) for k, v in rows.items()}, out)
        line()
        file_table([written])
        if open_ and not view:
            typer.launch(str(written))
    page.serve(f"{found.name}, {policy}", show=open_)


def _written(
    found: Acting, policy: str, seed: int, frames: Sequence[NDArray[np.uint8]],
    rows: dict[str, str], out: Path | None,
) -> Path:  # fmt: skip
    from uuvsim_cosim.learn.shared.task_ids import short_name
    from uuvsim_cosim.view.plots.player import player_html
    from uuvsim_cosim.view.plots.png import animated_png, png

    seconds = float(found.task.action_step)
    name = policy if policy in ("scripted", "random") else "policy"
    path = out or Path(f"{short_name(found.name)}-{name}-{seed}.html")
    try:
        if path.suffix.lower() not in (".html", ".png"):
            path.mkdir(parents=True, exist_ok=True)
            for k, frame in enumerate(frames):
                (path / f"{k:05d}.png").write_bytes(png(frame))
            return path
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix.lower() == ".png":
            path.write_bytes(animated_png(frames, seconds))
        else:
            page = player_html(found.name, f"{policy}, seed {seed}", frames, seconds, rows)
            path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise InputInvalid(f"{path}: cannot be written ({error.strerror})") from None
    return path
