"""Verdicts on figure 11: policies learned from data against their teacher, and in the pool."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.paper.transfer_runs import Judged
from uuvsim_cosim.learn.paper.verdicts import Verdict
from uuvsim_cosim.learn.training.statistics import Interval, Said, ratio, together

__all__ = ["Cell", "Cells", "cells_of", "transfer_verdicts"]

AS_IT_IS, ANTICIPATED = "as it is", "anticipated"
LEAST = 0.9  # of its own return: "loses at most 10 %"


@dataclass(frozen=True)
class Cell:
    """A way under a condition: figures of all its seeds."""

    seeds: int
    values: NDArray[np.float64]  # returns of (seeds, episodes)
    returns: Interval  # their mean
    track: Interval
    dist: float  # m
    viol: float
    clean: float


Cells = Mapping[tuple[str, str, str], Cell]


def cells_of(found: Sequence[Judged]) -> dict[tuple[str, str, str], Cell]:
    """Return cells by way, condition and how; means over episodes, and over seeds."""
    gathered: dict[tuple[str, str, str], list[Judged]] = {}
    for one in found:
        for condition, how in one.returns:
            gathered.setdefault((one.way, condition, how), []).append(one)
    cells = {}
    for (way, condition, how), runs in gathered.items():
        least = min(len(r.returns[condition, how]) for r in runs)
        values, tracked = (
            np.stack([x[condition, how][:least] for x in rows])
            for rows in ([r.returns for r in runs], [r.track for r in runs])
        )
        returns, track = _mean(values), _mean(tracked)
        dist, viol, clean = (
            float(np.mean([r.means[condition, how][name] for r in runs]))
            for name in ("dist", "viol", "clean")
        )
        cells[way, condition, how] = Cell(len(runs), values, returns, track, dist, viol, clean)
    return cells


def transfer_verdicts(cells: Cells) -> list[Verdict]:
    """Judge every claim on the transformer, on anticipation and on randomisation."""
    rows = [_teacher(cells), _cloning(cells)]
    for condition, words in (
        ("noise", "with ±7 mm of noise"),
        ("seen", "with positions 0.4 s late"),
        ("acted", "with commands 0.4 s late"),
        ("weak", "with thrust x 0.8"),
        ("all", "with noise, positions 0.4 s late and thrust x 0.8"),
    ):
        rows.append(_loses(cells, condition, AS_IT_IS, words))
    ahead = "with commands 0.4 s late, anticipated"
    rows.append(_loses(cells, "acted", ANTICIPATED, ahead))
    late = "with positions and commands 0.4 s late, 0.8 s in all"
    rows.append(_loses(cells, "both", AS_IT_IS, late))
    rows.append(_loses(cells, "both", ANTICIPATED, f"{late}, anticipated"))
    worst = "with all of it, 0.8 s late, anticipated"
    rows.append(_loses(cells, "all_both", ANTICIPATED, worst))
    return [*rows, _pool(cells), _randomised(cells, "both"), _randomised(cells, "pool")]


# ---- inside -------------------------------------------------------------------------------


def _mean(values: NDArray[np.float64], draws: int = 500) -> Interval:
    """Return the mean of (seeds, episodes) as `statistics.interval` does, all draws at once."""
    seeds, episodes = values.shape
    random = np.random.default_rng(0)
    chosen = random.integers(seeds, size=(draws, seeds, 1))
    means = values[chosen, random.integers(episodes, size=(draws, seeds, episodes))].mean((1, 2))
    low, high = np.quantile(means, (0.025, 0.975))
    return Interval(float(values.mean()), float(low), float(high))


def _teacher(cells: Cells) -> Verdict:
    claim = "the transformer is as good as its teacher"
    wanted = "400 episodes; return ≥ 0.95 of the teacher's, track ≥ 0.95"
    dt, other = (cells.get((w, "nominal", AS_IT_IS)) for w in ("dt", "scripted"))
    if dt is None or other is None:
        return _missing(claim, wanted)
    share = ratio(dt.values, other.values)
    measured = f"{share} of {other.returns.value:.4g}, track {dt.track}"
    return _verdict(
        claim, wanted, measured, together(share.at_least(0.95), dt.track.at_least(0.95)), dt
    )


def _cloning(cells: Cells) -> Verdict:
    claim, wanted = "and as behaviour cloning", "return ≥ behaviour cloning's"
    dt, bc = (cells.get((w, "nominal", AS_IT_IS)) for w in ("dt", "bc"))
    if dt is None or bc is None:
        return _missing(claim, wanted)
    share = ratio(dt.values, bc.values)
    measured = f"{dt.returns} against {bc.returns}, ratio {share}"
    return _verdict(claim, wanted, measured, share.at_least(1.0), dt, bc)


def _loses(cells: Cells, condition: str, how: str, words: str) -> Verdict:
    wanted = "loses ≤ 10 %"
    plain, hard = cells.get(("dt", "nominal", AS_IT_IS)), cells.get(("dt", condition, how))
    if plain is None or hard is None:
        return _missing(words, wanted)
    share = ratio(hard.values, plain.values, same=hard.seeds == plain.seeds)
    lost = [100 * (1 - x) for x in (share.value, share.high, share.low)]
    measured = "loses {:.1f} [{:.1f}, {:.1f}] %".format(*lost)
    measured += f": {hard.returns}, track {hard.track}"
    return _verdict(words, wanted, measured, share.at_least(LEAST), hard)


def _pool(cells: Cells) -> Verdict:
    claim = "in the pool: its own navigation, positioning noise, slow radio, a vehicle as target"
    wanted, cell = "track ≥ 0.9", cells.get(("dt", "pool", ANTICIPATED))
    if cell is None:
        return _missing(claim, wanted)
    measured = f"track {cell.track}, return {cell.returns}, viol {cell.viol:.3g}"
    return _verdict(claim, wanted, measured, cell.track.at_least(0.9), cell)


def _randomised(cells: Cells, condition: str) -> Verdict:
    where = "the pool" if condition == "pool" else "delays of 0.8 s, not anticipated"
    claim, how = (
        f"domain randomisation in {where}",
        ANTICIPATED if condition == "pool" else AS_IT_IS,
    )
    with_, without = (cells.get((w, condition, how)) for w in ("sac-randomised", "sac"))
    if with_ is None or without is None:
        return _missing(claim, "reported")
    measured = (
        f"return {with_.returns}, viol {with_.viol:.3g}; without {without.returns}, "
        f"{without.viol:.3g}"
    )
    seeds = min(with_.seeds, without.seeds)
    return Verdict("11", claim, "reported", measured, "reported", seeds)


def _verdict(claim: str, wanted: str, measured: str, verdict: Said, *cells: Cell) -> Verdict:
    return Verdict("11", claim, wanted, measured, verdict, min(c.seeds for c in cells))


def _missing(claim: str, wanted: str) -> Verdict:
    return Verdict("11", claim, wanted, "", "not yet run", 0)
