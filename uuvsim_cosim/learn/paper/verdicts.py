"""Verdicts on each claim: it holds, it does not hold, or it cannot be decided.

A verdict follows from the 95 % interval of the measured figure, not from its value: a claim holds
if the whole interval keeps the limit, does not hold if no part does, and is undecided otherwise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.learn.paper.results import Result
from uuvsim_cosim.learn.training.statistics import (
    HOLDS,
    HOLDS_NOT,
    UNDECIDED,
    Interval,
    interval,
    probability_of_improvement,
    together,
)

__all__ = ["SEEDS", "Verdict", "numbers_of", "verdicts"]

SEEDS = 5  # that a verdict needs
Results = Mapping[tuple[str, str], Sequence[Result]]
STAGES = ("source", "transition_1", "transition_2", "target")
STT = "stt-masac"


@dataclass(frozen=True)
class Verdict:
    """One row of the table; `said` is one of `Said`, "reported" or "not yet run"."""

    figure: str
    claim: str
    wanted: str
    measured: str
    said: str
    seeds: int  # that it is of

    @property
    def text(self) -> str:
        """Return the verdict in words; fewer than five seeds decide nothing."""
        if not self.seeds:
            return "not yet run"
        if self.seeds >= SEEDS:
            return self.said
        few = f"{self.seeds} of {SEEDS} seeds"
        if self.said in ("reported", UNDECIDED):
            return f"{self.said} ({few})"
        return f"{UNDECIDED} ({few}; so far: {self.said})"


def verdicts(results: Results) -> list[Verdict]:
    """Judge every claim, except those of figure 11 (see `transfer_verdicts`)."""
    rows = [_source(results), *_continuity(results)]
    for scenario in STAGES[1:]:
        rows += [_helps(results, scenario), _half(results, scenario)]
    rows += [_figure_8(results, "target")]
    rows += [_figure_8(results, "careful")] if ("careful", STT) in results else []
    for schooled in (True, False):
        rows += [_beats(results, a, schooled) for a in ("ippo", "idqn", "isac", "mappo")]
    return [*rows, *_teams(results), _cost(results)]


# ---- one claim each -----------------------------------------------------------------------


def _source(results: Results) -> Verdict:
    wanted = "track ≥ 0.95, return ≥ 0.9 scripted; 90 % of its last value by 30 % of the episodes"
    runs = results.get(("source", STT), [])
    if not runs:
        return _missing("7", "source converges", wanted)
    track, share = _metric(runs, "track"), _share(runs)
    early = interval(np.array([[_reaches_last(r)] for r in runs]))
    judged = together(track.at_least(0.95), share.at_least(0.9), early.at_most(0.3))
    measured = f"track {track}, return {share} of scripted, after {early} of the episodes"
    return Verdict("7", "source converges", wanted, measured, judged, len(runs))


def _continuity(results: Results) -> list[Verdict]:
    rows = []
    for before, after in pairwise(STAGES):
        claim, wanted = f"first of {after} is last of {before}", "ratio ≥ 0.9 on common terms"
        later = {r.key.seed: r for r in results.get((after, STT), [])}
        earlier = results.get((before, STT), [])
        pairs = [(r, later[r.key.seed]) for r in earlier if r.key.seed in later]
        if not pairs:
            rows.append(_missing("7", claim, wanted))
            continue
        ratios = np.array([[_common(b, 0) / _common(a, -1)] for a, b in pairs])
        found = interval(ratios)
        rows.append(Verdict("7", claim, wanted, str(found), found.at_least(0.9), len(pairs)))
    return rows


def _helps(results: Results, scenario: str) -> Verdict:
    claim, wanted = f"STT helps in {scenario}", "area under the curve: P(improvement) ≥ 0.75"
    stt, scratch = _two(results, scenario, STT, "scratch-masac")
    if not stt or not scratch:
        return _missing("7", claim, wanted)
    p = probability_of_improvement(_areas(stt), _areas(scratch))
    means = f"areas {_areas(stt).mean():.4g} and {_areas(scratch).mean():.4g}, P {p}"
    seeds = min(len(stt), len(scratch))
    return Verdict("7", claim, wanted, means, p.at_least(0.75), seeds)


def _half(results: Results, scenario: str) -> Verdict:
    claim = f"STT is quicker in {scenario}"
    wanted = "half the episodes to 0.9 of the scripted return"
    stt, scratch = _two(results, scenario, STT, "scratch-masac")
    if not stt or not scratch:
        return _missing("7", claim, wanted)
    a, b = (float(np.median([_steps_to(r, 0.9) for r in runs])) for runs in (stt, scratch))
    share = _share_of_steps(stt, scratch)
    limits = f"{share.low:.2g} … {share.high:.2g}"
    measured = f"{_steps(a)} against {_steps(b)} (medians), ratio {limits}"
    seeds = min(len(stt), len(scratch))
    return Verdict("7", claim, wanted, measured, share.at_most(0.5), seeds)


def _figure_8(results: Results, scenario: str) -> Verdict:
    wanted = "track ≥ 0.95, dist in [0.38, 0.9] m, viol ≤ 1 %, clean ≥ 0.9"
    claim = "two trackers track among obstacles"
    if scenario == "careful":
        claim += ", when they have learned to be careful"
    runs = results.get((scenario, STT), [])
    if not runs:
        return _missing("8", claim, wanted)
    track, dist, viol = (_metric(runs, k) for k in ("track", "dist", "viol"))
    clean = _clean(runs)
    judged = together(
        track.at_least(0.95), dist.at_least(0.38), dist.at_most(0.9), viol.at_most(0.01),
        clean.at_least(0.9),
    )  # fmt: skip
    measured = (
        f"track {track}, dist {dist}, viol {viol}, clean {clean}, return {_share(runs)} scripted"
    )
    return Verdict("8", claim, wanted, measured, judged, len(runs))


def _beats(results: Results, algorithm: str, schooled: bool) -> Verdict:
    """Compare MASAC with another algorithm after the same schooling, or both without any."""
    judged = algorithm in ("ippo", "idqn")
    how = "both after the schooling" if schooled else "both without schooling, all steps in target"
    claim = f"MASAC beats {algorithm.upper()} in target, {how}"
    wanted = "P(improvement) ≥ 0.9, intervals apart" if judged else "reported"
    ways = [f"stt-{a}" if schooled else f"scratch-{a}-all_steps" for a in ("masac", algorithm)]
    ours, theirs = _two(results, "target", *ways)
    if not ours or not theirs:
        return _missing("9", claim, wanted)
    a, b = (np.array([r.returns.mean() for r in runs]) for runs in (ours, theirs))
    p, x, y = probability_of_improvement(a, b), _returns(ours), _returns(theirs)
    measured = f"P {p}; returns {x} and {y}"
    decided = together(p.at_least(0.9), x.above(y)) if judged else "reported"
    return Verdict("9", claim, wanted, measured, decided, min(len(ours), len(theirs)))


def _teams(results: Results) -> list[Verdict]:
    two = results.get(("target", STT), [])
    rows = []
    for label, words, wanted in (
        ("one", "two trackers succeed more often than one", "P(improvement) ≥ 0.9"),
        ("three", "two trackers against three", "reported"),
    ):
        other = results.get(("target", f"stt-masac-{label}"), [])
        if not two or not other:
            rows.append(_missing("success", words, wanted))
            continue
        a, b = (np.array([(r.metrics["track"] >= 0.9).mean() for r in x]) for x in (two, other))
        p = probability_of_improvement(a, b)
        measured = f"success {a.mean():.3g} and {b.mean():.3g}, P {p}"
        decided = "reported" if wanted == "reported" else p.at_least(0.9)
        seeds = min(len(two), len(other))
        rows.append(Verdict("success", words, wanted, measured, decided, seeds))
    return rows


def _cost(results: Results) -> Verdict:
    wanted = "at most 10 CPU minutes a seed and scenario"
    every = [r for runs in results.values() for r in runs]
    if not every:
        return _missing("all", "the cost", wanted)
    before = {r.key: _cpu(r) for r in results.get(("target", STT), [])}

    def cost(run: Result) -> float:  # of the target scenario, both times together
        again = replace(run.key, scenario="target")
        return _cpu(run) + (before.get(again, 0.0) if run.key.scenario == "careful" else 0.0)

    worst = max(every, key=cost)
    seconds = cost(worst)
    measured = f"at most {seconds:.0f} CPU s ({worst.key.scenario}, {worst.key.way})"
    seeds = max(len(runs) for runs in results.values())
    decided = HOLDS if seconds <= 600 else HOLDS_NOT  # of the runs themselves: no interval
    return Verdict("all", "the cost", wanted, measured, decided, seeds)


def _cpu(run: Result) -> float:
    return float(run.about["cpu"])


def numbers_of(runs: Sequence[Result]) -> dict[str, Interval]:
    """Return return, return over the scripted one, track, dist [m], viol and clean of seeds."""
    metrics = {k: _metric(runs, k) for k in ("track", "dist", "viol")}
    return {"return": _returns(runs), "share": _share(runs), **metrics, "clean": _clean(runs)}


# ---- numbers of runs ----------------------------------------------------------------------


def _metric(runs: Sequence[Result], name: str) -> Interval:
    """Return the mean: an interquartile mean would leave out the failed episodes."""
    return interval(np.stack([r.metrics[name] for r in runs]), _mean, draws=1000)


def _clean(runs: Sequence[Result]) -> Interval:
    values = np.stack([(r.metrics["clean"] == 1.0).astype(float) for r in runs])
    return interval(values, _mean, draws=1000)


def _returns(runs: Sequence[Result]) -> Interval:
    return interval(np.stack([r.returns for r in runs]), draws=1000)


def _share(runs: Sequence[Result]) -> Interval:
    """Return the return divided by that of the scripted controller."""
    scripted = float(runs[0].scripted.mean())
    return interval(np.stack([r.returns / scripted for r in runs]), _mean, draws=1000)


def _mean(values: NDArray[np.float64]) -> float:
    return float(values.mean())


def _common(run: Result, row: int) -> float:
    """Return w_t r_t + w_a r_a + w_p p_2 of an evaluation, a step."""
    return float(sum(run.curve[k][row] for k in ("r_t", "r_a", "p_2")))


def _areas(runs: Sequence[Result]) -> NDArray[np.float64]:
    """Return each run's mean return over its steps."""
    return np.array([
        np.trapezoid(r.curve["return"], r.curve["step"]) / (r.curve["step"][-1] or 1.0)
        for r in runs
    ])  # fmt: skip


def _reaches_last(run: Result) -> float:
    """Return the share of the episodes after which 90 % of the rise to the last value is made."""
    curve = run.curve["return"]
    wanted = curve[0] + 0.9 * (curve[-1] - curve[0])
    at = int(np.argmax(curve >= wanted))
    return float(run.curve["step"][at] / run.curve["step"][-1])


def _steps_to(run: Result, share: float) -> float:
    """Return the steps after which the scripted return's share is reached; inf if it never is."""
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
    """Return a / b; of equal numbers 1, also where both are 0 or both unknown."""
    if a == b:
        return 1.0
    return a / b if b > 0 else float("inf")


def _steps(number: float) -> str:
    return f"{number:,.0f} steps" if np.isfinite(number) else "never"


def _two(results: Results, scenario: str, *ways: str) -> tuple[Sequence[Result], Sequence[Result]]:
    a, b = (results.get((scenario, way), []) for way in ways)
    return a, b


def _missing(figure: str, claim: str, wanted: str) -> Verdict:
    return Verdict(figure, claim, wanted, "", "not yet run", 0)
