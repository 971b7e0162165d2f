"""The page of the benchmark from stored results: verdicts, numbers and figures."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from uuvsim_cosim.cache import write_whole

if TYPE_CHECKING:
    from uuvsim_cosim.learn.paper.results import Result
    from uuvsim_cosim.learn.paper.verdicts import Verdict
    from uuvsim_cosim.view.reports.reproduction_figures import Panel

    Runs = Mapping[tuple[str, str], Sequence[Result]]

__all__ = ["FOLDER", "transfer_section", "write_report"]

NAMES = {"stt-masac": "STT", "scratch-masac": "from scratch"}
COMPARED = ("masac", "ippo", "idqn", "isac", "mappo")
STAGES = ("source", "transition_1", "transition_2", "target")
HEAD = """# Target tracking: trainings and verdicts

`uuvsim reproduce` generates this page from the files beside it; do not edit it by hand.
[The criteria of reproduction](../../learning/paper.md) are in
`docs/learning/paper.md`. *scripted* is the hand-written controller. Returns are interquartile
means of {episodes} episodes per seed, on seeds used neither for training nor for selection. Shares
of the scripted return, track, dist, viol and clean are means, so that each bad episode counts.
All have 95 % stratified bootstrap intervals. track, dist, viol and clean refer to the second half
of each episode.

A verdict follows from the interval, not from the value. A claim *holds* if the whole interval
satisfies the limit, *does not hold* if no part of it does, and *cannot be decided* otherwise. With
fewer than five seeds there is no decision, and the verdict gives the number of seeds. The interval
of P(improvement) is [1, 1] if every seed of one way returns more than every seed of the other (with
five seeds each, the exact two-sided rank test then gives p = 0.008).

Returns in curves are from other held-out seeds, which select the best policy of a run.

    uuvsim reproduce all --budget batched --seeds 5   # runs missing trainings, or continues them
    uuvsim reproduce all --no-run                      # writes this page again

A run keeps the policies of seed 0. Some of them are beside this page. They can be shown in 3-D or
as an HTML page:

    uuvsim play target --policy batched/careful/stt-masac-0.npz --view
    uuvsim play target --policy batched/careful/stt-masac-0.npz -o episode.html
"""


FOLDER = "transfer"
TRANSFER_HEAD = """
## Figure 11: transfer to the pool

Each way of learning, evaluated in plants in which it was not trained;
[sim2real](../../learning/sim2real.md) describes the simulation. Values are means of 100 episodes
per seed, on seeds that were not used for training, with 95 % bootstrap intervals. *Anticipated*:
the same policy with a predictor that compensates the delay; in the pool, the target's position is
extrapolated to the current time, and otherwise it is that of the last packet.
"""
TABLE = "| figure | claim | holds when | measured | verdict |\n|---|---|---|---|---|"


def write_report(results: Path) -> tuple[dict[str, list[Verdict]], list[Path]]:
    """Write README.md and pictures into a folder of results; return the verdicts by budget."""
    from uuvsim_cosim.learn.paper.results import read_results
    from uuvsim_cosim.learn.paper.verdicts import verdicts
    from uuvsim_cosim.learn.paper.ways import BUDGETS

    results.mkdir(parents=True, exist_ok=True)
    rows: dict[str, list[Verdict]] = {}
    found = {name: read_results(results, name) for name in BUDGETS}
    counts = {len(r.returns) for runs in found.values() for rs in runs.values() for r in rs}
    parts = [HEAD.format(episodes="/".join(str(c) for c in sorted(counts)) or "100")]
    files: list[Path] = []
    for name, runs in found.items():
        rows[name] = verdicts(runs)
        parts += [f"\n## Budget `{name}`\n\n{BUDGETS[name].described}\n", TABLE, *_rows(rows[name])]
        if not runs:
            parts.append("\nNothing has been run with this budget.\n")
            continue
        pictures = _pictures(results, name, runs)
        files += pictures
        parts += [*_numbers(runs), *(f"\n![{p.stem}]({p.name})" for p in pictures)]
        parts[-1] += "\n"
    transfers, part, pictures = transfer_section(results)
    for each in rows.values():  # of one budget, whatever the argument is
        each += transfers
    page = results / "README.md"
    write_whole(page, ("\n".join([*parts, part]).rstrip() + "\n").encode())
    return rows, [page, *files, *pictures]


def _rows(verdicts: Sequence[Verdict]) -> list[str]:
    return [
        f"| {r.figure} | {r.claim} | {r.wanted} | {r.measured or '-'} | {r.text} |"
        for r in verdicts
    ]


def _numbers(runs: Runs) -> Iterator[str]:
    """Yield the table of numbers by scenario and way, the scripted controller below STT."""
    from uuvsim_cosim.learn.paper.verdicts import numbers_of
    from uuvsim_cosim.learn.training.statistics import interquartile_mean

    yield (
        "\n| scenario | way | seeds | return | of scripted | track | dist [m] | viol | clean | "
        "CPU s |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    order = {s: k for k, s in enumerate((*STAGES, "careful"))}
    for (scenario, way), given in sorted(runs.items(), key=lambda x: (order[x[0][0]], x[0][1])):
        cpu = np.mean([float(r.about["cpu"]) for r in given])
        cells = [scenario, way, len(given), *numbers_of(given).values(), f"{cpu:.0f}"]
        yield f"| {' | '.join(map(str, cells))} |"
        if way == "stt-masac":
            m = given[0].scripted_metrics
            means = [*(m[k].mean() for k in ("track", "dist", "viol")), (m["clean"] == 1.0).mean()]
            cells = [scenario, "scripted", "", f"{interquartile_mean(given[0].scripted):.4g}", "1",
                     *(f"{v:.3g}" for v in means), ""]  # fmt: skip
            yield f"| {' | '.join(map(str, cells))} |"


# ---- pictures -----------------------------------------------------------------------------


def _pictures(results: Path, budget: str, runs: Runs) -> list[Path]:
    from uuvsim_cosim.learn.paper.results import read_episode
    from uuvsim_cosim.view.reports.reproduction_figures import curves_svg, episode_svg

    written = []

    def write(figure: str, svg: str) -> None:
        written.append(results / f"{figure}_{budget}.svg")
        write_whole(written[-1], svg.encode())

    alone = _panel(runs, STAGES[-1], [f"scratch-{a}-all_steps" for a in COMPARED])
    alone = replace(alone, title="target, without schooling")
    for figure, panels, size in (
        ("fig7", [_panel(runs, s, ("stt-masac", "scratch-masac")) for s in STAGES], (330.0, 220.0)),
        ("fig9", [_schooled(runs), alone], (500.0, 380.0)),
    ):
        if any(p.curves for p in panels):
            write(figure, curves_svg(panels, "return", size))
    ways = (runs.get((s, "stt-masac"), []) for s in ("careful", "target"))
    for run in next((given for given in ways if given), [])[:1]:
        columns = read_episode(results, run.key)
        trackers = sum(k.startswith("theta_") for k in columns)
        title = f"Figure 8: target scenario, seed {run.key.seed}, an episode of 20 s"
        write("fig8", episode_svg(columns, trackers, (2.6, 4.8), title))
    return written


def _panel(runs: Runs, scenario: str, ways: Sequence[str]) -> Panel:
    from uuvsim_cosim.view.reports.reproduction_figures import Curve, Panel

    curves, yardstick = [], None
    for way in ways:
        given = runs.get((scenario, way), [])
        if given:
            k = min(len(r.curve["step"]) for r in given)
            y = np.stack([r.curve["return"][:k] for r in given])
            short = way.removeprefix("scratch-").removesuffix("-all_steps").upper()
            curves.append(Curve(NAMES.get(way, short), given[0].curve["step"][:k], y))
            yardstick = float(given[0].scripted.mean())
    return Panel(scenario.replace("_", " "), "environment steps", curves, yardstick)


def _schooled(runs: Runs) -> Panel:
    """Return the panel of the target scenario after the other three, with their steps added."""
    algorithms = [a for a in COMPARED if (STAGES[-1], f"stt-{a}") in runs]
    if len(algorithms) < 2:  # nothing to compare with
        algorithms = []
    panel = _panel(runs, STAGES[-1], [f"stt-{a}" for a in algorithms])
    curves = []
    for curve, algorithm in zip(panel.curves, algorithms, strict=True):
        schooling = [runs.get((s, f"stt-{algorithm}"), []) for s in STAGES[:-1]]
        before = sum(float(given[0].about["steps"]) for given in schooling if given)
        curves.append(replace(curve, name=algorithm.upper(), x=curve.x + before))
    return replace(panel, curves=curves, title="target, after the schooling")


# ---- figure 11 ----------------------------------------------------------------------------


def transfer_section(results: Path) -> tuple[list[Verdict], str, list[Path]]:
    """Return rows of figure 11, the text for the page, and the pictures written."""
    from uuvsim_cosim.learn.paper.transfer_runs import CONDITIONS, WAYS, read_transfers
    from uuvsim_cosim.learn.paper.verdicts import cells_of, transfer_verdicts
    from uuvsim_cosim.view.reports.reproduction_figures import Mark, transfer_svg

    found = read_transfers(results / FOLDER)
    cells = cells_of(found)
    rows = transfer_verdicts(cells)
    parts = [TRANSFER_HEAD, TABLE, *_rows(rows)]
    if not found:
        return rows, "\n".join(parts), []
    ways = [w for w in WAYS if any(key[0] == w for key in cells)]
    parts.append("\n| way | | seeds | CPU s |\n|---|---|---|---|")
    for way in ways:
        runs = [j for j in found if j.way == way]
        cpu = sum(j.cpu for j in runs) / len(runs)
        parts.append(f"| `{way}` | {WAYS[way].words} | {len(runs)} | {cpu:.0f} |")
    marks: dict[str, dict[str, list[Mark]]] = {}
    tables: dict[str, list[str]] = {"return": [], "track, viol, clean": []}
    for name, condition in CONDITIONS.items():
        for how in ("as it is", "anticipated"):
            there = {w: c for w in ways if (c := cells.get((w, name, how))) is not None}
            if not there:
                continue
            returns = {w: str(c.returns) for w, c in there.items()}
            others = {w: f"{c.track.value:.3f}, {c.viol:.3f}, {c.clean:.2f}"
                      for w, c in there.items()}  # fmt: skip
            for rows_of, texts in zip(tables.values(), (returns, others), strict=True):
                cells_of_row = [condition.words, how, *(texts.get(w, "") for w in ways)]
                rows_of.append(f"| {' | '.join(cells_of_row)} |")
            hollow = how == "as it is" and (any(condition.late) or "pool" in name)
            for way, cell in there.items():
                r = cell.returns
                of_way = marks.setdefault(condition.words, {}).setdefault(way, [])
                of_way.append(Mark(r.value, r.low, r.high, hollow))
    for head, rows_of in tables.items():
        parts.append(f"\n| {head} | | {' | '.join(f'`{w}`' for w in ways)} |")
        parts += [f"|---|---|{'---|' * len(ways)}", *rows_of]
    baseline = cells.get(("dt", "nominal", "as it is"))
    least = None if baseline is None else (0.9 * baseline.returns.value, "0.9 of dt's own")
    picture = results / "fig11.svg"
    title = "Figure 11: return of an episode, mean and 95 % interval"
    write_whole(picture, transfer_svg(marks, ways, title, least).encode())
    parts.append(f"\n![fig11]({picture.name})\n")
    return rows, "\n".join(parts), [picture]
