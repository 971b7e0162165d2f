"""Recorded images: shapes, axes, and the ping at a time."""

from dataclasses import replace

import numpy as np
import pytest

from tests.view.sonar.made import forward_looking, side_scan
from uuvsim_cosim.errors import InputInvalid


def test_the_ping_at_a_time_is_the_last_one_before_it() -> None:
    scans = forward_looking()
    found = scans.at(0.39)
    assert found.time.tolist() == [0.2]
    assert np.array_equal(found.magnitude[0], scans.magnitude[1])
    assert np.array_equal(found.labels[0], scans.labels[1])
    assert scans.at(0.4).time[0] == scans.time[2]


def test_a_time_before_the_first_ping_is_refused() -> None:
    for time in (9.0, np.nan):
        with pytest.raises(InputInvalid, match=r"sidescan: no ping .*expected 10 s or later"):
            side_scan().at(time)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({"bearings": np.zeros(0)}, "3 pings of 0 beams and 60 bins; expected 1 or more of each"),
        ({"time": np.zeros(0)}, "0 pings"),
        ({"bearings": np.zeros(31)}, r"bearings \[rad\]: it does not rise"),
        ({"ranges": np.full(60, np.nan)}, r"ranges \[m\]: it does not rise"),
        ({"ranges": np.arange(60.0) - 3.0}, "range -3 m; expected 0 or more"),
        ({"labels": np.zeros((3, 31, 59), np.uint16)}, r"labels: shape \(3, 31, 59\)"),
        ({"detections": np.zeros((3, 30))}, r"expected \(3, 31\)"),
        ({"eta": np.zeros((3, 3))}, r"expected \(3, 6\)"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changed: dict[str, np.ndarray], expected: str) -> None:
    with pytest.raises(InputInvalid, match=expected):
        replace(forward_looking(), **changed)


def test_only_one_beam_a_side_is_a_side_scan() -> None:
    assert side_scan().is_side_scan
    assert not forward_looking().is_side_scan
    assert not forward_looking(n=1, beams=3).is_side_scan
