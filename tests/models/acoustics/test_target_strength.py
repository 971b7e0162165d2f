"""Target strength of a rigid sphere: limits of the series, size of its ripple, refusals."""

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.acoustics.target_strength import (
    rigid_sphere,
    rigid_sphere_large,
    rigid_sphere_small,
)

C = 1500.0


def frequency(ka: float, a: float = 0.1) -> float:
    return ka * C / (2.0 * np.pi * a)


def test_a_small_sphere_scatters_by_rayleigh() -> None:
    f = frequency(0.02)
    assert rigid_sphere(0.1, f) == pytest.approx(rigid_sphere_small(0.1, f), abs=0.005)


def test_a_large_sphere_scatters_a_quarter_of_its_radius_squared() -> None:
    for ka in (300.0, 2000.0, 15_000.0):
        assert rigid_sphere(0.1, frequency(ka)) == pytest.approx(rigid_sphere_large(0.1), abs=0.01)


def test_a_ball_of_two_metres_radius_has_zero_decibels() -> None:
    assert rigid_sphere_large(2.0) == 0.0


def test_the_ripple_is_that_of_a_wave_that_creeps_around_the_shadow() -> None:
    # Its path is longer than that of the echo by (2 + pi) a, so that maxima are 2 pi / (2 + pi)
    # of ka apart; the creeping wave is slower than the wave in the water by some percent.
    ka = np.linspace(5.0, 15.0, 2001)
    level = rigid_sphere(0.1, np.array([frequency(x) for x in ka]))
    peaks = ka[1:-1][(level[1:-1] > level[:-2]) & (level[1:-1] > level[2:])]
    assert np.diff(peaks).mean() == pytest.approx(2.0 * np.pi / (2.0 + np.pi), rel=0.08)


@pytest.mark.parametrize(
    "given", [(0.0, 1e5, C), (0.1, -1.0, C), (0.1, 1e5, 0.0), (np.nan, 1e5, C)]
)
def test_numbers_that_are_not_above_zero_are_refused(given: tuple[float, float, float]) -> None:
    with pytest.raises(InputInvalid, match="above 0"):
        rigid_sphere(*given)


def test_a_sphere_beyond_the_series_is_refused_with_the_closed_form() -> None:
    with pytest.raises(InputInvalid, match="rigid_sphere_large"):
        rigid_sphere(10.0, 1e6)
