"""Information of a recording: what it does not determine, and what would tell more.

Weak directions of the Fisher information are combinations of parameters that the data do not
determine. Further manoeuvres are proposed from a small library, ranked by D-optimality. Each one is
simulated with the fitted model: open loop, from rest, with the noise of the residuals. Its Fisher
information is computed as for a recording. The best one has the largest
determinant of the information of data and manoeuvre together.

If the residuals of a fit are not white, a step from its end tells which further unknown (a delay, a
current, biases) would lower the sum of squares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.assumptions import MEASURED, Assumptions
from uuvsim_cosim.studies.identification.fit import Fit
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.parameters import Fitted
from uuvsim_cosim.studies.identification.shooting import PRIOR, Shooting
from uuvsim_cosim.studies.identification.signals import Grid

__all__ = ["LIBRARY", "WEAK", "Proposal", "ambiguities", "improvements", "own_sizes", "propose",
    "scaled_information"]  # fmt: skip

Array = NDArray[np.float64]
AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_SPEED = np.array([0.5, 0.3, 0.3, 0.5, 0.5, 0.6])  # m/s and rad/s that each axis is to reach
_LENGTH = 40.0  # s
_WORTH = 0.02  # share of the sum of squares, below which an unknown is not named
_BESIDE = 0.25  # the same, relative to the share of the best one
WEAK = 0.25  # relative standard error of a weak direction: ± 50 % at 95 %
_SHARE, _CORRELATED = 0.3, 0.95


def scaled_information(information: Array, theta: Array, fitted: Sequence[Fitted]) -> Array:
    """Return the information of parameters in units of their own size."""
    sizes = own_sizes(theta, fitted)
    scaled: Array = information * np.outer(sizes, sizes)
    return scaled


def own_sizes(theta: Array, fitted: Sequence[Fitted]) -> Array:
    """Return the size (n_p,) of each parameter at theta."""
    least = np.array([max(f.size, 0.05 * abs(f.start)) for f in fitted])
    size = np.maximum(np.abs(theta), least)
    return np.where(size > 0, size, 1.0)


def ambiguities(names: Sequence[str], scaled: Array) -> list[str]:
    """Return a message for each combination of parameters that the data do not determine.

    A combination is a direction in which all could change, each by its share of its own size,
    with a standard error above a quarter; two that are correlated by more than 0.95 are named too.
    """
    values, directions = np.linalg.eigh(scaled)
    found = []
    named: set[frozenset[str]] = set()
    for value, direction in zip(values, directions.T, strict=True):
        error = float("inf") if value <= 0 else float(value**-0.5)
        if error < WEAK:
            continue
        size = np.abs(direction) / np.abs(direction).max()
        group = [n for n, s in zip(names, size, strict=True) if s > _SHARE]
        named.add(frozenset(group))
        bound = "" if error > 10.0 else f" better than ± {196 * error:.0f} % (95 %)"
        if len(group) == 1:
            found.append(f"the data do not determine {group[0]}{bound}")
        else:
            signs = np.sign(direction[[names.index(n) for n in group]])
            how = "together" if np.all(signs == signs[0]) else "against each other"
            found.append(
                f"the data cannot separate {', '.join(group[:-1])} and {group[-1]}: they can "
                f"change {how}, which the data do not determine{bound}"
            )
    try:
        covariance = np.linalg.inv(scaled + 1e-9 * np.eye(len(names)))
    except np.linalg.LinAlgError:
        return found
    errors = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    for i, a in enumerate(names):
        for j in range(i):
            r = float(covariance[i, j] / (errors[i] * errors[j]))
            pair = frozenset((a, names[j]))
            weak = max(errors[i], errors[j]) > 0.5 * WEAK
            if abs(r) > _CORRELATED and weak and not any(pair <= g for g in named):
                found.append(f"{names[j]} and {a} are known together only (correlation {r:.3f})")
    return found


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


def improvements(box: GreyBox, grid: Grid, found: Fit, assumed: Assumptions) -> list[str]:
    """Return which unknowns would lower the sum of squares of a fit, by a step from its end."""
    if found.point is None or found.noise is None or grid.inputs is None:
        return []
    measured = [MEASURED[j] for j in np.flatnonzero(np.isfinite(grid.y).any(axis=1))]
    names = {f.name for f in box.fitted}
    every = Assumptions(unknown=("delay", "current", "bias")).unknowns(measured)
    more = [f for f in every if f.name not in names]
    wide = GreyBox(box.plan, box.hull, [*box.fitted, *more], exact=box.tick > 0.0)
    known = tuple(
        d + (found.theta[box.delay] if k in box.delayed and box.delay is not None else 0.0)
        for k, d in enumerate(grid.inputs.delays)
    )
    inputs = replace(grid.inputs, delays=known, delayed=wide.delayed)
    theta = np.concatenate([found.theta, np.zeros(len(more))])
    if box.delay is not None:
        theta[box.delay] = 0.0
    problem = Shooting(wide, replace(grid, inputs=inputs, w=inputs.at()))
    if len(problem.follows) != len(found.point.starts):
        return []
    problem.delay = 0.0
    point = problem.at(theta, found.point.starts, found.noise)
    information, gradient = problem.normal_equations(point)
    n = len(box.fitted)
    groups: dict[str, list[int]] = {}
    for k, f in enumerate(more, n):
        groups.setdefault(f.name.partition("_")[0], []).append(k)
    inner = information[:n, :n] + PRIOR**2 * np.eye(n)
    told = []
    for name, group in groups.items():
        crossed = information[group, :n]
        left = information[np.ix_(group, group)] - crossed @ np.linalg.solve(inner, crossed.T)
        step = -np.linalg.solve(left + PRIOR**2 * np.eye(len(group)), gradient[group])
        share = float(-step @ gradient[group]) / (2.0 * point.objective)
        errors = np.sqrt(np.diag(np.linalg.inv(left + PRIOR**2 * np.eye(len(group)))))
        clear = [i for i, (v, e) in enumerate(zip(step, errors, strict=True)) if abs(v) > 3.0 * e]
        if share > _WORTH and clear:
            those = [more[group[i] - n] for i in clear]
            values = step[clear] * [f.size for f in those]
            named = ",".join(f.name for f in those) if name == "bias" else name
            earlier = assumed.inputs == "held" and name == "delay" and step[0] < 0.0
            option = "--inputs linear or smooth" if earlier else f"--unknown {named}"
            each = ", ".join(
                f"{f.name} {v:.2g} {f.unit}" for f, v in zip(those, values, strict=True)
            )
            told.append((share, f"{option} lowers the sum of squares by {share:.0%} ({each})"))
    most = max((share for share, _ in told), default=0.0)
    return [text for share, text in sorted(told, reverse=True) if share > _BESIDE * most]
