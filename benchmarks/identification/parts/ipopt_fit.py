"""Fit by direct multiple shooting, solved by ipopt with the Gauss-Newton matrix as Hessian.

    min over theta, x_0 … x_S   sum of (y_k - h(x_k, w_k, theta))² / sigma²
    such that each segment of the recording, started at x_i, ends at x_(i + 1)

(Bock 1983; Schloeder and Bock's method for parameters of differential equations). With segments, a
simulation at wrong parameters does not diverge over a long recording. sigma is estimated from the
residuals of each signal, in a second and a third pass. The covariance is that of the last
Gauss-Newton matrix with the states eliminated, increased by the correlation of each residual with
the one before it.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.studies.identification.fit import AWAY, FIRST, LEAST, Fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.residuals import correlation_of_lag_one
from uuvsim_cosim.studies.identification.shooting import PRIOR, measured_motion
from uuvsim_cosim.studies.identification.signals import ANGLES, Grid

__all__ = ["fit"]

Array = NDArray[np.float64]
_SEGMENT = 3.0  # s


class _Problem:
    """The nonlinear programme over z = (theta scaled, states of the segments scaled)."""

    def __init__(self, box: GreyBox, grid: Grid) -> None:
        self.box = box
        K = grid.w.shape[1]
        self.S = max(1, round(K * grid.h / _SEGMENT))
        self.M = K // self.S
        self.K = self.M * self.S
        self.h = grid.h
        self.n_x, self.n_p = box.x.numel(), len(box.fitted)
        self.center = start = np.array([f.start for f in box.fitted])
        self.scale = np.where(np.abs(start) > 1e-9, np.abs(start), 1.0)
        self.w, self.y = grid.w[:, : self.K], grid.y[:, : self.K + 1]
        self.guess = _guess(box, grid, self.S, self.M)
        self.x_scale = np.maximum(np.abs(self.guess).max(axis=1), 0.1)
        step = box.step(grid.h, sloped=True)
        self.segment = step.mapaccum("segment", self.M)
        z = ca.MX.sym("z", self.n_p + self.S * self.n_x)
        weights = ca.MX.sym("weights", 12, self.K + 1)
        theta = self.center + self.scale * z[: self.n_p]
        starts = ca.diag(self.x_scale) @ ca.reshape(z[self.n_p :], self.n_x, self.S)
        w = ca.DM(self.w) if self.w.size else ca.DM(0, self.K)
        ends = self.segment.map(self.S)(starts, w, ca.repmat(theta, 1, self.K))
        columns = [ends[:, self.M * (i + 1) - 1] for i in range(self.S)]
        inner = [
            ca.horzcat(starts[:, i], ends[:, self.M * i : self.M * (i + 1) - 1])
            for i in range(self.S)
        ]
        x = ca.horzcat(*inner, columns[-1])
        n_w = box.w.numel()
        last = ca.horzcat(w[:n_w, :], w[:n_w, -1]) if n_w else ca.DM(0, self.K + 1)
        y = box.h.map(self.K + 1)(x, last, ca.repmat(theta, 1, self.K + 1))
        difference = y - ca.DM(np.nan_to_num(self.y))
        rows = [
            ca.atan2(ca.sin(difference[j, :]), ca.cos(difference[j, :])) if j in ANGLES
            else difference[j, :]
            for j in range(12)
        ]  # fmt: skip
        self.residual = ca.Function("residual", [z], [ca.vertcat(*rows)])
        data = ca.vec(ca.vertcat(*rows) * weights)
        prior = [PRIOR * z[: self.n_p]]
        for (i, name), place in box.x_places.items():  # weak: the length of q, a shaft's speed, …
            x_0 = starts[place, 0]
            if i == box.hull and name == "q_nb":
                prior.append(1e2 * (ca.sumsqr(x_0) - 1.0))
            else:
                prior.append((x_0 - self.guess[place, 0]) / (10.0 * self.x_scale[place]))
        r = ca.vertcat(data, *prior)
        gaps = [(columns[i] - starts[:, i + 1]) / ca.DM(self.x_scale) for i in range(self.S - 1)]
        g = ca.vertcat(*gaps) if gaps else ca.MX(0, 1)
        J = ca.jacobian(r, z)
        H = ca.triu(J.T @ J)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        hessian = ca.Function("nlp_hess_l", [z, weights, lam_f, lam_g], [lam_f * H])
        nlp = {"x": z, "p": weights, "f": 0.5 * ca.sumsqr(r), "g": g}
        options: Any = {
            "hess_lag": hessian,
            "print_time": False,
            "show_eval_warnings": False,
            # Bounds are seldom active, so the barrier begins low. A fit needs an objective that no
            # longer changes and continuous states, not the last digits of the multipliers.
            "ipopt": {"print_level": 0, "sb": "yes", "max_iter": 60, "tol": 1e-6, "mu_init": 1e-8,
                      "acceptable_tol": 1e4, "acceptable_constr_viol_tol": 1e-5,
                      "acceptable_dual_inf_tol": 1e6, "acceptable_compl_inf_tol": 1e-3,
                      "acceptable_obj_change_tol": 1e-6, "acceptable_iter": 2},
        }  # fmt: skip
        self.solver = ca.nlpsol("identify", "ipopt", nlp, options)
        of_data = ca.jacobian(data, z)
        self.sensitivity = ca.Function("sensitivity", [z, weights], [of_data, ca.jacobian(g, z)])


def fit(box: GreyBox, grid: Grid) -> Fit:
    """Fit the parameters of `box` to the measurements; raises InputInvalid if nothing converges."""
    p = _Problem(box, grid)
    seen = np.isfinite(p.y)
    z = np.concatenate([np.zeros(p.n_p), (p.guess / p.x_scale[:, None]).T.ravel()])
    free = np.full(p.S * p.n_x, np.inf)  # states have no bounds
    low, high = (
        np.concatenate([(np.array(ends) - p.center) / p.scale, sign * free])
        for ends, sign in (([f.low for f in box.fitted], -1.0), ([f.high for f in box.fitted], 1.0))
    )
    sigma = FIRST.copy()
    iterations, stats = 0, {}
    for _ in range(3):
        weights = np.where(seen, 1.0 / sigma[:, None], 0.0)
        found = p.solver(x0=z, p=weights, lbx=low, ubx=high, lbg=0.0, ubg=0.0)
        stats = p.solver.stats()
        iterations += int(stats["iter_count"])
        z = np.array(found["x"]).ravel()
        if not np.all(np.isfinite(z)):
            raise InputInvalid(AWAY)
        residual = np.where(seen, np.array(p.residual(z)), np.nan)
        before = sigma
        good = [row[np.isfinite(row)] for row in residual]
        sigma = np.array([max(float(np.sqrt(np.mean(r**2))), least) if len(r) else 1.0
                          for r, least in zip(good, LEAST, strict=True)])  # fmt: skip
        if np.all(np.abs(np.log(sigma / before)) < 0.05):
            break
    rho = np.array([correlation_of_lag_one(residual[j]) for j in range(12)])
    weights = np.where(seen, 1.0 / sigma[:, None], 0.0)
    widened = weights * np.sqrt((1.0 - rho) / (1.0 + rho))[:, None]
    information = _information(p, z, widened)
    if not np.all(np.isfinite(information)):
        raise InputInvalid(AWAY)
    scaled = np.diag(p.scale)
    theta = p.center + p.scale * z[: p.n_p]
    inverse = np.linalg.inv(information + PRIOR**2 * np.eye(p.n_p))
    return Fit(
        theta, scaled @ inverse @ scaled, sigma, rho, information / np.outer(p.scale, p.scale),
        z[p.n_p : p.n_p + p.n_x] * p.x_scale, int(seen.sum()), iterations,
        bool(stats["success"]), str(stats["return_status"]), np.ones(p.n_p),
    )  # fmt: skip


def _information(p: _Problem, z: Array, weights: Array) -> Array:
    """Return the Fisher information of theta (scaled), with all states eliminated."""
    J, G = (m.sparse() for m in p.sensitivity(z, weights))
    J, G = J.tocsc(), G.tocsc()
    n_x, n_p = p.n_x, p.n_p
    # States of segment i by those of the first and by theta: s_(i + 1) = A_i s_i + B_i theta.
    S_i = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])
    columns = [n_p + i * n_x for i in range(p.S)]
    total = np.zeros((J.shape[0], n_x + n_p))
    total[:, n_x:] = J[:, :n_p].toarray()
    for i, at in enumerate(columns):
        total += J[:, at : at + n_x] @ S_i
        if i + 1 < p.S:
            rows = slice(i * n_x, (i + 1) * n_x)
            A, B = G[rows, at : at + n_x].toarray(), G[rows, :n_p].toarray()
            following = A @ S_i
            following[:, n_x:] += B
            S_i = following
    # Least squares against the initial states; the rows below are a weak prior on them.
    held = np.vstack([total, np.hstack([0.1 * np.eye(n_x), np.zeros((n_x, n_p))])])
    Q, _ = np.linalg.qr(held[:, :n_x])
    rest = held[:, n_x:]
    rest = rest - Q @ (Q.T @ rest)
    return np.asarray(rest.T @ rest, dtype=float)


def _guess(box: GreyBox, grid: Grid, S: int, M: int) -> Array:
    """Return initial states (n_x, S) of the segments: the hull's measured, the others simulated."""
    from uuvsim_cosim.models.declaration.kinematics import q_of_euler

    n_x = box.x.numel()
    start = box.start()
    y = measured_motion(grid)
    step = box.step(grid.h, sloped=True)
    theta = np.array([f.start for f in box.fitted])
    euler = ca.SX.sym("e", 3)
    q_of = ca.Function("q", [euler], [q_of_euler(euler[0], euler[1], euler[2])])
    hull = box.hull
    x = start.copy()
    out = np.zeros((n_x, S))
    for i in range(S):
        k = i * M
        x[box.x_places[hull, "p"]] = y[:3, k]
        x[box.x_places[hull, "q_nb"]] = np.array(q_of(y[3:6, k])).ravel()
        x[box.x_places[hull, "nu_b"]] = y[6:, k]
        out[:, i] = x
        for j in range(k, min(k + M, grid.w.shape[1])):
            x = np.array(step(x, grid.w[:, j], theta)).ravel()
        if not np.all(np.isfinite(x)):
            x = start.copy()
    return out
