"""The programme that MPC solves: forces over a horizon, the nominal hull, and a cost of residuals.

With x = (eta, nu), the hull's equation with a constant unknown force b (in n, its moment in b) and
x_{k+1} by one RK4 step of length h, single shooting over N steps:

    min over tau_1 … tau_N of  sum |Q^1/2 (x_k - x_d,k)|² + |S^1/2 (tau_k - tau_{k-1})|²
    such that  |tau_k| <= tau_max

x_d,k goes on from eta_d with the wanted velocity nu_d. Nothing is paid for a steady force, so none
is missed at rest (Fossen 2021 has no MPC; Rawlings, Mayne and Diehl 2017, chapter 1 and 8.9).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.angle import wrap
from uuvsim_cosim.models.control_law import NominalHull, nominal_matrices
from uuvsim_cosim.models.kinematics import R_zyx, T_zyx
from uuvsim_cosim.models.rigid_body import inverse

__all__ = ["SOLVERS", "Programme", "packed", "programme", "solver"]

SOLVERS = ("sqpmethod", "ipopt")
Solver = Literal["sqpmethod", "ipopt"]


@dataclass(frozen=True)
class Programme:
    """Functions of the programme: `step` x, tau, b -> x; `residual` of all tau and the data p.

    p = (x, eta_d, nu_d, b, tau before, sqrt Q (12), sqrt S (6)), 54 numbers in SI.
    """

    N: int
    h: float
    step: Any
    tau: Any
    p: Any
    residual: Any


def programme(vehicle: str = "bluerov2_heavy", N: int = 12, h: float = 0.1) -> Programme:
    """Write the programme for a vehicle: N steps of h [s]."""
    if not (1 <= N <= 100 and h > 0):
        raise InputInvalid(f"mpc: N = {N}, h = {h} s; expected 1 to 100 steps of more than 0 s")
    v = nominal_matrices(vehicle)
    hull = NominalHull(**{k: ca.DM(x) for k, x in v.items()})
    M_inv = inverse(ca.SX(hull.M))
    x, tau, b = ca.SX.sym("x", 12), ca.SX.sym("tau", 6), ca.SX.sym("b", 6)

    def rates(x: Any) -> Any:
        eta, nu = x[:6], x[6:]
        R = R_zyx(eta[3], eta[4], eta[5])
        push = tau + ca.vertcat(ca.mtimes(R.T, b[:3]), b[3:])
        load = push - ca.mtimes(hull.C(nu) + hull.D(nu), nu) - hull.g(eta)
        turning = ca.mtimes(T_zyx(eta[3], eta[4]), nu[3:])
        return ca.vertcat(ca.mtimes(R, nu[:3]), turning, ca.mtimes(M_inv, load))

    k1 = rates(x)
    k2 = rates(x + 0.5 * h * k1)
    k3 = rates(x + 0.5 * h * k2)
    k4 = rates(x + h * k3)
    step = ca.Function("step", [x, tau, b], [x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)])

    p = ca.SX.sym("p", 54)
    at, eta_d, nu_d, push, before, Q, S = ca.vertsplit(p, [0, 12, 18, 24, 30, 36, 48, 54])
    U = ca.SX.sym("U", 6, N)
    parts = []
    wanted = eta_d
    for k in range(N):
        at = step(at, U[:, k], push)
        R_d = R_zyx(wanted[3], wanted[4], wanted[5] + 0.5 * h * nu_d[5])
        wanted = ca.vertcat(
            wanted[:3] + h * ca.mtimes(R_d, nu_d[:3]), wanted[3:5], wanted[5] + h * nu_d[5]
        )
        R = R_zyx(at[3], at[4], at[5])
        R_w = R_zyx(wanted[3], wanted[4], wanted[5])
        e_p = ca.mtimes(R.T, wanted[:3] - at[:3])
        nu_w = ca.vertcat(ca.mtimes(R.T, ca.mtimes(R_w, nu_d[:3])), nu_d[3:])
        error = ca.vertcat(e_p, wrap(wanted[3:] - at[3:6]), nu_w - at[6:])
        parts += [Q * error, S * (U[:, k] - (U[:, k - 1] if k else before))]
    return Programme(N, h, step, ca.vec(U), p, ca.vertcat(*parts))


def solver(of: Programme, kind: Solver = "sqpmethod", iterations: int = 2) -> Any:
    """Give the CasADi solver of the programme; in `sqpmethod`, Gauss-Newton steps by qrqp.

    Both are `casadi.nlpsol` of the same problem. ipopt runs to convergence; sqpmethod does
    `iterations` steps from where it starts (a real-time iteration), and its C can be generated.
    """
    if kind not in SOLVERS:
        raise InputInvalid(f"mpc: solver {kind!r}; expected {' or '.join(SOLVERS)}")
    cost = 0.5 * ca.sumsqr(of.residual)
    nlp = {"x": of.tau, "p": of.p, "f": cost, "g": ca.SX(0, 1)}
    J = ca.jacobian(of.residual, of.tau)
    H = ca.mtimes(J.T, J)
    H = ca.triu(H) if kind == "ipopt" else H
    lam_f, lam_g = ca.SX.sym("lam_f"), ca.SX.sym("lam_g", 0)
    hessian = ca.Function(
        "hess_lag", [of.tau, of.p, lam_f, lam_g], [lam_f * H],
        ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"],
    )  # fmt: skip
    options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "hess_lag": hessian}
    if kind == "ipopt":
        options["ipopt"] = {"print_level": 0, "sb": "yes", "max_iter": 30, "tol": 1e-5}
        return ca.nlpsol("mpc", "ipopt", nlp, options)
    return ca.nlpsol("mpc", "sqpmethod", nlp, options | {
        "qpsol": "qrqp", "max_iter": iterations,
        "print_header": False, "print_iteration": False, "print_status": False,
        "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
    })  # fmt: skip


def packed(*parts: Any) -> np.ndarray:
    """Give the data p of the programme as one vector."""
    return np.concatenate([np.asarray(x, dtype=float).ravel() for x in parts])
