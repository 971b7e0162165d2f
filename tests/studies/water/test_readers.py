"""Recordings in the formats of their repositories."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.water.kolano import moments_of_arm
from uuvsim_cosim.studies.water.recordings import recording, recordings
from uuvsim_cosim.studies.water.seaexplorer import density, salinity


def test_salinity_and_density_have_the_check_values_of_unesco() -> None:
    """Fofonoff and Millard (1983): S 40 at 1.888091 of the ratio, 40 degC and 10,000 dbar."""
    S = salinity(np.array([4.2914 * 1.888091]), np.array([40.0]), np.array([1e4]))
    assert S == pytest.approx(40.0, abs=1e-4)
    rho = density(np.array([40.0]), np.array([40.0]), np.array([1e4]))
    assert rho == pytest.approx(1059.82037, abs=1e-4)


def test_half_a_turn_of_the_first_joint_mirrors_the_moments_about_the_base_of_the_arm() -> None:
    angles = np.array([[0.4, 1.0, 0.7, 0.2]])
    one = moments_of_arm(angles)[0]
    other = moments_of_arm(angles + [[np.pi, 0.0, 0.0, 0.0]])[0]
    weight = one[0]
    assert other[0] == pytest.approx(weight)
    assert 0.5 * (one + other)[1:] == pytest.approx(weight * np.array([0.10965, -0.25]))


def test_a_recording_that_is_not_shipped_names_its_repository() -> None:
    with pytest.raises(InputInvalid, match=r"github\.com/clydemcqueen/orca4_1_tests"):
        recording("orca_bluerov2").read()


def test_an_unknown_recording_is_refused_with_those_there_are() -> None:
    with pytest.raises(InputInvalid, match="slocum_2016"):
        recording("slocum")


def test_the_judged_part_follows_the_fitted_one() -> None:
    assert [r.name for r in recordings() if r.judged[0] < r.fitted[1]] == []
