"""Verdicts on each claim: it holds, it does not hold, or it cannot be decided.

A verdict follows from the 95 % interval of the measured figure, not from its value: a claim holds
if the whole interval keeps the limit, does not hold if no part does, and is undecided otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Sized
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.paper.results import Result
from uuvsim_cosim.learn.paper.transfer_runs import Judged
from uuvsim_cosim.learn.training.statistics import (
    HOLDS,
    HOLDS_NOT,
    UNDECIDED,
    Decision,
    Interval,
    interval,
    probability_of_improvement,
    ratio,
    together,
)

__all__ = [
    "SEEDS",
    "Cell",
    "Cells",
    "Verdict",
    "cells_of",
    "numbers_of",
    "transfer_verdicts",
    "verdict",
    "verdicts",
]

SEEDS = 5  # that a verdict needs
Results = Mapping[tuple[str, str], Sequence[Result]]
STAGES = ("source", "transition_1", "transition_2", "target")
STT = "stt-masac"


@dataclass(frozen=True)
class Verdict:
    """One row of the table; `decision` is one of `Decision`, "reported" or "not yet run"."""

    figure: str
    claim: str
    wanted: str
    measured: str
    decision: str
    seeds: int

    @property
    def text(self) -> str:
        """Return the verdict in words; fewer than five seeds decide nothing."""
        if not self.seeds or self.seeds >= SEEDS:
            return self.decision
        few = f"{self.seeds} of {SEEDS} seeds"
        if self.decision in ("reported", UNDECIDED):
            return f"{self.decision} ({few})"
        return f"{UNDECIDED} ({few}; so far: {self.decision})"


def verdict(
    figure: str, claim: str, wanted: str, judge: Callable[..., tuple[str, str]],
    *runs: Sized | None, counted: int | None = None,
) -> Verdict:  # fmt: skip
    """Judge a claim about several groups of runs, one run for each seed, if no group is empty.

    `judge` maps the groups to a text with the measured values and the decision. The number of seeds
    is that of the first `counted` groups, by default of all groups.
    """
    groups = [r for r in runs if r]
    if len(groups) < len(runs):
        return Verdict(figure, claim, wanted, "", "not yet run", 0)
    seeds = min(map(len, groups[:counted]))
    return Verdict(figure, claim, wanted, *judge(*groups), seeds)


def verdicts(results: Results) -> list[Verdict]:
    """Judge every claim, except those of figure 11 (see `transfer_verdicts`)."""
    most_seeds = max(results.values(), key=len, default=())
    wanted = "at most 10 CPU minutes a seed and scenario"
    cost = verdict("all", "the cost", wanted, lambda _: _cost(results), most_seeds)
    figures = (_figure_7, _figure_8, _figure_9, _success)
    return [*(row for figure in figures for row in figure(results)), cost]


# ---- the claims of each figure ------------------------------------------------------------


def _figure_7(results: Results) -> Iterator[Verdict]:
    def converges(runs: Sequence[Result]) -> tuple[str, str]:
        track, share = _mean_of(runs, "track"), _share(runs)
        shares = []  # of the episodes after which 90 % of the rise to the last value is made
        for step, curve in ((r.curve["step"], r.curve["return"]) for r in runs):
            wanted = curve[0] + 0.9 * (curve[-1] - curve[0])
            shares.append([float(step[int(np.argmax(curve >= wanted))] / step[-1])])
        early = interval(np.array(shares))
        decision = together(track.at_least(0.95), share.at_least(0.9), early.at_most(0.3))
        return f"track {track}, return {share} of scripted, after {early} of the episodes", decision

    wanted = "track ≥ 0.95, return ≥ 0.9 scripted; 90 % of its last value by 30 % of the episodes"
    yield verdict("7", "source converges", wanted, converges, results.get(("source", STT)))

    def continues(pairs: Sequence[tuple[Result, Result]]) -> tuple[str, str]:
        # w_t r_t + w_a r_a + w_p p_2 of an evaluation, a step: the last before, the first after
        terms = [[sum(r.curve[k][row] for k in ("r_t", "r_a", "p_2"))
                  for r, row in zip(pair, (-1, 0), strict=True)] for pair in pairs]  # fmt: skip
        found = interval(np.array([[float(after) / float(before)] for before, after in terms]))
        return str(found), found.at_least(0.9)

    for before, after in pairwise(STAGES):
        later = {r.key.seed: r for r in results.get((after, STT), [])}
        earlier = results.get((before, STT), [])
        pairs = [(r, later[r.key.seed]) for r in earlier if r.key.seed in later]
        claim = f"first of {after} is last of {before}"
        yield verdict("7", claim, "ratio ≥ 0.9 on common terms", continues, pairs)

    def helps(stt: Sequence[Result], scratch: Sequence[Result]) -> tuple[str, str]:
        # Areas under the curves: each run's mean return over its steps.
        a, b = (
            np.array([np.trapezoid(r.curve["return"], r.curve["step"]) / (r.curve["step"][-1] or 1)
                      for r in runs])
            for runs in (stt, scratch)
        )  # fmt: skip
        p = probability_of_improvement(a, b)
        return f"areas {a.mean():.4g} and {b.mean():.4g}, P {p}", p.at_least(0.75)

    def is_quicker(stt: Sequence[Result], scratch: Sequence[Result]) -> tuple[str, str]:
        medians = [float(np.median([_steps_to(r, 0.9) for r in runs])) for runs in (stt, scratch)]
        a, b = (f"{m:,.0f} steps" if np.isfinite(m) else "never" for m in medians)
        share = _share_of_steps(stt, scratch)
        limits = f"{share.low:.2g} … {share.high:.2g}"
        return f"{a} against {b} (medians), ratio {limits}", share.at_most(0.5)

    for scenario in STAGES[1:]:
        both = [results.get((scenario, way)) for way in (STT, "scratch-masac")]
        wanted = "area under the curve: P(improvement) ≥ 0.75"
        yield verdict("7", f"STT helps in {scenario}", wanted, helps, *both)
        wanted = "half the episodes to 0.9 of the scripted return"
        yield verdict("7", f"STT is quicker in {scenario}", wanted, is_quicker, *both)


def _figure_8(results: Results) -> Iterator[Verdict]:
    def tracks(runs: Sequence[Result]) -> tuple[str, str]:
        n = numbers_of(runs)
        decision = together(
            n["track"].at_least(0.95), n["dist"].at_least(0.38), n["dist"].at_most(0.9),
            n["viol"].at_most(0.01), n["clean"].at_least(0.9),
        )  # fmt: skip
        measured = ", ".join(f"{k} {n[k]}" for k in ("track", "dist", "viol", "clean"))
        return f"{measured}, return {n['share']} scripted", decision

    wanted = "track ≥ 0.95, dist in [0.38, 0.9] m, viol ≤ 1 %, clean ≥ 0.9"
    claim = "two trackers track among obstacles"
    yield verdict("8", claim, wanted, tracks, results.get(("target", STT)))
    if ("careful", STT) in results:
        claim += ", when they have learned to be careful"
        yield verdict("8", claim, wanted, tracks, results["careful", STT])


def _figure_9(results: Results) -> Iterator[Verdict]:
    """Compare MASAC with other algorithms after the same schooling, and all without any."""

    def compares(ours: Sequence[Result], theirs: Sequence[Result]) -> tuple[str, Decision]:
        a, b = (np.array([r.returns.mean() for r in runs]) for runs in (ours, theirs))
        p, x, y = probability_of_improvement(a, b), _returns(ours), _returns(theirs)
        return f"P {p}; returns {x} and {y}", together(p.at_least(0.9), x.above(y))

    for schooled in (True, False):
        how = "after the schooling" if schooled else "without schooling, all steps in target"
        for other in ("ippo", "idqn", "isac", "mappo"):
            ways = [f"stt-{a}" if schooled else f"scratch-{a}-all_steps" for a in ("masac", other)]
            decided = other in ("ippo", "idqn")
            row = verdict(
                "9", f"MASAC beats {other.upper()} in target, both {how}",
                "P(improvement) ≥ 0.9, intervals apart" if decided else "reported",
                compares, *(results.get(("target", way)) for way in ways),
            )  # fmt: skip
            yield row if decided or not row.seeds else replace(row, decision="reported")


def _success(results: Results) -> Iterator[Verdict]:
    def compares(two: Sequence[Result], other: Sequence[Result]) -> tuple[str, str]:
        a, b = (np.array([(r.metrics["track"] >= 0.9).mean() for r in x]) for x in (two, other))
        p = probability_of_improvement(a, b)
        return f"success {a.mean():.3g} and {b.mean():.3g}, P {p}", p.at_least(0.9)

    two, one, three = (results.get(("target", f"{STT}{x}")) for x in ("", "-one", "-three"))
    claim = "two trackers succeed more often than one"
    yield verdict("success", claim, "P(improvement) ≥ 0.9", compares, two, one)
    row = verdict("success", "two trackers against three", "reported", compares, two, three)
    yield replace(row, decision="reported") if row.seeds else row


def _cost(results: Results) -> tuple[str, str]:
    before = {r.key: float(r.about["cpu"]) for r in results.get(("target", STT), [])}

    def cost(run: Result) -> float:  # of the target scenario, both times together
        again = replace(run.key, scenario="target")
        more = before.get(again, 0.0) if run.key.scenario == "careful" else 0.0
        return float(run.about["cpu"]) + more

    worst = max((r for runs in results.values() for r in runs), key=cost)
    seconds = cost(worst)
    measured = f"at most {seconds:.0f} CPU s ({worst.key.scenario}, {worst.key.way})"
    return measured, HOLDS if seconds <= 600 else HOLDS_NOT  # of the runs themselves: no interval


# ---- numbers of runs ----------------------------------------------------------------------


def numbers_of(runs: Sequence[Result]) -> dict[str, Interval]:
    """Return the means of runs by name; "share" is the return divided by the scripted one."""
    metrics = {k: _mean_of(runs, k) for k in ("track", "dist", "viol")}
    clean = _mean(np.stack([(r.metrics["clean"] == 1.0).astype(float) for r in runs]))
    return {"return": _returns(runs), "share": _share(runs), **metrics, "clean": clean}


def _mean(values: NDArray[np.float64]) -> Interval:
    """Return the mean: an interquartile mean would leave out the failed episodes."""
    return interval(values, lambda x: float(x.mean()), draws=1000)


def _mean_of(runs: Sequence[Result], metric: str) -> Interval:
    return _mean(np.stack([r.metrics[metric] for r in runs]))


def _returns(runs: Sequence[Result]) -> Interval:
    return interval(np.stack([r.returns for r in runs]), draws=1000)


def _share(runs: Sequence[Result]) -> Interval:
    """Return the return divided by that of the scripted controller."""
    scripted = float(runs[0].scripted.mean())
    return _mean(np.stack([r.returns / scripted for r in runs]))


def _steps_to(run: Result, share: float) -> float:
    """Return the steps until a share of the scripted return is reached; inf if it never is."""
    wanted = share * float(run.scripted.mean())
    reached = run.curve["return"] >= wanted
    return float(run.curve["step"][int(np.argmax(reached))]) if reached.any() else float("inf")


def _share_of_steps(x: Sequence[Result], y: Sequence[Result], draws: int = 2000) -> Interval:
    """Return the ratio of the medians of `_steps_to` with its 95 % bootstrap interval.

    A run that never reaches the return would need more steps than it had, by an unknown number. The
    interval covers all possible numbers.
    """
    found = []
    for runs in (x, y):
        steps = np.array([_steps_to(r, 0.9) for r in runs])
        ends = np.array([float(r.curve["step"][-1]) for r in runs])
        found.append((np.where(np.isfinite(steps), steps, ends), steps))  # at least, at most
    random = np.random.default_rng(0)
    low, high = np.empty(draws), np.empty(draws)
    for k in range(draws):
        (a_low, a_high), (b_low, b_high) = (
            [float(np.median(v[rows])) for v in both]
            for both in found
            for rows in [random.integers(0, len(both[0]), len(both[0]))]
        )
        low[k], high[k] = _over(a_low, b_high), _over(a_high, b_low)
    value = _over(*(float(np.median(steps)) for _, steps in found))
    return Interval(
        value,
        float(np.quantile(low, 0.025, method="lower")),
        float(np.quantile(high, 0.975, method="higher")),
    )


def _over(a: float, b: float) -> float:
    """Return a / b; equal numbers give 1, also if both are 0 or both unknown."""
    if a == b:
        return 1.0
    return a / b if b > 0 else float("inf")


# ---- figure 11: policies learned from data against their teacher, and in the pool -----------


AS_IT_IS, ANTICIPATED = "as it is", "anticipated"


@dataclass(frozen=True)
class Cell:
    """A way under a condition: the results of all its seeds; its length is their number."""

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
        track = _mean_at_once(np.stack([r.track[place][:least] for r in runs]))
        viol, clean = (
            float(np.mean([r.means[place][name] for r in runs])) for name in ("viol", "clean")
        )
        cells[(way, *place)] = Cell(values, _mean_at_once(values), track, viol, clean)
    return cells


def _mean_at_once(values: NDArray[np.float64], draws: int = 500) -> Interval:
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
