from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.sensors.compass import compass


def heading(lanes: Any, silent: Any, psi: float, **parameters: Any) -> float:
    m = compass()
    run = lanes(m, parameters=silent(m) | parameters)
    return float(run.step(0.0, 0.1, eta=[0, 0, 0, 0, 0, psi])["psi"][0])


@pytest.mark.parametrize("psi", [-3.0, -0.5, 0.0, 1.0, 3.1])
def test_without_errors_it_reads_the_magnetic_heading(lanes: Any, silent: Any, psi: float) -> None:
    assert heading(lanes, silent, psi) == pytest.approx(psi, abs=1e-12)


def test_declination_is_left_to_the_reader(lanes: Any, silent: Any) -> None:
    assert heading(lanes, silent, 0.5, declination=0.1) == pytest.approx(0.4, abs=1e-12)


def test_reading_stays_within_half_a_turn(lanes: Any, silent: Any) -> None:
    assert heading(lanes, silent, 3.1, declination=-0.2) == pytest.approx(3.3 - 2 * np.pi)


def test_hard_iron_adds_once_around_the_circle(lanes: Any, silent: Any) -> None:
    b = 0.1
    for psi in (0.3, 1.3, -2.0):
        reading = heading(lanes, silent, psi, hard_iron=[b, 0])
        assert reading == pytest.approx(np.arctan2(np.sin(psi), np.cos(psi) + b), abs=1e-12)


def test_soft_iron_squeezes_the_circle(lanes: Any, silent: Any) -> None:
    reading = heading(lanes, silent, 0.7, soft_iron=[1.2, 0, 0, 1.0])
    assert reading == pytest.approx(np.arctan2(np.sin(0.7), 1.2 * np.cos(0.7)), abs=1e-12)
