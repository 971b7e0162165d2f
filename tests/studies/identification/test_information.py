"""The Fisher information of the parameters, with the states of all windows eliminated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.studies.identification.shooting import Point, Shooting


@pytest.mark.parametrize(("A", "B"), [(1.0, 1.0), (0.5, 2.0), (2.0, 0.25)])
@pytest.mark.parametrize("joined", [True, False])
def test_a_parameter_that_the_second_window_alone_shows_has_its_closed_form(
    A: float, B: float, joined: bool
) -> None:
    """Two states are measured, x_0 and x_1 = A x_0 + B theta; x_0 is held with a weight of 0.1.

    If the windows are of two runs, x_1 is free, and they show nothing of theta.
    """
    problem: Any = object.__new__(Shooting)
    problem.n_x, problem.n_p, problem.m = 1, 1, 0
    problem.measured, problem.follows = np.array([0]), np.array([False, joined])
    rows = np.array([[[1.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]]])  # by x, theta; residual
    ends = np.array([[[A]], [[A]]]), np.array([[[B]], [[B]]])
    nothing = np.zeros((2, 1))
    point = Point(np.zeros(1), nothing, np.zeros((2, 1, 12)), rows, *ends, nothing, 0.0)
    seen = 1 + A**2 + 0.1**2  # of x_0
    expected = B**2 - (A * B) ** 2 / seen if joined else 0.0
    found = problem.information(point, np.ones(12))[0, 0]
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12)
