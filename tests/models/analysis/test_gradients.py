from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

SAMPLED = ("imu", "dvl", "pressure", "compass", "usbl", "navigation", "guidance", "controller")


@pytest.mark.parametrize("name", [*SAMPLED, "allocation"])
def test_derivatives_at_the_start_are_finite(name: str) -> None:
    """By every argument at once: NaN times zero is NaN, so one direction finds them."""
    model = declare(name)
    f = Evaluation(model)
    u, p = f.values_of("input", {}), f.values_of("parameter", {})
    d = f.derived(p)
    z = f.initial(p, d)
    for function, draws in [(f.outputs, 0), *((g, g.numel_in(6)) for g in f.updates)]:
        at = [0.0, u, p, d, np.zeros(0), z, *([np.zeros(draws)] if function.n_in() > 6 else [])]
        forward = function.forward(1)
        result = function(*at)
        seeds = [ca.DM.ones(*function.size_in(i)) for i in range(function.n_in())]
        sensitivity = np.array(forward(*at, result, *seeds))
        assert np.all(np.isfinite(np.array(result)))
        assert np.all(np.isfinite(sensitivity))
