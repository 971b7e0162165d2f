"""MPC: its derivatives, what it gives at rest, its solvers against one another, its refusals."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.control_law import nominal_matrices
from uuvsim_cosim.models.control.mpc_problem import Programme, packed, programme, solver
from uuvsim_cosim.models.declaration.library import declare

Q = (10.0,) * 3 + (5.0, 5.0, 6.0) + (6.0,) * 4 + (2.0,) * 2
S = (0.05,) * 3 + (0.6,) * 3
LIMIT = np.array([110, 110, 130, 15, 12, 20])


@pytest.fixture(scope="module")
def of() -> Programme:
    return programme("bluerov2_heavy", 5, 0.1)


def data(rng: np.random.Generator) -> np.ndarray:
    x, eta_d, nu_d = rng.normal(0, 0.2, 12), rng.normal(0, 0.3, 6), rng.normal(0, 0.1, 6)
    return packed(x, eta_d, nu_d, rng.normal(0, 5, 6), rng.normal(0, 5, 6), Q, S)


def test_the_chained_gradient_is_that_of_the_cost(of: Programme) -> None:
    rng = np.random.default_rng(1)
    tau, p = rng.normal(0, 10, 30), data(rng)
    wanted = ca.Function("g", [of.tau, of.p], [of.cost, ca.gradient(of.cost, of.tau)])(tau, p)
    found = of.jac_fg(tau, p)
    for a, b in zip(found[:2], wanted, strict=True):
        np.testing.assert_allclose(np.array(a), np.array(b), rtol=1e-10, atol=1e-10)


def test_the_hessian_is_symmetric_and_positive_definite(of: Programme) -> None:
    rng = np.random.default_rng(2)
    H = np.array(of.hessian(rng.normal(0, 10, 30), data(rng), 1.0, []))
    np.testing.assert_allclose(H, H.T, atol=1e-9)
    assert np.linalg.eigvalsh(H).min() > 0


def test_at_rest_where_it_should_be_the_hull_is_held_by_its_restoring_force(of: Programme) -> None:
    v = nominal_matrices("bluerov2_heavy")
    net = float(v["W"].item() - v["B"].item())  # down; the tilt is zero
    tau = np.tile([0, 0, -net, 0, 0, 0], of.N)
    rest = packed(np.zeros(30), tau[:6], Q, S)
    found = solver(of)(x0=tau, p=rest, lbx=-np.tile(LIMIT, 5), ubx=np.tile(LIMIT, 5))
    np.testing.assert_allclose(np.array(found["x"]).ravel(), tau, atol=1e-9)
    assert abs(float(found["f"])) < 1e-15


def test_sqpmethod_run_to_convergence_agrees_with_ipopt(of: Programme) -> None:
    rng = np.random.default_rng(3)
    bound = np.tile(LIMIT, 5)
    for _ in range(3):
        p, start = data(rng), np.zeros(30)
        sqp, ip = (
            np.array(s(x0=start, p=p, lbx=-bound, ubx=bound)["x"]).ravel()
            for s in (solver(of, iterations=30), solver(of, "ipopt"))
        )
        np.testing.assert_allclose(sqp, ip, atol=0.05)
        assert np.all(np.abs(sqp) <= bound + 1e-9)


@pytest.mark.parametrize("options", [{"N": "0"}, {"N": "31"}, {"iterations": "0"}])
def test_a_horizon_that_cannot_be_is_refused(options: dict[str, str]) -> None:
    with pytest.raises(InputInvalid, match="expected 1 to 30 steps, 1 to 10 iterations"):
        declare("mpc", **options)
