"""The link: its delay is exact, its losses hold, its noise is what it says."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.sensors.link import link

T = 0.1


def carried(lanes: Any, steps: int, n: int = 1, ranged: bool = False, **parameters: Any) -> Any:
    """What is shown after each sample of the signal x_k = (k, 2 k, -k), and its time."""
    run = lanes(link(period="0.1", ranged=ranged), n, parameters=parameters)
    y, t = np.zeros((steps, 3, n)), np.zeros((steps, n))
    for k in range(steps):
        run.step(k * T, T, x=[k, 2 * k, -k])
        y[k], t[k] = run["y"].reshape(3, n), run["t_sample"].reshape(n)
    return y, t


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (0.1, 1), (0.25, 3), (0.4, 4)])
def test_what_is_shown_was_sent_exactly_the_delay_before(
    lanes: Any, delay: float, samples: int
) -> None:
    y, t = carried(lanes, 20, delay=delay)
    sent = np.maximum(np.arange(20) - samples, 0)
    np.testing.assert_array_equal(y[:, :, 0], sent[:, None] * np.array([1.0, 2.0, -1.0]))
    np.testing.assert_allclose(t[:, 0], sent * T, atol=1e-12)


def test_each_lane_has_its_own_delay(lanes: Any) -> None:
    y, _ = carried(lanes, 20, 5, delay=np.array([[0.0, 0.1, 0.2, 0.3, 0.4]]))
    np.testing.assert_array_equal(y[-1, 0], [19, 18, 17, 16, 15])


def test_what_is_lost_leaves_the_last_standing(lanes: Any) -> None:
    y, t = carried(lanes, 50, loss=1.0)
    assert not np.any(y)
    assert not np.any(t)
    y, t = carried(lanes, 400, 50, loss=0.3)
    fresh = t[1:] > t[:-1]
    assert np.mean(fresh) == pytest.approx(0.7, abs=0.02)
    np.testing.assert_array_equal(y[1:][:, 0][~fresh], y[:-1][:, 0][~fresh])
    np.testing.assert_allclose(y[:, 0], t / T, atol=1e-9)


def test_noise_has_the_deviation_of_each_number(lanes: Any) -> None:
    run = lanes(link(period="0.1"), 20000, parameters={"sigma": [0.007, 0.0, 0.1]})
    y = run.step(0.0, T, x=[1.0, 2.0, 3.0])["y"]
    np.testing.assert_allclose(np.std(y, axis=1), [0.007, 0.0, 0.1], rtol=0.02)
    np.testing.assert_allclose(np.mean(y, axis=1), [1.0, 2.0, 3.0], atol=0.003)


def test_beyond_its_range_nothing_is_heard(lanes: Any) -> None:
    y, t = carried(lanes, 40, ranged=True, range_max=20.0)
    heard = np.arange(40) * np.sqrt(6.0) <= 20.0
    last = int(np.flatnonzero(heard)[-1])
    np.testing.assert_array_equal(y[:, 0, 0], np.minimum(np.arange(40), last))
    assert t[-1, 0] == pytest.approx(last * T)


def test_numbers_of_several_units_share_a_link() -> None:
    declared = link(2, "m/s2,rad/s").variables["y"]
    assert declared.units == ("m/s2", "rad/s")


def test_a_line_too_long_is_refused() -> None:
    with pytest.raises(ParameterInvalid, match="at most 255 samples under way"):
        link(period="0.001", delay_max="0.4")


def test_a_preset_gives_the_deviation_in_the_unit_of_the_link(lanes: Any) -> None:
    assert list(link(id="pool_positioning").variables["sigma"].start) == [0.007] * 3
    assert list(link(2, "mm", id="pool_positioning").variables["sigma"].start) == [7.0, 7.0]
    with pytest.raises(ParameterInvalid, match="no link 'pool'; expected pool_positioning"):
        link(id="pool")
