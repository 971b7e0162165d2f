"""Statistics of seeds against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import trim_mean

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.learn.statistics import (
    interquartile_mean,
    interval,
    probability_of_improvement,
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
