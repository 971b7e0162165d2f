"""The helm turns to where the point is, and drives no faster than it may."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

HELM = Evaluation(declare("helm"))


def steered(position_d: Any, velocity_d: Any = (0, 0, 0), psi: float = 0.0) -> tuple[float, float]:
    inputs = {"position_d": position_d, "velocity_d": velocity_d, "eta": [0, 0, 0.5, 0, 0, psi]}
    p = HELM.values_of("parameter", {})
    a, omega = np.array(HELM.outputs(0, HELM.values_of("input", inputs), p, [], [], [])).ravel()
    return a, omega


def test_a_point_ahead_is_driven_to_without_turning() -> None:
    assert steered((0.2, 0, 0.5)) == pytest.approx((2.0 * 0.8 * 0.2, 0.0))
    assert steered((9.0, 0, 0.5))[0] == pytest.approx(0.4)


def test_the_bow_turns_the_shortest_way() -> None:
    assert steered((0, 0.1, 0.5))[1] == pytest.approx(1.5)
    assert steered((-1, -0.01, 0.5))[1] == pytest.approx(-1.5)
    assert steered((-1, 0, 0.5), psi=3.0)[1] == pytest.approx(2 * (np.pi - 3.0))


def test_a_point_astern_is_not_driven_to_backwards() -> None:
    assert steered((-1, 0, 0.5))[0] == 0.0


def test_on_the_point_its_velocity_is_followed() -> None:
    a, omega = steered((0, 0, 0.5), (0.0, 0.15, 0.0), psi=np.pi / 2)
    assert (a, omega) == pytest.approx((0.3, 0.0), abs=1e-12)
    assert steered((0, 0, 0.5), psi=1.0) == (0.0, 0.0)
