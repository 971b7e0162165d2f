"""Filter of the difference between a measured depth and that of a glide."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.studies.water.depth_filter import DepthFilter, filter_with_least_errors

FILTER = DepthFilter(tau=20.0, ratio=0.1)


def moving_water(tau: float, noise: float) -> np.ndarray:
    """Return the difference of 4000 s in water whose vertical speed has this decay time."""
    rng = np.random.default_rng(1)
    b, z, found = 0.0, 0.0, []
    for force in rng.normal(size=4000):
        found.append(z)
        z += b
        b = b * np.exp(-1.0 / tau) + 0.01 * force
    return np.array(found) + noise * rng.normal(size=4000)


def test_a_constant_rate_is_found_and_decays_over_the_horizon() -> None:
    z = 3.0 + 0.05 * np.arange(100.0)
    found, rate = DepthFilter(1e6, 0.1).estimates(z, 1.0, ((0, 99),))
    assert rate[99] == pytest.approx(0.05, rel=1e-3)
    assert found[99] == pytest.approx(z[99], rel=1e-3)
    far = FILTER.ahead(found[99], rate[99], 1e6) - found[99]
    assert far == pytest.approx(20.0 * rate[99])


def test_an_estimate_uses_no_later_measurement() -> None:
    z = moving_water(20.0, 0.05)[:200]
    later = np.where(np.arange(200) > 120, z + 1.0, z)
    one, two = (FILTER.estimates(y, 1.0, ((0, 199),)) for y in (z, later))
    assert np.array_equal(np.array(one)[:, :121], np.array(two)[:, :121])


def test_a_run_knows_nothing_of_the_run_before() -> None:
    z = moving_water(20.0, 0.05)[:200]
    whole = FILTER.estimates(z, 1.0, ((0, 99), (100, 199)))
    alone = FILTER.estimates(z[100:], 1.0, ((0, 99),))
    assert np.array_equal(np.array(whole)[:, 100:], np.array(alone))


def test_a_gap_is_bridged_by_the_rate() -> None:
    z = 0.05 * np.arange(100.0)
    z[60:70] = np.nan
    found, rate = DepthFilter(1e6, 0.1).estimates(z, 1.0, ((0, 99),))
    assert found[69] == pytest.approx(0.05 * 69, rel=1e-3)
    assert np.isfinite(rate).all()


@pytest.mark.parametrize("tau", [5.0, 40.0])
def test_the_decay_of_the_water_is_found(tau: float) -> None:
    z = moving_water(tau, 0.02)
    found = filter_with_least_errors(z, 1.0, ((0, 3999),), (1.0, 5.0, 10.0))
    assert tau / 2 <= found.tau <= 2 * tau
