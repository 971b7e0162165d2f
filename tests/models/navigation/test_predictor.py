"""The predictor says where a target is now, from positions that came late."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.models.navigation.predictor import predictor

STEP, LATE = 0.02, 0.4
CONSTANT = (0.1, -0.05)  # m/s


def followed(lanes: Any, path: Any, until: float = 8.0, sigma: float = 0.0, n: int = 1) -> Any:
    """Return its error over time (steps, n, 2): a position every 0.2 s, 0.4 s late."""
    run = lanes(predictor(), n)
    rng = np.random.default_rng(0)
    sent = {round(k * 10): path(0.2 * k) + sigma * rng.normal(size=(n, 2)) for k in range(60)}
    errors = []
    for k in range(round(until / STEP)):
        newest = (k * STEP - LATE + 1e-9) // 0.2
        if newest >= 0:
            z = np.column_stack([sent[round(newest * 10)], np.full(n, 0.5)])
            run.step(k * STEP, STEP, position=z.T, t_sample=0.2 * newest)
        else:
            run.step(k * STEP, STEP)
        errors.append(run["now"].reshape(3, n)[:2].T - path((k + 1) * STEP))
    return np.array(errors), run


def straight(t: float) -> Any:
    return np.array([[0.3, 0.2]]) + t * np.array([CONSTANT])


def test_a_straight_course_is_shown_where_it_is_now(lanes: Any) -> None:
    errors, run = followed(lanes, straight)
    assert np.max(np.abs(errors[-100:])) < 1e-3
    assert run["velocity"].ravel()[:2] == pytest.approx(CONSTANT, abs=1e-3)
    assert run["now"].ravel()[2] == 0.5
    assert 0.4 <= run["age"].item() <= 0.64


def test_before_the_first_position_it_shows_what_it_was_told(lanes: Any) -> None:
    run = lanes(predictor(), 1, parameters={"position_0": [1.0, 2.0, 3.0]})
    run.step(0.0, STEP)
    assert list(run["now"].ravel()) == [1.0, 2.0, 3.0]
    assert run["age"].item() == 0.0


def test_noise_of_7_mm_leaves_less_than_4_cm_after_half_a_second(lanes: Any) -> None:
    errors, _ = followed(lanes, straight, sigma=0.007, n=8)
    assert np.sqrt(np.mean(errors[200:] ** 2)) < 0.04


def test_what_is_not_heard_of_any_more_is_not_carried_on_for_ever(lanes: Any) -> None:
    run = lanes(predictor(), 1, parameters={"age_max": 1.0})
    for k in range(400):
        heard = min(k * STEP // 0.2 * 0.2, 2.0)
        z = [*straight(heard)[0], 0.5]
        run.step(k * STEP, STEP, position=z, t_sample=heard)
    assert run["age"].item() == 1.0
    np.testing.assert_allclose(run["now"].ravel()[:2], straight(3.0)[0], atol=5e-3)


def test_a_target_that_is_suddenly_elsewhere_is_believed_at_once(lanes: Any) -> None:
    def jumps(t: float) -> Any:
        return straight(0.0) + (t >= 3.0)

    errors, _ = followed(lanes, jumps, until=4.0)
    assert np.max(np.abs(errors[-20:])) < 1e-6
