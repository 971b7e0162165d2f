from typing import Any

import numpy as np
import pytest
from scipy import stats

from uuvsim_cosim.envs.randomisation.distributions import (
    Choice,
    Constant,
    Distribution,
    LogUniform,
    Normal,
    Triangular,
    Uniform,
)
from uuvsim_cosim.errors import InputInvalid

U = np.array([1e-12, 0.001, 0.2, 0.5, 0.77, 0.999, 1 - 1e-12])
KNOWN: list[tuple[Distribution, Any]] = [
    (Uniform(-1.0, 3.0), stats.uniform(-1, 4)),
    (LogUniform(0.1, 10.0), stats.loguniform(0.1, 10)),
    (Normal(2.0, 0.5), stats.norm(2, 0.5)),
    (Normal(2.0, 0.5, min=1.5, max=2.2), stats.truncnorm(-1, 0.4, 2, 0.5)),
    (Normal(0.0, 1.0, min=5.0), stats.truncnorm(5, np.inf)),
    (Triangular(1.0, 1.5, 4.0), stats.triang(0.5 / 3, 1, 3)),
]


@pytest.mark.parametrize(("ours", "theirs"), KNOWN)
def test_quantiles_are_those_of_scipy(ours: Distribution, theirs: Any) -> None:
    np.testing.assert_allclose(ours.quantile(U), theirs.ppf(U), rtol=1e-9)


@pytest.mark.parametrize("ours", [d for d, _ in KNOWN] + [Choice([3, 1, 2]), Constant(4)])
def test_quantiles_keep_to_the_limits_and_never_fall_but_for_choices(ours: Distribution) -> None:
    u = (np.arange(5000) + 0.5) / 5000
    values = ours.quantile(u)
    low, high = ours.limits
    assert values.min() >= low
    assert values.max() <= high
    assert isinstance(ours, Choice) or (np.diff(values) >= 0).all()


@pytest.mark.parametrize("ours", [d for d, _ in KNOWN])
def test_a_value_has_the_same_bits_alone_and_among_others(ours: Distribution) -> None:
    u = np.random.default_rng(1).uniform(size=1001)
    whole = ours.quantile(u)
    for i in (0, 1, 7, 500, 1000):
        assert ours.quantile(u[i : i + 1])[0] == whole[i]


def test_choices_come_as_often_as_their_weights_say() -> None:
    drawn = Choice([1, 2, 4], [1, 0, 3]).quantile((np.arange(400) + 0.5) / 400)
    assert [(drawn == v).sum() for v in (1, 2, 4)] == [100, 0, 300]


def test_a_choice_of_vectors_chooses_all_elements_at_once() -> None:
    choice = Choice([[1, 10], [2, 20]])
    assert choice.joint
    assert choice.size == 2
    np.testing.assert_array_equal(choice.element(1).quantile(np.array([0.1, 0.9])), [10, 20])


def test_fields_of_one_number_each_element_give_that_elements_distribution() -> None:
    both = Uniform([0.0, 1.0], [1.0, 5.0])
    assert both.size == 2
    assert both.element(1) == Uniform(1.0, 5.0)


def test_a_normal_without_limits_has_a_range_of_three_deviations() -> None:
    assert Normal(1.0, 2.0).range == (-5.0, 7.0)
    assert Normal(1.0, 2.0, min=0.0).range == (0.0, 7.0)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Uniform(2, 1), "low not above high"),
        (lambda: LogUniform(0, 1), "low above 0"),
        (lambda: Normal(0, -1), "std of at least 0"),
        (lambda: Normal(0, 1, min=50), "more than a billionth"),
        (lambda: Triangular(0, 3, 2), "low <= mode <= high"),
        (lambda: Choice([]), "expected finite numbers"),
        (lambda: Choice([1, 2], [1]), "expected 2 numbers"),
        (lambda: Uniform("a", 1), "expected a finite number"),
        (lambda: Constant(float("nan")), "expected a finite number"),
        (lambda: Uniform([1, 2], [3, 4, 5]), "could not be broadcast|different lengths"),
    ],
)
def test_a_distribution_that_is_none_is_refused(make: Any, says: str) -> None:
    with pytest.raises(InputInvalid, match=says):
        make()


def test_a_grid_of_a_million_values_is_ready_at_once() -> None:
    n = 1_000_000
    values = Choice(np.arange(float(n))).quantile((np.arange(n) + 0.5) / n)
    assert np.array_equal(values, np.arange(float(n)))
