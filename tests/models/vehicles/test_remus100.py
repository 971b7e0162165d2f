"""Torpedoes in a current: strips, lift, products and Munk moment feel the relative flow alone."""

from __future__ import annotations

import numpy as np
import pytest

from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare


@pytest.mark.parametrize("address", ["remus100@fossen_2021", "npsauv", "eca_a9"])
def test_in_a_uniform_current_a_torpedo_moves_as_in_still_water_that_drifts(address: str) -> None:
    """Galilean: strips, lift and products feel nu_r alone, the Munk moment too."""
    v_c = np.array([0.4, -0.3, 0.1])
    model = declare(address, surface=False)
    tau = [10.0, 0.5, -1.0, 0.02, 0.1, -0.2]
    still = simulate(model, until=5, h=0.01, tau=tau)
    moved = simulate(model, until=5, h=0.01, tau=tau, inputs={"v_c": v_c},
                     parameters={"nu_0": [*v_c, 0, 0, 0]})  # fmt: skip
    np.testing.assert_allclose(moved["nu_r"], still["nu"], atol=1e-9)
    np.testing.assert_allclose(moved["q"], still["q"], atol=1e-9)
