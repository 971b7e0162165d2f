"""Section of figure 11 on the benchmark's page: tables and a figure from stored results."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from uuvsim_cosim.cache import write_whole

if TYPE_CHECKING:
    from uuvsim_cosim.learn.paper.verdicts import Verdict

__all__ = ["FOLDER", "transfer_section"]

FOLDER = "transfer"
HEAD = """
## Figure 11: into the pool

Each way of learning, put where it was not taught; [sim2real](../../learning/sim2real.md) says what
is simulated. Means of 100 episodes a seed, judged on seeds never trained on, with 95 % bootstrap
intervals. *Anticipated*: the same policy behind a predictor of what is late; in the pool, with the
target carried on to now, or else as the last packet said.
"""


def transfer_section(results: Path) -> tuple[list[Verdict], str, list[Path]]:
    """Return rows of figure 11, the text for the page, and the pictures written."""
    from uuvsim_cosim.learn.paper.transfer_runs import CONDITIONS, WAYS, read_transfers
    from uuvsim_cosim.learn.paper.transfer_verdicts import cells_of, transfer_verdicts
    from uuvsim_cosim.view.reports.reproduction_figures import Mark, transfer_svg

    found = read_transfers(results / FOLDER)
    cells = cells_of(found)
    rows = transfer_verdicts(cells)
    parts = [HEAD]
    parts.append("| figure | claim | holds when | measured | verdict |\n|---|---|---|---|---|")
    parts += [
        f"| {r.figure} | {r.claim} | {r.wanted} | {r.measured or '-'} | {r.text} |" for r in rows
    ]
    if not found:
        return rows, "\n".join(parts), []
    ways = [w for w in WAYS if any(key[0] == w for key in cells)]
    parts.append("")
    parts.append("| way | | seeds | CPU s |\n|---|---|---|---|")
    for way in ways:
        runs = [j for j in found if j.way == way]
        cpu = sum(j.cpu for j in runs) / len(runs)
        parts.append(f"| `{way}` | {WAYS[way].words} | {len(runs)} | {cpu:.0f} |")
    parts.append(f"\n| return | | {' | '.join(f'`{w}`' for w in ways)} |")
    parts.append(f"|---|---|{'---|' * len(ways)}")
    marks: dict[str, dict[str, list[Mark]]] = {}
    for name, condition in CONDITIONS.items():
        for how in ("as it is", "anticipated"):
            row = [cells.get((w, name, how)) for w in ways]
            if not any(row):
                continue
            texts = ["" if c is None else f"{c.returns}" for c in row]
            parts.append(f"| {condition.words} | {how} | {' | '.join(texts)} |")
            for way, cell in zip(ways, row, strict=True):
                if cell is not None:
                    r = cell.returns
                    hollow = how == "as it is" and (any(condition.late) or "pool" in name)
                    there = marks.setdefault(condition.words, {}).setdefault(way, [])
                    there.append(Mark(r.value, r.low, r.high, hollow))
    parts.append(f"\n| track, viol, clean | | {' | '.join(f'`{w}`' for w in ways)} |")
    parts.append(f"|---|---|{'---|' * len(ways)}")
    for name, condition in CONDITIONS.items():
        for how in ("as it is", "anticipated"):
            row = [cells.get((w, name, how)) for w in ways]
            if any(row):
                texts = ["" if c is None else f"{c.track.value:.3f}, {c.viol:.3f}, {c.clean:.2f}"
                        for c in row]  # fmt: skip
                parts.append(f"| {condition.words} | {how} | {' | '.join(texts)} |")
    baseline = cells.get(("dt", "nominal", "as it is"))
    least = None if baseline is None else (0.9 * baseline.returns.value, "0.9 of dt's own")
    picture = results / "fig11.svg"
    title = "Figure 11: return of an episode, mean and 95 % interval"
    write_whole(picture, transfer_svg(marks, ways, title, least).encode())
    parts.append(f"\n![fig11]({picture.name})\n")
    return rows, "\n".join(parts), [picture]
