from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from uuvsim_cosim.models.actuators.thruster_geometry import configuration_matrix, thruster_geometry
from uuvsim_cosim.models.declaration.evaluation import Evaluation
from uuvsim_cosim.models.declaration.library import declare

T = configuration_matrix(thruster_geometry("bluerov2_heavy"))
W = np.diag([1.0, 1.0, 1.0, 25.0, 25.0, 25.0])


@pytest.fixture(scope="module")
def allocated() -> Any:
    model = declare("allocation_qp")
    f = Evaluation(model)
    p = f.values_of("parameter", {})
    d = np.array(f.derived(p)).ravel()
    f_max, f_min = (float(model.variables[n].start[0]) for n in ("f_max", "f_min"))

    def run(tau: Any, health: Any = (1.0,) * 8) -> tuple[Any, ...]:
        u = f.values_of("input", {"tau_d": tau, "health": health})
        y = np.array(f.outputs(0.0, u, p, d, np.zeros(0), np.zeros(0))).ravel()
        return y[:8], y[8:16], y[16], (f_min, f_max)

    return run


def exact(tau: Any, health: Any, limits: tuple[float, float]) -> Any:
    root = np.sqrt(W)
    A = np.vstack([root @ T, np.sqrt(1e-3) * np.eye(8)])
    h = np.asarray(health) + 1e-12
    bounds = (-h * limits[0], h * limits[1])
    return lsq_linear(A, np.concatenate([root @ tau, np.zeros(8)]), bounds, tol=1e-12).x


def test_a_force_within_the_limits_is_met(allocated: Any) -> None:
    tau = np.array([20.0, -10.0, 15.0, 1.0, -0.5, 2.0])
    _, f, met, _ = allocated(tau)
    assert T @ f == pytest.approx(tau, abs=0.02)
    assert met == pytest.approx(1.0, abs=2e-3)


def test_a_force_beyond_the_limits_is_met_as_near_as_an_exact_solver_can(allocated: Any) -> None:
    rng = np.random.default_rng(1)
    for k in range(40):
        tau = rng.normal(size=6) * np.array([80, 80, 80, 10, 10, 12])
        health = np.ones(8)
        health[k % 8] = float(k % 2)
        _, f, _, limits = allocated(tau, health)
        assert np.all(f <= health * limits[1] + 1e-9)
        assert np.all(f >= -health * limits[0] - 1e-9)
        root = np.sqrt(np.diag(W))
        off = np.linalg.norm(root * (T @ (f - exact(tau, health, limits))))
        assert off < 0.015 * (1 + np.linalg.norm(root * tau))


def test_what_one_lost_thruster_cannot_do_the_others_do(allocated: Any) -> None:
    tau = np.array([40.0, 0, 0, 0, 0, 0])
    health = (1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0)
    u, f, met, _ = allocated(tau, health)
    assert u[2] == f[2] == 0.0
    assert T @ f == pytest.approx(tau, abs=0.3)
    assert met > 0.99


def test_where_the_pseudo_inverse_scales_all_the_programme_gives_more(allocated: Any) -> None:
    tau = np.array([100.0, 60.0, 0, 0, 0, 0])
    _, _, met, limits = allocated(tau)
    share = np.linalg.pinv(T) @ tau
    scaled = 1.0 / max(1.0, np.max(np.where(share < 0, -share / limits[0], share / limits[1])))
    assert scaled < 0.9
    assert met > scaled + 0.02
