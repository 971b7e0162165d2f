"""Compiled windows: the steps of CasADi with the same bits, and derivatives of these steps."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.shipped.actuators import with_actuators
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.sensitivities import Windows


def box_of(*names: str) -> GreyBox:
    system, _ = with_actuators(System("s").add("hull", "model:bluerov2"), "bluerov2")
    plan = flatten(system.with_mismatches("warn"))
    return GreyBox(plan, 0, wanted_parameters(plan, 0, names), exact=False)


@pytest.mark.parametrize("names", [("D_q_11", "M_A_66"), ("D_q_66", "thruster_*.T_n")])
def test_windows_are_the_steps_of_casadi_and_their_derivatives(names: tuple[str, ...]) -> None:
    box = box_of(*names)
    rng, h, m = np.random.default_rng(3), 0.02, 6
    n_x, n_w = box.x.numel(), box.w.numel()
    inputs = rng.uniform(-0.2, 0.2, (2, m, 2 * n_w))
    voltages = [k for k, f in enumerate(box.feeds) if f.variable == "voltage"]
    inputs[..., voltages] = 15.0
    inputs[..., [n_w + k for k in voltages]] = 0.0
    starts = np.tile(box.start(), (2, 1))
    starts[:, box.x_places[0, "p"]] = [0.0, 0.0, 10.0]
    starts[:, box.x_places[0, "nu_b"]] = rng.uniform(-0.3, 0.3, (2, 6))
    theta = np.array([f.start for f in box.fitted])
    windows = Windows(box, inputs, h)
    y, _, end, dend = windows(starts, theta)
    step = box.step(h, sloped=True)
    x = starts[1]
    for k in range(m):
        assert np.array_equal(y[1, k], np.array(box.h(x, inputs[1, k, :n_w], theta)).ravel())
        x = np.array(step(x, inputs[1, k], theta)).ravel()
    assert end[1] == pytest.approx(x, rel=1e-14, abs=1e-14)
    # The same derivatives by CasADi, through the chain of all steps.
    x_0, parameters = ca.MX.sym("x", n_x), ca.MX.sym("theta", len(theta))
    chain = x_0
    for k in range(m):
        chain = step(chain, inputs[1, k], parameters)
    both = ca.vertcat(x_0, parameters)
    exact = ca.Function("exact", [x_0, parameters], [ca.jacobian(chain, both)])
    assert dend[1] == pytest.approx(np.array(exact(starts[1], theta)), rel=1e-9, abs=1e-12)
