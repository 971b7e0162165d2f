"""Navigation between late fixes, on circles in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.navigation.navigation_fixes import navigation_fixes

STEP, LATE = 0.02, 0.4
U, RATE = 0.3, 0.6  # m/s, rad/s: a circle of half a metre


def where(t: float) -> Any:
    """Return N, E, D, psi on the circle."""
    psi = RATE * t
    r = U / RATE
    return np.array([r * np.sin(psi), r * (1.0 - np.cos(psi)), 0.5, psi])


def flown(
    lanes: Any, until: float, *, b_a: Any = (0, 0, 0), b_g: float = 0.0, moved: float = 0.0,
    fixes: bool = True, **start: Any,
) -> Any:  # fmt: skip
    """Fly the circle with an IMU that is wrong by its biases; gives errors (steps, 4) and nu."""
    known = {"eta_0": [0, 0, 0.5, 0, 0, 0], **start}
    run = lanes(navigation_fixes(), 1, parameters=known)
    errors = []
    for k in range(round(until / STEP)):
        t = k * STEP
        acc = np.array([0.0, U * RATE, -9.81]) + b_a
        heard = {}
        sent = (t - LATE + 1e-9) // 0.2 * 0.2
        if fixes and sent >= 0:
            at = where(sent)[:3] + (moved if sent >= 10.0 else 0.0) * np.array([1, 0, 0])
            heard = {"fix": at, "fix_t_sample": sent}
        run.step(
            t, STEP, imu_acc=acc, imu_gyro=[0, 0, RATE + b_g], imu_t_sample=t,
            compass_psi=(RATE * t + np.pi) % (2 * np.pi) - np.pi, compass_t_sample=t // 0.1 * 0.1,
            **heard,
        )  # fmt: skip
        eta = run["eta"].ravel()
        true = where(t) + (moved if t >= 10.0 else 0.0) * np.array([1, 0, 0, 0])
        off = eta[[0, 1, 2, 5]] - true
        off[3] = (off[3] + np.pi) % (2 * np.pi) - np.pi
        errors.append(off)
    return np.array(errors), run


def test_a_speed_that_nobody_told_is_learned_from_late_fixes(lanes: Any) -> None:
    errors, run = flown(lanes, 12.0)
    assert np.max(np.abs(errors[-100:, :3])) < 0.02
    assert run["nu"].ravel()[[0, 1, 5]] == pytest.approx([U, 0.0, RATE], abs=0.02)
    assert run["lost_fixes"].item() == 0


def test_biases_of_the_accelerometer_and_of_the_gyro_are_found(lanes: Any) -> None:
    errors, run = flown(lanes, 40.0, b_a=(0.15, -0.1, 0.1), b_g=0.01)
    assert np.max(np.abs(errors[-200:, :3])) < 0.04
    assert np.max(np.abs(errors[-200:, 3])) < 0.03
    assert run["nu"].ravel()[0] == pytest.approx(U, abs=0.05)


def test_without_fixes_it_goes_on_by_dead_reckoning(lanes: Any) -> None:
    _, run = flown(lanes, 2.0, fixes=False)
    assert run["age"].item() == 0.0
    assert np.all(np.isfinite(run["eta"]))


def test_a_vehicle_that_was_pushed_away_is_found_again(lanes: Any) -> None:
    errors, run = flown(lanes, 14.0, moved=0.5)
    assert run["lost_fixes"].item() >= 1
    assert np.max(np.abs(errors[-50:, :2])) < 0.05
