"""The Fisher information of the parameters, with the states of all segments eliminated."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import pytest

from uuvsim_cosim.studies.identification.fit import _information


@pytest.mark.parametrize(("A", "B"), [(1.0, 1.0), (0.5, 2.0), (2.0, 0.25)])
def test_a_parameter_that_the_second_segment_alone_shows_has_its_closed_form(
    A: float, B: float
) -> None:
    """Two states are measured, x_0 and x_1 = A x_0 + B theta; x_0 is held with a weight of 0.1."""
    J = ca.sparsify(ca.DM([[0, 1, 0], [0, 0, 1]]))  # by theta, x_0, x_1
    G = ca.sparsify(ca.DM([[B, A, -1]]))  # of the gap between the segments
    problem: Any = SimpleNamespace(n_x=1, n_p=1, S=2, sensitivity=lambda *_: (J, G))
    seen = 1 + A**2 + 0.1**2  # of x_0
    expected = B**2 - (A * B) ** 2 / seen
    z: Any = None
    assert _information(problem, z, z)[0, 0] == pytest.approx(expected, rel=1e-12)
