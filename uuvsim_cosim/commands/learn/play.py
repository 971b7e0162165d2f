"""`uuvsim play`: one episode of a policy, as an animated picture, a page, pictures or a window."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from uuvsim_cosim.commands.learn.policies import Acting, acting_of
from uuvsim_cosim.commands.shared.completion import policies, tasks
from uuvsim_cosim.commands.shared.options import expect_folder, nested
from uuvsim_cosim.commands.shared.progress import StudyProgress
from uuvsim_cosim.commands.shared.terminal import file_table, line, number, table
from uuvsim_cosim.errors import InputInvalid

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from uuvsim_cosim.envs.pictures.drawn import View
    from uuvsim_cosim.envs.task.task import Moment, Task, TeamTask
    from uuvsim_cosim.orchestrator.plan.plan import Plan
    from uuvsim_cosim.view.recorded.traces import Array, Traces
    from uuvsim_cosim.view.scene3d.motion import Motion
    from uuvsim_cosim.view.scene3d.scene import Scene3D, Solid

__all__ = ["episode_of", "play_command"]

GOAL = "goal"


def episode_of(
    task: Task | TeamTask, policy: Any, seed: int, name: str
) -> tuple[Scene3D, Motion, Traces]:
    """Play episode 0 of a seed and return its motion; raises InputInvalid without a pose.

    The task is not changed: a copy of it reads the signals that move its scene as well.
    """
    import numpy as np

    from uuvsim_cosim.learn.policies.playing import frames_of
    from uuvsim_cosim.orchestrator.plan.flatten import flatten
    from uuvsim_cosim.view.recorded.traces import Traces
    from uuvsim_cosim.view.scene3d.motion import motion_of
    from uuvsim_cosim.view.scene3d.scene import Marker
    from uuvsim_cosim.view.scene3d.scene_of_plan import scene3d_of_plan

    plan = flatten(task.system)
    scene3d = scene3d_of_plan(plan, name)
    if not scene3d.bodies:
        raise InputInvalid(
            f"--view: no component of {name} has a pose (eta) that tau moves",
            "a task with a vehicle, or no --view",
        )
    time: list[float] = []
    rows: dict[str, list[Array]] = {name: [] for name in scene3d.signals}
    goals: list[Array] = []
    start: dict[str, Array] = {}

    def watch(m: Moment, row: int) -> View | None:
        time.append(float(m.time[row]))
        for signal, values in rows.items():
            values.append(np.array(m[signal][row], float))
        if not start:
            start.update({key: np.array(value[row]) for key, value in m.start.items()})
        view = task.view(m, row)
        if view is not None and view.goals and len(view.goals[0].position) == 3:
            goals.append(np.array(view.goals[0].position))
        return view

    watched: Any = copy.copy(task)
    watched.signals = tuple(dict.fromkeys((*task.signals, *scene3d.signals)))
    watched.view = watch
    for _ in frames_of(watched, policy, seed):
        pass
    # A moment that was drawn twice counts once.
    times, picks = np.unique(np.array(time), return_index=True)
    values = {name: np.array(given)[picks] for name, given in rows.items()}
    if len(goals) == len(time):
        values[f"{GOAL}.position"] = np.array(goals)[picks]
    if goals:
        scene3d = replace(
            scene3d, markers=(*scene3d.markers, Marker(GOAL, f"{GOAL}.position", 0.08))
        )
    scene3d = replace(scene3d, solids=tuple(_solids(plan, start, scene3d)))
    units = {
        f"{c.path}.{v.name}": ", ".join(dict.fromkeys(u or "1" for u in v.units))
        for c in plan.components
        for v in c.description.variables.values()
    }
    traces = Traces(times, values, units)
    return scene3d, motion_of(scene3d, traces), traces


def _solids(plan: Plan, start: dict[str, Array], scene3d: Scene3D) -> Iterator[Solid]:
    """Yield the still bodies of this episode: pools and obstacles may be random."""
    from uuvsim_cosim.view.scene3d.scene_of_plan import pool_solids

    names = ("origin", "size", "obstacles")
    found: dict[str, Solid] = {}
    for c in plan.components:
        if not c.description.variables.keys().isdisjoint(names):
            drawn = {n: start[f"{c.path}.{n}"] for n in names if f"{c.path}.{n}" in start}
            found |= {s.name: s for s in pool_solids(c, drawn)}
    yield from found.values() or scene3d.solids


SEED = 2_000_000


def play_command(
    task: Annotated[
        str | None,
        typer.Argument(
            autocompletion=tasks, help="Task; by default the one that the policy was trained in."
        ),
    ] = None,
    policy: Annotated[
        str,
        typer.Option(
            "--policy",
            "-p",
            autocompletion=policies,
            help="Policy: scripted, random, a training's folder or an .npz file.",
        ),
    ] = "scripted",
    task_set: Annotated[
        list[str] | None,
        typer.Option("--task-set", help="Option of the task: NAME=VALUE, such as n_trackers=3."),
    ] = None,
    other_task: Annotated[
        bool, typer.Option("--other-task", help="Allow a task that the policy was not trained in.")
    ] = False,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the episode.")] = SEED,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            help="File to write: .html or .png (animated); any other name is a folder of pictures.",
        ),
    ] = None,
    live: Annotated[
        bool,
        typer.Option(
            "--live", help="Write a page (.html) that computes the episode in the browser."
        ),
    ] = False,
    window: Annotated[
        bool, typer.Option("--window", help="Show the episode in a window instead.")
    ] = False,
    open_: Annotated[bool, typer.Option("--open", help="Open the written file.")] = False,
    view: Annotated[
        bool, typer.Option("--view", help="Replay the episode in 3-D in a browser; Ctrl-C ends it.")
    ] = False,
    port: Annotated[
        int | None, typer.Option(help="Port of --view; by default the first free one from 8080 on.")
    ] = None,
) -> None:
    """Play one episode of a policy, draw it, and print its metrics."""
    if seed < 0:
        raise InputInvalid(f"--seed {seed}: expected 0 or more")
    if window and out is not None:
        raise InputInvalid(f"--window and --out {out}: expected one of them")
    if live and (window or view):
        raise InputInvalid("--live and --window or --view", "one of them")
    if live and out is not None and out.suffix.lower() != ".html":
        raise InputInvalid(f"--live and --out {out}", "a file .html")
    if window and view:
        raise InputInvalid("--window and --view: expected one of them")
    if out is not None:
        expect_folder(out, ".html", ".png")
    if port is not None and not view:
        raise InputInvalid(f"--port {port}: applies to --view", "--view")
    server = recorded = None
    if view:
        from uuvsim_cosim.view.scene3d.viser_server import open_server

        server = open_server(port)  # before anything is computed
    options = nested("--task-set", task_set or [], "NAME=VALUE, such as n_trackers=3")
    with StudyProgress() as progress:
        progress.say("building (once)")
        from uuvsim_cosim.envs.tasks.evaluation import evaluate
        from uuvsim_cosim.learn.policies.playing import frames_of
        from uuvsim_cosim.learn.shared.task_ids import short_name

        found = acting_of([policy], task, options, own_task=not other_task)
        (acts,) = found.policies.values()
        progress.say("playing")
        frames: list[NDArray[np.uint8]] = []
        if view:
            recorded = episode_of(found.task, acts, seed, short_name(found.name))
        if not live and (not view or out is not None):
            frames = list(frames_of(found.task, acts, seed, "human" if window else "rgb_array"))
        if policy == "random":  # it draws new random numbers
            (acts,) = acting_of([policy], task, options).policies.values()
        figures = evaluate(found.task, acts, 1, seed=seed)
        if live:
            from uuvsim_cosim.commands.learn.play_page import write_play_page

            progress.say("compiling the page")
            out = out or _default_path(found, policy, seed)
            on_page = write_play_page(found, policy, seed, out, float(figures.returns[0]))
    rows = {
        "return": number(float(figures.returns[0]), ".9g" if live else ".4g"),
        "seconds": number(figures.seconds[0], "g"),
    }
    if live:
        rows["return on the page"] = number(on_page, ".9g")
    rows |= {k: number(float(v[0]), ".4g") for k, v in figures.metrics.items()}
    line()
    line(f"{found.name}, {policy}, seed {seed}; metrics are means over the second half")
    table(("figure", "value"), list(rows.items()), key="figures")
    if not window and (out is not None or not view):
        texts = {k: str(v) for k, v in rows.items()}
        written = out if live and out else _written(found, policy, seed, frames, texts, out)
        line()
        file_table([written])
        if open_ and not view:
            typer.launch(str(written))
    if server is not None and recorded is not None:
        from uuvsim_cosim.commands.run.view import serve
        from uuvsim_cosim.view.scene3d.viser_server import close_server

        try:
            serve(server, f"{found.name}, {policy}", recorded, show=open_)
        finally:
            close_server(server)


def _default_path(found: Acting, policy: str, seed: int) -> Path:
    from uuvsim_cosim.learn.shared.task_ids import short_name

    name = policy if policy in ("scripted", "random") else "policy"
    return Path(f"{short_name(found.name)}-{name}-{seed}.html")


def _written(
    found: Acting, policy: str, seed: int, frames: Sequence[NDArray[np.uint8]],
    rows: dict[str, str], out: Path | None,
) -> Path:  # fmt: skip
    from uuvsim_cosim.view.plots.player import player_html
    from uuvsim_cosim.view.plots.png import animated_png, png

    seconds = float(found.task.action_step)
    path = out or _default_path(found, policy, seed)
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
