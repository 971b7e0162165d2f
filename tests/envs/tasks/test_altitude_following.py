"""Altitude following: what echoes show of hills, what is earned, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.envs.tasks.moments import ArrayMoment
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks import AltitudeFollowing, evaluate, scripted_policy
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.scene.shared.ray_casting import Caster


@pytest.fixture(scope="module")
def task() -> AltitudeFollowing:
    return AltitudeFollowing()


def moment(task: AltitudeFollowing, above: float, echo: float, ahead: float) -> ArrayMoment:
    """Return a level vehicle, `above` the seabed of the origin, and its echoes."""
    eta = np.zeros((1, 6))
    eta[0, 2] = Caster(task.scene).height(0.0, 0.0) - above
    one = np.ones(1)
    return ArrayMoment(
        {
            "hull.eta": eta, "hull.nu": np.zeros((1, 6)), "current.v_c": np.zeros((1, 3)),
            "reference.eta_d": np.zeros((1, 6)), "reference.nu_d": 0.3 * np.eye(1, 6),
            "echo_down.altitude": echo * one, "echo_ahead.altitude": ahead * one,
            "echo_down.valid": one, "echo_ahead.valid": one,
        },
        {"agent": np.zeros((1, 6))},
    )  # fmt: skip


def test_what_is_earned_is_of_the_true_altitude_and_what_is_seen_of_the_echo(
    task: AltitudeFollowing,
) -> None:
    m = moment(task, above=3.0, echo=3.4, ahead=5.0)
    assert task.reward(m)[0] == pytest.approx(1.0)
    assert task.extra(m)[0, 2] == pytest.approx(0.5)  # 0.1 m: the transducer's place
    assert task.info(m)["altitude"][0] == pytest.approx(3.0)


def test_over_level_ground_the_beam_ahead_says_nothing_new(task: AltitudeFollowing) -> None:
    level = 3.0 / np.cos(np.radians(32.5))
    assert task.extra(moment(task, 3.0, 3.0, level))[0, 18] == pytest.approx(0.0, abs=1e-12)
    assert task.extra(moment(task, 3.0, 3.0, level + 1.0))[0, 18] == pytest.approx(1.0)


def test_a_start_is_near_its_altitude_within_the_terrain(task: AltitudeFollowing) -> None:
    start = task.start(Draws(np.arange(300), np.zeros(300, int)))
    eta = start["hull.eta_0"]
    caster = Caster("hills")
    above = caster.height(eta[:, 0], eta[:, 1]) - eta[:, 2]
    assert np.all(np.abs(above - 3.0) < 1.0)
    assert np.ptp(eta[:, 0]) > 250


def test_the_yardstick_follows_the_hills_and_knows_the_slope_ahead(task: AltitudeFollowing) -> None:
    found = evaluate(task, scripted_policy(task), episodes=20).summary()
    assert found["return"] > 175
    assert found["position_error"] < 0.2
    assert found["altitude"] == pytest.approx(3.0, abs=0.15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"scene": "atlantis"}, "no scene 'atlantis'"),
        ({"scene": 3}, "scene: 3; expected the name of a scene"),
        ({"altitude": 0.5}, r"altitude \[m\]: 0.5; expected a number, 1 to 20"),
        ({"speed": 1}, r"speed \[m/s\]: 1; expected \(least, greatest\)"),
        ({"altitud": 3}, "option 'altitud'; expected one such as altitude"),
    ],
)
def test_options_that_cannot_be_meant_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputInvalid, match=words):
        AltitudeFollowing(**options)
