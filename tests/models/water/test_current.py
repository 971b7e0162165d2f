"""The meandering current: its statistics are those asked for, whatever its sample period."""

import numpy as np
import pytest

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.water.current import current_gauss_markov, current_ramps


def run(period: str, until: float, seed: int = 3, **parameters: float) -> np.ndarray:
    model = current_gauss_markov(period=period)
    steady = {"sigma_direction": 0.0, "direction": 0.0, "tau": 2.0, "sigma": 0.1, "speed": 0.5}
    given = steady | parameters | {"seed": (seed, 7)}
    return simulate(model, until=until, h=float(period), parameters=given)["v_c"]


@pytest.mark.parametrize("period", ["0.5", "2"])
def test_mean_deviation_and_correlation_do_not_depend_on_the_period(period: str) -> None:
    T = float(period)
    n = 6000
    x = run(period, n * T)[1:, 0]
    assert x.mean() == pytest.approx(0.5, abs=0.02)
    assert x.std() == pytest.approx(0.1, rel=0.08)
    lag = np.corrcoef(x[:-1], x[1:])[0, 1]
    assert lag == pytest.approx(np.exp(-T / 2.0), abs=0.04)


def test_the_first_sample_is_already_stationary() -> None:
    first = [run("1", 1, seed)[1, 0] for seed in range(300)]
    assert np.std(first) == pytest.approx(0.1, rel=0.15)


def test_equal_seeds_give_equal_bits_and_others_do_not() -> None:
    a, b, c = run("1", 5, 1), run("1", 5, 1), run("1", 5, 2)
    assert np.array_equal(a, b)
    assert not np.array_equal(a, c)


def test_without_deviation_it_flows_steadily_to_its_direction() -> None:
    v = run("1", 3, sigma=0.0, direction=np.pi / 2)
    np.testing.assert_allclose(v, np.tile([0, 0.5, 0], (4, 1)), atol=1e-15)


def test_a_ramp_rises_evenly_and_then_stays_and_a_short_one_is_a_step() -> None:
    dv = [[0.2, 0.0, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.0]]
    given = {"dv": dv, "t": [1.0, 2.0, 0.0], "T": [2.0, 1e-6, 1.0]}
    run = simulate(current_ramps(), until=5, h=0.5, inputs={"v": (0.3, 0, 0)}, parameters=given)
    expected = 0.3 + 0.2 * np.clip((run.t - 1.0) / 2.0, 0.0, 1.0)
    np.testing.assert_allclose(run["v_c"][:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(run["v_c"][:, 1], np.where(run.t > 2.0, -0.1, 0.0), atol=1e-12)
    assert np.all(run["v_c"][:, 2] == 0.0)


def test_without_events_the_current_is_what_it_was() -> None:
    run = simulate(current_ramps(), until=1, h=0.5, inputs={"v": (0.3, -0.2, 0.1)})
    np.testing.assert_array_equal(run["v_c"], np.tile([0.3, -0.2, 0.1], (3, 1)))
