import math

import numpy as np
import pytest

from uuvsim_cosim.studies.intervals import interval, rank_correlation


def test_an_interval_of_a_normal_is_as_wide_as_students() -> None:
    x = np.random.default_rng(3).normal(5.0, 2.0, 400)
    found = interval(x)
    wide = 1.96 * x.std(ddof=1) / 20
    assert found.mean == pytest.approx(x.mean())
    assert found.high - found.low == pytest.approx(2 * wide, rel=0.08)


def test_intervals_hold_the_mean_in_about_95_of_100_samples() -> None:
    rng = np.random.default_rng(5)
    held = [
        i.low <= 1.0 <= i.high for i in (interval(rng.exponential(1.0, 60)) for _ in range(200))
    ]
    assert 0.88 <= np.mean(held) <= 0.99


def test_an_interval_does_not_depend_on_the_order_of_runs() -> None:
    x = np.random.default_rng(1).normal(size=30)
    assert interval(x) == interval(x[::-1])


def test_failed_runs_are_left_out_and_one_run_has_no_interval() -> None:
    assert interval([1.0, math.nan, 3.0]).n == 2
    assert math.isnan(interval([1.0]).low)
    assert interval([]).n == 0


def test_differences_between_grid_points_do_not_count_as_correlation() -> None:
    x = np.arange(40.0)
    point = np.repeat([0, 1], 20)
    assert rank_correlation(x, x**3, point) == pytest.approx(1.0)
    apart = np.where(point == 0, 0.0, 1000.0) - x
    assert rank_correlation(x, apart, point) == pytest.approx(-1.0)
    assert math.isnan(rank_correlation(x, np.ones(40), point))
