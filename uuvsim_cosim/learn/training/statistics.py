"""Statistics over seeds: interquartile means, bootstrap intervals, probability of improvement.

Agarwal et al., "Deep Reinforcement Learning at the Edge of the Statistical Precipice", 2021.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid

__all__ = [
    "HOLDS",
    "HOLDS_NOT",
    "UNDECIDED",
    "Decision",
    "Interval",
    "interquartile_mean",
    "interval",
    "probability_of_improvement",
    "ratio",
    "together",
]

Array = NDArray[np.float64]
Decision = Literal["holds", "does not hold", "cannot be decided"]
HOLDS: Decision = "holds"
HOLDS_NOT: Decision = "does not hold"
UNDECIDED: Decision = "cannot be decided"


@dataclass(frozen=True)
class Interval:
    """Value with its 95 % bootstrap interval."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        """Return the text "0.95 [0.93, 0.97]"."""
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"

    def at_least(self, limit: float) -> Decision:
        """Decide whether the value is at least `limit`: only if the whole interval agrees."""
        return HOLDS if self.low >= limit else HOLDS_NOT if self.high < limit else UNDECIDED

    def at_most(self, limit: float) -> Decision:
        """Decide whether the value is at most `limit`: only if the whole interval agrees."""
        return HOLDS if self.high <= limit else HOLDS_NOT if self.low > limit else UNDECIDED

    def above(self, other: Interval) -> Decision:
        """Decide whether this value is greater: only if the intervals do not overlap."""
        return HOLDS if self.low > other.high else HOLDS_NOT if self.high < other.low else UNDECIDED


def together(*verdicts: Decision) -> Decision:
    """Decide whether all claims hold: one false claim decides, else one undecided claim."""
    return next((verdict for verdict in (HOLDS_NOT, UNDECIDED) if verdict in verdicts), HOLDS)


def interquartile_mean(values: Array) -> float:
    """Return the mean of the middle half of the values; values at the quartiles count partly."""
    ordered = np.sort(np.ravel(values))
    n = len(ordered)
    if not n:
        raise InputInvalid("interquartile mean of no values", "at least one")
    # Value k stands for the share [k/n, (k+1)/n]; its part in [1/4, 3/4] is its weight.
    edges = np.clip(np.arange(n + 1) / n, 0.25, 0.75)
    return float(np.diff(edges) @ ordered * 2.0)


def interval(
    values: Array,
    figure: Callable[[Array], float] = interquartile_mean,
    *,
    draws: int = 2000,
    seed: int = 0,
) -> Interval:
    """Return `figure` of values (seeds, episodes) with its 95 % stratified bootstrap interval.

    Seeds are resampled, and within each seed its episodes.
    """
    values = np.atleast_2d(np.asarray(values, float))
    random = np.random.default_rng(seed)
    seeds, episodes = values.shape
    figures = np.empty(draws)
    for k in range(draws):
        rows = random.integers(0, seeds, seeds)
        columns = random.integers(0, episodes, (seeds, episodes))
        figures[k] = figure(np.take_along_axis(values[rows], columns, 1))
    low, high = np.quantile(figures, [0.025, 0.975])
    return Interval(figure(values), float(low), float(high))


def probability_of_improvement(x: Array, y: Array, *, draws: int = 2000, seed: int = 0) -> Interval:
    """Return the probability that a value of x is greater than a value of y; ties count half."""
    x, y = np.ravel(np.asarray(x, float)), np.ravel(np.asarray(y, float))
    if not len(x) or not len(y):
        raise InputInvalid("probability of improvement of no values", "at least one each")
    random = np.random.default_rng(seed)

    def share(a: Array, b: Array) -> float:
        higher, equal = np.greater.outer(a, b), np.equal.outer(a, b)
        return float(higher.mean() + 0.5 * equal.mean())

    drawn = [share(random.choice(x, len(x)), random.choice(y, len(y))) for _ in range(draws)]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Interval(share(x, y), float(low), float(high))


def ratio(x: Array, y: Array, *, same: bool = False, draws: int = 2000, seed: int = 0) -> Interval:
    """Return mean(x) / mean(y) of values (seeds, episodes), with its 95 % bootstrap interval.

    Episode k of both is the same, so the same episodes are resampled for both. With `same`, the
    seeds of both are the same, too, for example those of one policy under two conditions.
    """
    x, y = (np.atleast_2d(np.asarray(v, float)) for v in (x, y))
    least = min(x.shape[1], y.shape[1])
    x, y = x[:, :least], y[:, :least]
    if same and len(x) != len(y):
        raise InputInvalid("ratio", f"{len(x)} and {len(y)} seeds", "the same ones")
    random = np.random.default_rng(seed)
    figures = np.empty(draws)
    for k in range(draws):
        rows = [random.integers(0, len(v), len(v)) for v in (x, y)]
        columns = random.integers(0, least, (max(len(x), len(y)), least))
        means = [
            np.take_along_axis(v[rows[0 if same else i]], columns[: len(v)], 1).mean()
            for i, v in enumerate((x, y))
        ]
        figures[k] = means[0] / means[1]
    low, high = np.quantile(figures, [0.025, 0.975])
    return Interval(float(x.mean() / y.mean()), float(low), float(high))
