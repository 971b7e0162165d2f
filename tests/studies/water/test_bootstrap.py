"""Intervals of prediction errors, and verdicts that they carry."""

from __future__ import annotations

from math import isnan

import numpy as np
import pytest

from uuvsim_cosim.studies.water.bootstrap import compare, root_mean_square

BLOCKS = np.repeat(np.arange(40), 10)
NOISE = np.random.default_rng(1).normal(size=(2, 400))


def test_smaller_errors_are_better_and_larger_ones_worse() -> None:
    assert compare(0.5 * NOISE[0], NOISE[1], BLOCKS).verdict == "better"
    assert compare(NOISE[1], 0.5 * NOISE[0], BLOCKS).verdict == "worse"


def test_of_pairs_of_the_same_size_about_95_of_100_are_not_decided() -> None:
    pairs = np.random.default_rng(2).normal(size=(300, 2, 400))
    said = [compare(one, other, BLOCKS).verdict for one, other in pairs]
    assert 0.90 < said.count("cannot be decided") / len(said) < 0.99


def test_few_blocks_decide_nothing() -> None:
    ratio = compare(0.1 * NOISE[0], NOISE[1], BLOCKS % 7)
    assert ratio.value == pytest.approx(0.1, rel=0.2)
    assert isnan(ratio.low)
    assert ratio.verdict == "cannot be decided"


def test_errors_that_are_equal_within_a_block_widen_the_interval() -> None:
    equal = np.repeat(NOISE[0][:40], 10)
    one, other = (root_mean_square(e, BLOCKS) for e in (equal, NOISE[0]))
    assert one.high - one.low > 2.0 * (other.high - other.low)


def test_an_error_that_is_no_number_counts_as_a_large_one() -> None:
    errors = NOISE[0].copy()
    errors[3] = np.nan
    assert root_mean_square(errors, BLOCKS).value > 1e4
