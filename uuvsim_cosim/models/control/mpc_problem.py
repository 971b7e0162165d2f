"""The optimal control problem of MPC: forces over a horizon, nominal hull, cost of residuals.

With x = (eta, nu), the hull's equation with a constant unknown force b (in n, its moment in b) and
x_{k+1} by one RK4 step of length h, single shooting over N steps:

    min over tau_1 … tau_N of  sum |Q^1/2 (x_k - x_d,k)|² + |S^1/2 (tau_k - tau_{k-1})|²
    such that  |tau_k| <= tau_max

x_d,k continues from eta_d with the wanted velocity nu_d. A steady force costs nothing, so there is
no steady error at rest. This is a real-time iteration: Gauss-Newton steps from the last solution
(Rawlings, Mayne and Diehl 2017, chapter 8; not checked against the book).

Each part (the hull's rates, a step, an error, and the Jacobian of each) is a function that is
called and not inlined, and Jacobians are chained from step to step. The generated C code therefore
stays small.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.control_law import NominalHull, nominal_matrices
from uuvsim_cosim.models.declaration.kinematics import R_zyx, T_zyx
from uuvsim_cosim.models.declaration.safe_math import wrap

__all__ = ["ITERATIONS", "Programme", "Solver", "packed", "programme", "solver"]

ITERATIONS = 2  # Gauss-Newton steps of one solution by sqpmethod
Solver = Literal["sqpmethod", "ipopt"]


@dataclass(frozen=True)
class Programme:
    """The programme as CasADi functions.

    `tau` stacks the N forces (6 N); p = (x, eta_d, nu_d, b, tau before, sqrt Q (12), sqrt S (6)),
    54 numbers in SI. `step` is x, tau, b -> x after h. `jac_fg` and `hessian` have the names and
    places that `casadi.nlpsol` gives them.
    """

    N: int
    h: float
    step: ca.Function
    tau: ca.SX
    p: ca.SX
    cost: ca.SX
    jac_fg: ca.Function
    hessian: ca.Function


def programme(vehicle: str = "bluerov2_heavy", N: int = 10, h: float = 0.1) -> Programme:
    """Write the programme for a vehicle: N steps of h [s]."""
    if not (1 <= N <= 100 and 0 < h < np.inf):
        raise InputInvalid("mpc", f"N = {N}, h = {h} s", "1 to 100 steps of more than 0 s")
    stage = _Stage(nominal_matrices(vehicle), h)
    p, tau = ca.MX.sym("p", 54), ca.MX.sym("tau", 6 * N)
    x, eta_d, nu_d, b, before, Q, S = ca.vertsplit(p, [0, 12, 18, 24, 30, 36, 48, 54])
    forces = ca.vertsplit(tau, 6)
    weight = ca.repmat(S, N, 1)
    shift = ca.sparsify(
        ca.DM.eye(6 * N) - ca.diagcat(ca.DM(6, 0), ca.DM.eye(6 * N - 6), ca.DM(0, 6))
    )
    change = weight * (ca.mtimes(shift, tau) - ca.vertcat(before, ca.MX.zeros(6 * N - 6)))

    errors, rows = [], []
    at, exact, wanted = x, x, eta_d
    chained: ca.SX = ca.MX(12, 0)
    plain = []
    for k, force in enumerate(forces):
        wanted = stage.wanted(wanted, nu_d)
        at = stage.step(at, force, b)
        plain.append(stage.error(at, wanted, nu_d, Q))
        exact, A, B = stage.step_slope(exact, force, b)
        chained = ca.horzcat(ca.mtimes(A, chained), B)
        e, C = stage.error_slope(exact, wanted, nu_d, Q)
        errors.append(e)
        rows.append(ca.horzcat(ca.mtimes(C, chained), ca.MX(12, 6 * (N - 1 - k))))

    def cost(parts: list[ca.SX]) -> ca.SX:
        return 0.5 * (ca.sumsqr(ca.vertcat(*parts)) + ca.sumsqr(change))

    J = ca.densify(ca.vertcat(*rows))
    D = ca.mtimes(ca.diag(weight), shift)
    gradient = ca.mtimes(J.T, ca.vertcat(*errors)) + ca.mtimes(D.T, change)
    H = ca.mtimes(J.T, J) + ca.mtimes(D.T, D)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", 0)
    jac_fg = ca.Function(
        "nlp_jac_fg", [tau, p], [cost(errors), gradient, ca.MX(0, 1), ca.MX(0, 6 * N)],
        ["x", "p"], ["f", "grad_f_x", "g", "jac_g_x"],
    )  # fmt: skip
    hessian = ca.Function(
        "nlp_hess_l", [tau, p, lam_f, lam_g], [lam_f * ca.densify(H)],
        ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"],
    )  # fmt: skip
    return Programme(N, h, stage.step, tau, p, cost(plain), jac_fg, hessian)


class _Stage:
    """The functions of one step of the horizon: `step`, `wanted`, `error`, and `…_slope`."""

    def __init__(self, matrices: Mapping[str, np.ndarray], h: float) -> None:
        hull = NominalHull(**{k: ca.DM(v) for k, v in matrices.items()})
        M_inv = ca.densify(ca.inv(hull.M))
        x, tau, b = ca.SX.sym("x", 12), ca.SX.sym("tau", 6), ca.SX.sym("b", 6)
        eta, nu = x[:6], x[6:]
        R = R_zyx(eta[3], eta[4], eta[5])
        push = tau + ca.vertcat(ca.mtimes(R.T, b[:3]), b[3:])
        load = push - ca.mtimes(hull.C(nu) + hull.D(nu), nu) - hull.g(eta)
        turning = ca.mtimes(T_zyx(eta[3], eta[4]), nu[3:])
        rates = ca.vertcat(ca.mtimes(R, nu[:3]), turning, ca.mtimes(M_inv, load))
        self._rates = _function("rates", [x, tau, b], [rates])
        slope = ca.densify(ca.jacobian(rates, x))
        self._rates_slope = _function("rates_slope", [x, tau, b], [rates, slope])
        self._of_tau = ca.vertcat(ca.DM.zeros(6, 6), M_inv)
        self.step_slope = self._step_slope(h)

        x_k, tau_k, b_k = ca.MX.sym("x", 12), ca.MX.sym("tau", 6), ca.MX.sym("b", 6)
        k1 = self._rates(x_k, tau_k, b_k)
        k2 = self._rates(x_k + 0.5 * h * k1, tau_k, b_k)
        k3 = self._rates(x_k + 0.5 * h * k2, tau_k, b_k)
        k4 = self._rates(x_k + h * k3, tau_k, b_k)
        after = x_k + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        self.step = _function("step", [x_k, tau_k, b_k], [after])

        w, nu_d, Q = ca.SX.sym("eta_d", 6), ca.SX.sym("nu_d", 6), ca.SX.sym("Q", 12)
        R_d = R_zyx(w[3], w[4], w[5] + 0.5 * h * nu_d[5])
        on = ca.vertcat(w[:3] + h * ca.mtimes(R_d, nu_d[:3]), w[3:5], w[5] + h * nu_d[5])
        self.wanted = _function("wanted", [w, nu_d], [on])
        R_w = R_zyx(w[3], w[4], w[5])
        e_p = ca.mtimes(R.T, w[:3] - eta[:3])
        nu_w = ca.vertcat(ca.mtimes(R.T, ca.mtimes(R_w, nu_d[:3])), nu_d[3:])
        e = Q * ca.vertcat(e_p, wrap(w[3:] - eta[3:]), nu_w - nu)
        self.error = _function("error", [x, w, nu_d, Q], [e])
        e_x = ca.densify(ca.jacobian(e, x))
        self.error_slope = _function("error_slope", [x, w, nu_d, Q], [e, e_x])

    def _step_slope(self, h: float) -> ca.Function:
        """The step, with its derivatives by x (12, 12) and by tau (12, 6): RK4 of both at once."""
        x, tau, b = ca.MX.sym("x", 12), ca.MX.sym("tau", 6), ca.MX.sym("b", 6)
        start = ca.MX(ca.densify(ca.horzcat(ca.DM.eye(12), ca.DM.zeros(12, 6))))
        by_tau = ca.MX(ca.densify(ca.horzcat(ca.DM.zeros(12, 12), self._of_tau)))

        def rates(at: ca.SX, d: ca.SX) -> tuple[ca.SX, ca.SX]:
            k, J = self._rates_slope(at, tau, b)
            return k, ca.mtimes(J, d) + by_tau

        k1, d1 = rates(x, start)
        k2, d2 = rates(x + 0.5 * h * k1, start + 0.5 * h * d1)
        k3, d3 = rates(x + 0.5 * h * k2, start + 0.5 * h * d2)
        k4, d4 = rates(x + h * k3, start + h * d3)
        d = start + h / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
        after = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return _function("step_slope", [x, tau, b], [after, d[:, :12], d[:, 12:]])


def _function(name: str, inputs: list[ca.SX], outputs: list[ca.SX]) -> ca.Function:
    return ca.Function(name, inputs, outputs, {"cse": True, "never_inline": True})


def solver(of: Programme, kind: Solver = "sqpmethod", iterations: int = ITERATIONS) -> ca.Function:
    """Return the CasADi solver of the programme; in `sqpmethod`, Gauss-Newton steps by qrqp.

    Both are `casadi.nlpsol` of the same problem. ipopt runs to convergence; sqpmethod does
    `iterations` steps from where it starts (a real-time iteration), and its C can be generated.
    """
    if kind not in get_args(Solver):
        raise InputInvalid("mpc", f"solver {kind!r}", " or ".join(get_args(Solver)))
    nlp = {"x": of.tau, "p": of.p, "f": of.cost, "g": ca.MX(0, 1)}
    options: dict[str, object] = {"print_time": False, "error_on_fail": False, "calc_lam_p": False}
    if kind == "ipopt":
        f = of.hessian
        upper = ca.Function(
            "upper", f.mx_in(), [ca.triu(f(*f.mx_in()))], f.name_in(), ["triu_hess_gamma_x_x"]
        )
        options |= {"hess_lag": upper}
        options["ipopt"] = {"print_level": 0, "sb": "yes", "max_iter": 30, "tol": 1e-5}
        return ca.nlpsol("mpc", "ipopt", nlp, options)
    return ca.nlpsol("mpc", "sqpmethod", nlp, options | {
        "hess_lag": of.hessian, "jac_fg": of.jac_fg,
        "qpsol": "qrqp", "max_iter": iterations,
        "print_header": False, "print_iteration": False, "print_status": False,
        "qpsol_options": {
            "print_iter": False, "print_header": False, "error_on_fail": False, "max_iter": 100,
        },
    })  # fmt: skip


def packed(*parts: ArrayLike) -> np.ndarray:
    """Return the data p of the programme as one vector."""
    return np.concatenate([np.asarray(x, dtype=float).ravel() for x in parts])
