"""Inputs between samples: their moments over steps, and the derivatives of these by a delay."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.inputs import COURSES, Curve, Inputs

Array = NDArray[np.float64]
T = np.round(np.arange(0.0, 5.01, 0.1), 9)
EDGES = np.linspace(0.5, 4.5, 21)


def by_quadrature(curve: Curve, edges: Array) -> Array:
    """Mean and change over each step, by sums over many points."""
    found = []
    for a, b in pairwise(edges):
        n = 20000
        s = a + (b - a) * (np.arange(n) + 0.5) / n
        v = curve.at(s)
        found.append((v.mean(), 12.0 / (b - a) * np.mean(v * (s - 0.5 * (a + b)))))
    return np.array(found).T


@pytest.mark.parametrize("course", COURSES)
def test_moments_are_the_integrals_of_the_curve(course: str) -> None:
    curve = Curve(T, np.sin(2.0 * T) + 3.0, course)
    assert curve.moments(EDGES) == pytest.approx(by_quadrature(curve, EDGES), abs=2e-4)


def test_each_course_is_what_its_name_says() -> None:
    values = np.sin(2.0 * T)
    between = T[10:-10] + 0.05
    held, linear, smooth = (Curve(T, values, c).at(between) for c in COURSES)
    assert held == pytest.approx(values[10:-10])
    assert linear == pytest.approx(0.5 * (values[10:-10] + values[11:-9]))
    assert smooth == pytest.approx(np.sin(2.0 * between), abs=1e-5)


@pytest.mark.parametrize("course", COURSES)
@pytest.mark.parametrize("delay", [0.037, -0.023])
def test_derivatives_by_the_delay_are_those_of_the_moments(course: str, delay: float) -> None:
    inputs = Inputs(EDGES, (Curve(T, np.cos(3.0 * T), course),), (0.0,), (0,))
    n, e = len(EDGES) - 1, 1e-6
    mean, rise, change, turn = inputs.at(delay)
    more, less = inputs.at(delay + e), inputs.at(delay - e)
    assert mean.shape == (n,)
    assert rise == pytest.approx((more[0] - less[0]) / (2 * e), abs=1e-5)
    assert turn == pytest.approx((more[2] - less[2]) / (2 * e), abs=1e-4)
    assert change == pytest.approx(0.5 * (more[2] + less[2]), abs=1e-6)


def test_a_known_delay_moves_a_signal_and_an_unknown_one_only_those_that_it_delays() -> None:
    curve = Curve(T, np.sin(T), "smooth")
    late = Inputs(EDGES, (curve, curve), (0.2, 0.0), (1,)).at(0.3)
    assert late[0] == pytest.approx(curve.moments(EDGES - 0.2)[0], abs=1e-12)
    assert late[1] == pytest.approx(curve.moments(EDGES - 0.3)[0], abs=1e-12)


def test_a_gap_is_crossed_by_a_line_and_ends_are_constant() -> None:
    kept = (T < 2.0) | (T > 3.0)
    curve = Curve(T, np.where(kept, 40.0 * T**3, np.nan), "smooth")
    before, after = 40.0 * 1.9**3, 40.0 * 3.1**3
    assert curve.at(np.array([2.5])) == pytest.approx(0.5 * (before + after), rel=1e-6)
    assert curve.at(np.array([-1.0, 9.0])) == pytest.approx([0.0, 5000.0])
    with pytest.raises(InputInvalid, match="holds no number"):
        Curve(T, np.full(len(T), np.nan), "linear")
