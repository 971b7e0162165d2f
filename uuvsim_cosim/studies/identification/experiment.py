"""Proposals of further manoeuvres: from a small library, ranked by D-optimality.

Each manoeuvre is simulated with the fitted model: open loop, from rest, with the noise of the
residuals. Its Fisher information is computed as for a recording. The best one has the largest
determinant of the information of data and manoeuvre together.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.ambiguity import own_sizes, scaled_information
from uuvsim_cosim.studies.identification.fit import Fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox

__all__ = ["LIBRARY", "Proposal", "propose"]

Array = NDArray[np.float64]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_SPEED = np.array([0.5, 0.3, 0.3, 0.5, 0.5, 0.6])  # m/s and rad/s that each axis is to reach
_LENGTH = 40.0  # s


Shape = Callable[[Array], Array]  # times (n,) -> share of each axis' force (n, 6)


def _steps(*axes: int) -> Shape:
    """Ahead, rest, astern, rest at two heights: speeds that settle, and changes between them."""
    pattern = np.array([1.0, 0.0, -1.0, 0.0, 0.5, 0.0, -0.5, 0.0])

    def alone(t: Array, axis: int, period: float) -> Array:
        phase = np.floor(t / (period / 2)).astype(int)
        return np.outer(pattern[phase % 8], np.eye(6)[axis])

    periods = (8.0, 6.0)  # s, of the first axis and of the second
    return lambda t: reduce(np.add, (alone(t, *each) for each in zip(axes, periods, strict=False)))


def _sines(*axes: int) -> Shape:
    """Five sines from 0.05 to 0.5 Hz, with phases of their own (Schroeder's for a low peak)."""
    k = np.arange(5)
    f = 0.05 * 10.0 ** (k / 4.0)
    phases = -np.pi * k * (k + 1) / 5

    def alone(t: Array, i: int) -> Array:
        sines = np.sin(2 * np.pi * f * t[:, None] + (phases + i)).sum(axis=1) / 3.0
        return np.outer(sines, np.eye(6)[i])

    return lambda t: sum((alone(t, i) for i in axes), np.zeros((len(t), 6)))


LIBRARY: dict[str, Shape] = {
    **{f"{name}, ahead and back in steps": _steps(i) for i, name in enumerate(AXES)},
    "surge and yaw in steps": _steps(0, 5),
    "surge and sway in steps": _steps(0, 1),
    "sway and yaw in steps": _steps(1, 5),
    "heave and pitch in steps": _steps(2, 4),
    "five sines in surge, sway, heave and yaw": _sines(0, 1, 2, 5),
    "five sines in all six": _sines(0, 1, 2, 3, 4, 5),
}


@dataclass(frozen=True)
class Proposal:
    """A manoeuvre, the gain in log det of the information, and the 95 % half widths (n_p,)."""

    name: str
    gain: float
    half_widths: Array
    t: Array
    tau: Array  # (n, 6) [N, N.m]
    reached: Array  # largest |nu| (6,)


def propose(box: GreyBox, found: Fit) -> list[Proposal]:
    """Return the feasible manoeuvres, the best first; none without a force or command."""
    h = 0.1
    t: Array = h * np.arange(round(_LENGTH / h), dtype=float)
    drive = _Drive(box, found, h)
    if drive.gain is None:
        return []
    step = box.step(h)
    n_x, n_p = box.x.numel(), len(box.fitted)
    x, w, theta = (ca.SX.sym(n, s) for n, s in (("x", n_x), ("w", box.w.numel()), ("theta", n_p)))
    x_1, y = step(x, w, theta), box.h(x, w, theta)
    parts = ca.Function("parts", [x, w, theta], [ca.jacobian(x_1, x), ca.jacobian(x_1, theta),
                        ca.jacobian(y, x), ca.jacobian(y, theta)])  # fmt: skip
    flown = step.mapaccum("flown", len(t))
    before: Array = scaled_information(found.information, found.theta, box.fitted)
    before = before + 1e-4 * np.eye(n_p)
    _, base = np.linalg.slogdet(before)
    proposals = []
    x_0 = drive.rest()
    for name, shape in LIBRARY.items():
        feeds, tau = drive.feeds(shape(t))
        if feeds is None:
            continue
        states = np.array(flown(x_0, feeds, np.repeat(found.theta[:, None], len(t), 1)))
        before_each = np.hstack([x_0[:, None], states[:, :-1]])
        if not np.all(np.isfinite(states)):
            continue
        A, B, C, D = (np.array(m) for m in parts.map(len(t))(before_each, feeds, found.theta))
        information = _added(A, B, C, D, found, len(t), n_x, n_p)
        total = before + scaled_information(information, found.theta, box.fitted)
        if not np.all(np.isfinite(total)):
            continue
        _, value = np.linalg.slogdet(total)
        size = own_sizes(found.theta, box.fitted)
        spread = np.maximum(np.diag(np.linalg.inv(total)), 0.0)
        reached = np.abs(states[box.x_places[box.hull, "nu_b"]]).max(axis=1)
        half = 1.96 * size * np.sqrt(spread)
        proposals.append(Proposal(name, float(value - base), half, t, tau, reached))
    return sorted(proposals, key=lambda p: -p.gain)


def _added(A: Array, B: Array, C: Array, D: Array, found: Fit, n: int, n_x: int, n_p: int) -> Array:
    """Return the information of theta, with the initial state unknown as well."""
    S = np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])
    weights = 1.0 / found.sigma * np.sqrt((1 - found.correlation) / (1 + found.correlation))
    weights[found.sigma == 1.0] = 0.0  # signals that were not measured add nothing
    rows = []
    for k in range(n):
        row = C[:, k * n_x : (k + 1) * n_x] @ S
        row[:, n_x:] += D[:, k * n_p : (k + 1) * n_p]
        rows.append(row * weights[:, None])
        S = A[:, k * n_x : (k + 1) * n_x] @ S
        S[:, n_x:] += B[:, k * n_p : (k + 1) * n_p]
    J = np.vstack([*rows, np.hstack([np.eye(n_x), np.zeros((n_x, n_p))])])
    Q, _ = np.linalg.qr(J[:, :n_x])
    rest = J[:, n_x:] - Q @ (Q.T @ J[:, n_x:])
    return np.asarray(rest.T @ rest, dtype=float)


class _Drive:
    """Feeds that make a given force on the hull; their gains are found by simulation."""

    def __init__(self, box: GreyBox, found: Fit, h: float) -> None:
        self.box, self.theta = box, found.theta
        self.x_0 = found.x_0.copy()
        self.base = np.zeros(box.w.numel())
        names = [f.variable for f in box.feeds]
        for k, (feed, name) in enumerate(zip(box.feeds, names, strict=True)):
            if name == "voltage":
                start = box.plan.components[feed.component].description.variables[name].start
                self.base[k] = 16.0 if start is None else float(np.ravel(start)[0])
        self.pushing = [k for k, n in enumerate(names) if n in ("tau", "thrust", "force", "u")]
        self.commands = [k for k in self.pushing if names[k] == "u"]
        x = self.rest()
        self.M = np.linalg.inv(self._mobility())
        self.gain = self._gains(x, h) if self.pushing else None
        # The force (6,) that keeps each axis at its speed.
        full, still, moving = np.zeros(6), self._nu_dot(x, self.base), x.copy()
        for i in range(6):
            moving[box.x_places[box.hull, "nu_b"]] = _SPEED[i] * np.eye(6)[i]
            full[i] = float((self.M @ (still - self._nu_dot(moving, self.base)))[i])
        self.full: Array = np.maximum(full, 0.02 * np.diag(self.M) * _SPEED)

    def rest(self) -> Array:
        """Return the state of the hull at rest and level, at a depth of 20 m or more."""
        x = self.x_0.copy()
        box, hull = self.box, self.box.hull
        for (i, _), place in box.x_places.items():
            if i != hull:
                x[place] = 0.0
        x[box.x_places[hull, "q_nb"]] = [1.0, 0.0, 0.0, 0.0]
        x[box.x_places[hull, "nu_b"]] = 0.0
        p = box.x_places[hull, "p"]
        x[p] = [0.0, 0.0, max(float(x[p][2]), 20.0)]
        return x

    def _nu_dot(self, x: Array, w: Array) -> Array:
        return np.array(self.box.nu_dot(x, w, self.theta)).ravel()

    def _mobility(self) -> Array:
        """Return M^-1: nu_dot by a unit force, through the hull's own tau."""
        part = self.box.parts[self.box.hull]
        f, p = part.f, part.p.copy()
        for j, fit in enumerate(self.box.fitted):
            for component, name in fit.places:
                if component == self.box.hull:
                    p[part.place(name)] = self.theta[j]
        d = np.array(f.derived(p)).ravel()
        first = np.array(f.initial(p, d)).ravel()
        nu_dot, tau = part.place("nu_dot", "output"), part.place("tau", "input")
        u = np.zeros(sum(v.size for v in part.model.of_kind("input")))

        def of(force: Array) -> Array:
            u[tau : tau + 6] = force
            return np.array(f.outputs(0.0, u, p, d, first, [])).ravel()[nu_dot : nu_dot + 6]

        return np.stack([of(np.eye(6)[i]) - of(np.zeros(6)) for i in range(6)], axis=1)

    def _gains(self, x: Array, h: float) -> Array:
        """Return the settled force (6, n) of each feed at a command of 1, or of one half."""
        step = self.box.step(h)
        columns = []
        hull = [self.box.x_places[self.box.hull, n] for n in ("p", "q_nb", "nu_b")]
        for k in self.pushing:
            forces = []
            command = k in self.commands
            for value in (0.5 if command else 1.0, 0.0):
                w, s = self.base.copy(), x.copy()
                w[k] = value
                for _ in range(10 if command else 0):
                    s = np.array(step(s, w, self.theta)).ravel()
                    for place in hull:
                        s[place] = x[place]
                forces.append(self.M @ self._nu_dot(s, w))
            scale = 4.0 if command else 1.0  # thrust goes with |u| u
            columns.append(scale * (forces[0] - forces[1]))
        return np.stack(columns, axis=1)

    def feeds(self, share: Array) -> tuple[Array | None, Array]:
        """Return feeds (n_w, n) for shares (n, 6) of the full force; None if it cannot be made."""
        assert self.gain is not None
        tau = share * self.full
        amounts = np.linalg.pinv(self.gain, rcond=1e-3) @ tau.T
        made = self.gain @ amounts
        wanted = np.abs(tau.T) > 1e-9
        if np.any(np.abs(made - tau.T)[wanted] > 0.2 * np.abs(tau.T)[wanted]):
            return None, tau
        w = np.repeat(self.base[:, None], len(share), 1)
        for row, k in zip(amounts, self.pushing, strict=True):
            root = np.clip(np.sign(row) * np.sqrt(np.abs(row)), -1, 1)
            w[k] = root if k in self.commands else row
        return w, tau
