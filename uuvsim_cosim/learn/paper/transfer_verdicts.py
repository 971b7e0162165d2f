"""Verdicts on figure 11: policies learned from data against their teacher, and in the pool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.paper.transfer_runs import Judged
from uuvsim_cosim.learn.paper.verdicts import Verdict, verdict
from uuvsim_cosim.learn.training.statistics import Interval, ratio, together

__all__ = ["Cell", "Cells", "cells_of", "transfer_verdicts"]

AS_IT_IS, ANTICIPATED = "as it is", "anticipated"


@dataclass(frozen=True)
class Cell:
    """A way under a condition: figures of all its seeds; its length is their number."""

    values: NDArray[np.float64]  # returns of (seeds, episodes)
    returns: Interval  # their mean
    track: Interval
    viol: float
    clean: float

    def __len__(self) -> int:
        """Return the number of seeds."""
        return len(self.values)


Cells = Mapping[tuple[str, str, str], Cell]


def cells_of(found: Sequence[Judged]) -> dict[tuple[str, str, str], Cell]:
    """Return cells by way, condition and how; means over episodes, and over seeds."""
    gathered: dict[tuple[str, str, str], list[Judged]] = {}
    for one in found:
        for condition, how in one.returns:
            gathered.setdefault((one.way, condition, how), []).append(one)
    cells = {}
    for (way, *at), runs in gathered.items():
        place = (at[0], at[1])
        least = min(len(r.returns[place]) for r in runs)
        values = np.stack([r.returns[place][:least] for r in runs])
        track = _mean(np.stack([r.track[place][:least] for r in runs]))
        viol, clean = (
            float(np.mean([r.means[place][name] for r in runs])) for name in ("viol", "clean")
        )
        cells[(way, *place)] = Cell(values, _mean(values), track, viol, clean)
    return cells


def _mean(values: NDArray[np.float64], draws: int = 500) -> Interval:
    """Return the mean of (seeds, episodes) as `statistics.interval` does, all draws at once."""
    seeds, episodes = values.shape
    random = np.random.default_rng(0)
    chosen = random.integers(seeds, size=(draws, seeds, 1))
    means = values[chosen, random.integers(episodes, size=(draws, seeds, episodes))].mean((1, 2))
    low, high = np.quantile(means, (0.025, 0.975))
    return Interval(float(values.mean()), float(low), float(high))


def transfer_verdicts(cells: Cells) -> list[Verdict]:
    """Judge every claim on the transformer, on anticipation and on randomisation."""
    dt, teacher, bc = (cells.get((w, "nominal", AS_IT_IS)) for w in ("dt", "scripted", "bc"))

    def as_teacher(dt: Cell, teacher: Cell) -> tuple[str, str]:
        share = ratio(dt.values, teacher.values)
        decision = together(share.at_least(0.95), dt.track.at_least(0.95))
        return f"{share} of {teacher.returns.value:.4g}, track {dt.track}", decision

    def as_cloning(dt: Cell, bc: Cell) -> tuple[str, str]:
        share = ratio(dt.values, bc.values)
        return f"{dt.returns} against {bc.returns}, ratio {share}", share.at_least(1.0)

    def loses(hard: Cell, plain: Cell) -> tuple[str, str]:
        share = ratio(hard.values, plain.values, same=len(hard) == len(plain))
        lost = [100 * (1 - x) for x in (share.value, share.high, share.low)]
        measured = "loses {:.1f} [{:.1f}, {:.1f}] %".format(*lost)
        return f"{measured}: {hard.returns}, track {hard.track}", share.at_least(0.9)

    def tracks(cell: Cell) -> tuple[str, str]:
        measured = f"track {cell.track}, return {cell.returns}, viol {cell.viol:.3g}"
        return measured, cell.track.at_least(0.9)

    def compares(randomised: Cell, plain: Cell) -> tuple[str, str]:
        return (
            f"return {randomised.returns}, viol {randomised.viol:.3g}; without {plain.returns}, "
            f"{plain.viol:.3g}", "reported"
        )  # fmt: skip

    claim = "the transformer is as good as its teacher"
    wanted = "400 episodes; return ≥ 0.95 of the teacher's, track ≥ 0.95"
    rows = [verdict("11", claim, wanted, as_teacher, dt, teacher, counted=1)]
    claim, wanted = "and as behaviour cloning", "return ≥ behaviour cloning's"
    rows.append(verdict("11", claim, wanted, as_cloning, dt, bc))
    late = "with positions and commands 0.4 s late, 0.8 s in all"
    for condition, how, claim in (
        ("noise", AS_IT_IS, "with ±7 mm of noise"),
        ("seen", AS_IT_IS, "with positions 0.4 s late"),
        ("acted", AS_IT_IS, "with commands 0.4 s late"),
        ("weak", AS_IT_IS, "with thrust x 0.8"),
        ("all", AS_IT_IS, "with noise, positions 0.4 s late and thrust x 0.8"),
        ("acted", ANTICIPATED, "with commands 0.4 s late, anticipated"),
        ("both", AS_IT_IS, late),
        ("both", ANTICIPATED, f"{late}, anticipated"),
        ("all_both", ANTICIPATED, "with all of it, 0.8 s late, anticipated"),
    ):
        hard = cells.get(("dt", condition, how))
        rows.append(verdict("11", claim, "loses ≤ 10 %", loses, hard, dt, counted=1))
    claim = "in the pool: its own navigation, positioning noise, slow radio, a vehicle as target"
    pool = cells.get(("dt", "pool", ANTICIPATED))
    rows.append(verdict("11", claim, "track ≥ 0.9", tracks, pool))
    for condition, how, where in (
        ("both", AS_IT_IS, "delays of 0.8 s, not anticipated"),
        ("pool", ANTICIPATED, "the pool"),
    ):
        both = [cells.get((w, condition, how)) for w in ("sac-randomised", "sac")]
        claim = f"domain randomisation in {where}"
        rows.append(verdict("11", claim, "reported", compares, *both))
    return rows
