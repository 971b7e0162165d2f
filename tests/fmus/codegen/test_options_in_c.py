"""What only options declare, in C: it agrees with CasADi's own evaluation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from uuvsim_cosim.fmus.codegen.native import Native
from uuvsim_cosim.models.analysis.simulate import simulate
from uuvsim_cosim.models.declaration.library import declare

H, STEPS = 0.01, 60
CASES: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "bluerov2_heavy": (
        {"surface": "volumes", "waves": True, "compressible": True},
        {"tau": [5, 1, -20, 0.5, 0.4, 0.3], "a_c": [0.2, 0.1, -0.3], "zeta": 0.02},
        {"eta_0": [0, 0, 0.12, 0.5, -0.3, 0.2], "nu_0": [0.5, 0.2, -0.8, 0.4, 0.3, 0.2]},
    ),
    "remus100": (
        {"surface": "volumes"},
        {"tau": [5, 1, -2, 0.1, 0.4, 0.3]},
        {"eta_0": [0, 0, 0.02, 0.5, -0.1, 0.2], "nu_0": [1.5, 0.2, -0.4, 0.4, 0.3, 0.2]},
    ),
    "thruster": (
        {"shaft": "third", "curve": "bessa", "faults": True, "limits": True, "dead_band": True},
        {"u": 0.7},
        {"entangled": 0.2, "health": -0.8},
    ),
    "propeller": (
        {"ventilation": True},
        {"u": 0.8, "nu_r": [1, 0.1, 0, 0, 0, 0.2], "eta": [0, 0, 0.05, 0.1, 0, 0]},
        {},
    ),
    "fins": (
        {"vehicle": "npsauv", "form": "derivatives", "faults": True},
        {"u": [0.1, 0.2, -0.1, 0.1], "nu_r": [1, 0.1, 0, 0, 0.1, 0.2], "n": 90.0},
        {"stuck": [0, 0.5, 0, 0]},
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_an_option_is_lowered_as_casadi_evaluates_it(name: str) -> None:
    options, inputs, parameters = CASES[name]
    model = declare(name, **options)
    native = Native(model, model.name)
    variables = native.description.variables
    for key, value in (parameters | inputs).items():
        native.set(variables[key], np.asarray(value, dtype=float) if np.ndim(value) else value)
    native.enter_initialization_mode(0.0, None)
    native.exit_initialization_mode()
    for k in range(STEPS):
        native.do_step(k * H, H)
    wanted = simulate(model, until=H * STEPS, h=H, inputs=inputs, parameters=parameters)
    for v in model.of_kind("output"):
        found = np.asarray(native.get(variables[v.name]), dtype=float).ravel()
        expected = np.ravel(wanted[v.name][-1])
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10, err_msg=v.name)
    native.free()
