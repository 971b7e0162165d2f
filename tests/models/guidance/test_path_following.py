from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.library import declare
from uuvsim_cosim.models.guidance.trajectory import trajectory

H = 0.02
LINE = [(0.0, 0.0, 5.0), (60.0, 0.0, 5.0)]


def drifting(lanes: Any, method: str, drift: float, until: float = 90.0) -> np.ndarray:
    """Cross-track error of a vehicle that goes where its bow looks, and is carried sideways."""
    run = lanes(declare("path_following", method=method, waypoints=LINE))
    eta = np.array([0.0, 1.0, 5.0, 0.0, 0.0, 0.0])
    rows = []
    for k in range(round(until / H)):
        run.step(k * H, H, eta=eta)
        psi, u = run["eta_d"][5], run["nu_d"][0]
        eta = eta + H * np.array([u * np.cos(psi), u * np.sin(psi) + drift, 0, 0, 0, 0])
        eta[5] = psi
        rows.append(eta[1])
    return np.array(rows)


def test_los_keeps_the_offset_of_its_law_in_a_current(lanes: Any) -> None:
    """U sin(atan(y / Delta)) = drift."""
    y = drifting(lanes, "los", 0.15)
    assert y[-1] == pytest.approx(1.5 * np.tan(np.arcsin(0.15 / 0.5)), rel=1e-3)


@pytest.mark.parametrize("method", ["ilos", "alos"])
def test_ilos_and_alos_take_the_offset_away(lanes: Any, method: str) -> None:
    y = drifting(lanes, method, 0.15)
    assert abs(y[-1]) < 5e-3
    assert np.max(np.abs(y)) < 1.3


def test_a_method_that_does_not_exist_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="method 'lost'; expected los, ilos, alos"):
        declare("path_following", method="lost")


def test_a_trajectory_ends_at_its_waypoints_at_rest_and_its_velocity_is_its_derivative(
    lanes: Any,
) -> None:
    square = [(4.0, 0.0, 5.0), (4.0, 3.0, 6.0)]
    run = lanes(trajectory(waypoints=square))
    rows, speeds, turns = [], [], []
    for k in range(2600):
        run.step(k * H, H, eta=[0, 0, 5, 0, 0, 0])
        rows.append(run["eta_d"].copy())
        speeds.append(run["nu_d"].copy())
        turns.append(run["done"])
    eta, nu = np.squeeze(rows), np.squeeze(speeds)
    assert eta[-1] == pytest.approx([4, 3, 6, 0, 0, np.pi / 2], abs=1e-9)
    assert nu[-1] == pytest.approx(np.zeros(6), abs=1e-12)
    assert turns[-1] == 1
    for point in square:
        assert np.min(np.linalg.norm(eta[:, :3] - point, axis=1)) < 1e-9
    slope = (eta[2:, :3] - eta[:-2, :3]) / (2 * H)
    c, s = np.cos(eta[1:-1, 5]), np.sin(eta[1:-1, 5])
    v = nu[1:-1]
    wanted = np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]], axis=1)
    assert np.max(np.abs(slope - wanted)) < 2e-3
    longest = np.sqrt(5.774 * 4.0 / 0.1)  # s: this short leg is bound by its acceleration
    peak = np.max(np.linalg.norm(nu[:, :3], axis=1))
    assert peak == pytest.approx(1.875 * 4.0 / longest, rel=1e-3)
