from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.envs.drift import drifting
from uuvsim_cosim.envs.episodes.spaces import ActionBox, ObservationBox
from uuvsim_cosim.envs.task.signals import Signals
from uuvsim_cosim.envs.task.task import Channel
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten

PLAN = flatten(drifting())


def actions(*channels: Channel) -> ActionBox:
    return ActionBox(PLAN, channels)


def observed(values: Any, *channels: Channel, **more: Any) -> np.ndarray:
    """Observe hull.eta = values."""
    signals = Signals(PLAN, ["hull.eta"])
    box = ObservationBox(PLAN, signals, channels, **more)
    assert not box.problems
    return box.of(np.array(values, float).reshape(6, -1), None)


def test_limits_become_minus_one_and_one() -> None:
    box = actions(Channel("hull.tau[1]", -40, 20), Channel("hull.tau[6]", -1, 3))
    scaled = box.scaled(np.array([[-1.0, 1.0], [0.0, 0.0], [1.0, -1.0]]))
    np.testing.assert_allclose(scaled, [[-40, -10, 20], [3, 1, -1]])


@pytest.mark.parametrize(("low", "high"), [(-0.1, 0.3), (0.1, 0.7), (-1e-3, 1e9), (-7, 1e-300)])
def test_rounding_never_leads_out_of_the_limits(low: float, high: float) -> None:
    box = actions(Channel("hull.tau[1]", low, high))
    scaled = box.scaled(np.array([[-1.0], [1.0]]))
    assert low <= scaled.min()
    assert scaled.max() <= high
    np.testing.assert_allclose(scaled, [[low, high]], rtol=1e-12, atol=1e-12 * (high - low))


def test_limits_in_another_unit_are_converted() -> None:
    box = actions(Channel("hull.tau[1]", -0.04, 0.04, "kN"))
    np.testing.assert_allclose(box.scaled(np.ones((1, 1))), [[40.0]])
    seen = observed([0, 0, 0, 0, 0, np.pi / 2], Channel("hull.eta[6]", -180, 180, "deg"))
    np.testing.assert_allclose(seen, [[0.5]], rtol=1e-6)
    seen = observed([1.5, 0, 0, 0, 0, 0], Channel("hull.eta[1]", unit="cm"))
    np.testing.assert_allclose(seen, [[150.0]])


def test_an_angle_passes_pi_without_a_jump() -> None:
    channel = Channel("hull.eta[4:6]", sin_cos=True)
    below = observed([0, 0, 0, 0.1, 0.2, np.pi - 1e-4], channel)
    above = observed([0, 0, 0, 0.1, 0.2, -np.pi + 1e-4], channel)
    assert below.shape == (1, 6)
    np.testing.assert_allclose(below, above, atol=3e-4)
    np.testing.assert_allclose(below[0, :2], [np.sin(0.1), np.cos(0.1)], rtol=1e-6)


def test_observations_are_clipped_to_their_box_and_those_without_limits_are_not() -> None:
    seen = observed([9, -9, 9, 0, 0, 0], Channel("hull.eta[1:2]", -1, 1), Channel("hull.eta[3]"))
    np.testing.assert_array_equal(seen, np.array([[1, -1, 9]], np.float32))


def test_actions_beyond_the_box_are_clipped() -> None:
    box = actions(Channel("hull.tau[1]", -40, 20))
    checked = box.checked(np.array([[3.0], [-np.inf]]), 2, "task")
    np.testing.assert_array_equal(checked, [[1.0], [-1.0]])


@pytest.mark.parametrize(
    ("action", "words"),
    [
        (np.zeros(3), r"task: an action of type float64 and shape \(3,\); expected 2 numbers"),
        (np.zeros((2, 2)), r"shape \(2, 2\)"),
        (np.zeros(2, bool), "type bool"),
        (["left", "up"], "expected 2 numbers in"),
        ([[1], [2, 3]], "expected 2 numbers in"),
        (None, "type object"),
        ([0.0, np.nan], r"the action for 'hull.tau\[2\]' is not a number"),
    ],
)
def test_a_wrong_action_says_what_is_right(action: Any, words: str) -> None:
    box = actions(Channel("hull.tau[1:2]", -40, 20))
    with pytest.raises(InputInvalid, match=words):
        box.checked(action, None, "task")


def test_a_nan_among_many_names_the_environment() -> None:
    box = actions(Channel("hull.tau[1:2]", -40, 20))
    wrong = np.zeros((5, 2))
    wrong[3, 1] = np.nan
    with pytest.raises(InputInvalid, match=r"'hull.tau\[2\]' in environment 3"):
        box.checked(wrong, 5, "task")


@pytest.mark.parametrize(
    ("channel", "words"),
    [
        (Channel("hull.taau", -1, 1), "no variable 'taau'.*such as tau"),
        (Channel("hul.tau", -1, 1), "no component 'hul'.*such as hull"),
        (Channel("hull.tau[7]", -1, 1), "indices from 1 to 6"),
        (Channel("hull.tau[1]"), "without limits; expected low= and high="),
        (Channel("hull.tau[1]", -1), "expected both low= and high="),
        (Channel("hull.tau[1]", 1, -1), "low= less than high="),
        (Channel("hull.tau[1:2]", [1, 2, 3], 4), "a finite number, or 2 of them"),
        (Channel("hull.tau[1]", -1, 1, "m"), "unit 'm' for a variable in 'N'"),
        (Channel("hull.tau[1]", -1, 1, sin_cos=True), "sin_cos in observations only"),
        (Channel("hull.eta[1]", -1, 1), "causality output; expected an unconnected input"),
        (Channel("hull.v_c[1]", -1, 1), "is connected to current.v_c"),
    ],
)
def test_a_wrong_channel_of_actions_is_refused(channel: Channel, words: str) -> None:
    import re

    (problem,) = actions(channel).problems
    assert re.search(words, str(problem)), problem
    assert channel.name in str(problem)


def test_an_element_is_acted_on_once() -> None:
    box = actions(Channel("hull.tau[1:3]", -1, 1), Channel("hull.tau[3]", -1, 1))
    assert "twice" in str(box.problems[0])


def test_sine_and_cosine_are_of_angles() -> None:
    signals = Signals(PLAN, ["hull.eta"])
    box = ObservationBox(PLAN, signals, [Channel("hull.eta[1]", sin_cos=True)])
    assert "unit 'rad' for a variable in 'm'" in str(box.problems[0])


def test_a_signal_that_is_not_read_is_refused_with_those_that_are() -> None:
    signals = Signals(PLAN, ["hull.eta"])
    with pytest.raises(InputInvalid, match=r"not read by this task, which reads hull.eta"):
        signals.view(np.zeros((6, 2)), "hull.nu")


def test_signals_are_views_by_name_element_and_slice() -> None:
    signals = Signals(PLAN, ["hull.eta", "current.v_c", "hull.eta"])
    assert signals.names == ("hull.eta", "current.v_c")
    values = np.arange(18.0).reshape(9, 2)
    assert signals.view(values, "hull.eta").shape == (2, 6)
    np.testing.assert_array_equal(signals.view(values, "hull.eta[2]"), values[1])
    np.testing.assert_array_equal(signals.view(values, "current.v_c[2:3]"), values[7:9].T)
