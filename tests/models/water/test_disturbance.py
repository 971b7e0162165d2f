"""Ramps of a current and faults of thrusters: closed forms."""

from __future__ import annotations

import numpy as np

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.water.disturbance import current_ramps, thruster_faults


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


def test_a_thruster_gives_all_until_its_fault_and_its_share_afterwards() -> None:
    given = {"efficiency": [0.0, 0.4, 1.0], "t": [1.0, 2.0, 0.0]}
    inputs = {"thrust_in": (10.0, -20.0, 30.0)}
    run = simulate(thruster_faults(3), until=3, h=1.0, inputs=inputs, parameters=given)
    np.testing.assert_allclose(run["thrust"][:, 0], [10, 0, 0, 0])
    np.testing.assert_allclose(run["thrust"][:, 1], [-20, -20, -8, -8])
    np.testing.assert_allclose(run["thrust"][:, 2], 30)
    np.testing.assert_allclose(run["health"][-1], [0.0, 0.4, 1.0])
