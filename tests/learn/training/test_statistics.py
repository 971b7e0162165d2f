"""Statistics of seeds against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import trim_mean

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.training.statistics import (
    Interval,
    interquartile_mean,
    interval,
    probability_of_improvement,
    ratio,
    together,
)


def test_the_interquartile_mean_is_the_mean_of_the_middle_half() -> None:
    assert interquartile_mean(np.arange(8.0)) == pytest.approx(np.mean([2, 3, 4, 5]))


@settings(deadline=None)
@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40))
def test_it_equals_scipys_trimmed_mean_of_each_value_four_times(values: list[float]) -> None:
    expected = trim_mean(np.repeat(values, 4), 0.25)
    assert interquartile_mean(np.array(values)) == pytest.approx(expected, rel=1e-9, abs=1e-6)


def test_an_outlier_does_not_move_it() -> None:
    values = np.r_[np.zeros(9), 1e9]
    assert interquartile_mean(values) == 0.0


def test_ninety_five_percent_of_intervals_of_a_mean_contain_it() -> None:
    random = np.random.default_rng(0)
    hits = 0
    for k in range(100):
        drawn = random.normal(3.0, 1.0, (1, 60))
        i = interval(drawn, lambda v: float(v.mean()), draws=200, seed=k)
        hits += i.low <= 3.0 <= i.high
    assert 88 <= hits <= 99


def test_improvement_of_disjoint_values_is_sure_and_of_equal_ones_a_half() -> None:
    assert probability_of_improvement(np.arange(5) + 10, np.arange(5), draws=50).value == 1.0
    assert probability_of_improvement(np.ones(5), np.ones(4), draws=50).value == 0.5


def test_no_values_are_refused() -> None:
    with pytest.raises(InputInvalid, match="at least one"):
        interquartile_mean(np.array([]))


@pytest.mark.parametrize(
    ("low", "high", "least", "most"),
    [
        (1.0, 2.0, "holds", "cannot be decided"),
        (0.5, 0.9, "does not hold", "holds"),
        (0.5, 1.0, "cannot be decided", "holds"),
        (1.1, 2.0, "holds", "does not hold"),
    ],
)
def test_a_limit_is_judged_by_the_whole_interval(
    low: float, high: float, least: str, most: str
) -> None:
    for value in (low, high):  # whichever side of the limit it is on
        i = Interval(value, low, high)
        assert i.at_least(1.0) == least
        assert i.at_most(1.0) == most


def test_greater_is_who_has_an_interval_apart() -> None:
    low, high, wide = Interval(1, 0, 2), Interval(4, 3, 5), Interval(2, 1, 4)
    assert high.above(low) == "holds"
    assert low.above(high) == "does not hold"
    assert wide.above(low) == low.above(wide) == wide.above(high) == "cannot be decided"


def test_one_claim_that_does_not_hold_refutes_all_and_an_open_one_leaves_them_open() -> None:
    assert together("holds", "holds") == "holds"
    assert together("holds", "cannot be decided") == "cannot be decided"
    assert together("cannot be decided", "does not hold", "holds") == "does not hold"


def test_a_ratio_has_the_spread_of_what_differs_alone() -> None:
    """With y = x / 2 in each episode and the same seeds, nothing is left to chance."""
    x = np.random.default_rng(0).normal(10.0, 3.0, (5, 40)) + np.arange(5)[:, None]
    same = ratio(x, x / 2, same=True, draws=200)
    assert (same.low, same.high) == pytest.approx((2.0, 2.0))
    apart = ratio(x, x / 2, draws=200)
    assert apart.value == pytest.approx(2.0)
    assert apart.low < 1.9
    assert apart.high > 2.1


def test_ninety_five_percent_of_intervals_of_a_ratio_contain_it() -> None:
    random, hits = np.random.default_rng(1), 0
    for k in range(100):
        x, y = random.normal(9.0, 1.0, (1, 60)), random.normal(3.0, 1.0, (1, 60))
        i = ratio(x, y, draws=200, seed=k)
        hits += i.low <= 3.0 <= i.high
    assert 88 <= hits <= 99


def test_the_same_seeds_are_as_many() -> None:
    with pytest.raises(InputInvalid, match="5 and 4 seeds; expected the same ones"):
        ratio(np.ones((5, 3)), np.ones((4, 3)), same=True)
