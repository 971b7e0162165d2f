"""Least-squares problem of a fit: windows of a recording, joined without gaps, and its steps.

    min over theta, s_0 … s_S   sum of (y_k - h(x_k, w_k, theta))² / sigma²
    such that each window of the recording, started at s_i, ends at s_(i + 1)

(direct multiple shooting; Bock 1983). A step of Gauss and Newton eliminates the windows of a run
from its end: the rows that hold for s_(i + 1) become rows for s_i and theta, and a QR decomposition
keeps them few (as in a square-root information filter). Parts of the recording that are left out
separate its runs, each with an initial state of its own.

If residuals are autoregressive, e_k = rho e_(k - 1) + innovation, rows are differences of
successive residuals, so that the innovations are minimised. The end of a window is the start of the
next one, so that no difference between windows is lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.sensitivities import Windows
from uuvsim_cosim.studies.identification.signals import ANGLES, Grid

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["PRIOR", "Noise", "Point", "Shooting", "measured_motion"]

Array = NDArray[np.float64]
_WINDOW = 3.0  # s
PRIOR = 3e-2  # of theta, over its scale: too weak to matter unless the data hold no information
_WEAK = 0.1  # weight of a run's first state, where the data do not determine it
_BETWEEN = 64  # points that separate runs in a series
_ALONE = 6000  # elements of a matrix that one thread decomposes
_GROWTH = 1e10  # of the derivatives over the windows of a run, beyond which it is cut


@dataclass(frozen=True)
class Noise:
    """Of each signal (12,): sigma of residuals, or of innovations, and their correlation rho."""

    sigma: Array
    rho: Array


@dataclass(frozen=True)
class Point:
    """The problem linearised at (theta, s), in scaled variables.

    `rows` (S, (m + 1) signals, n_x + n_p + 1) are derivatives and residuals of the measurements,
    `A`, `B` and `gap` those of the windows' ends, `objective` is half of the sum of squares.
    """

    theta: Array
    starts: Array
    residual: Array  # (S, m + 1, 12), in SI units, NaN where nothing was measured
    rows: Array
    A: Array
    B: Array
    gap: Array  # (S, n_x), zero where a run ends
    objective: float

    @property
    def is_finite(self) -> bool:
        """Whether all trajectories are finite."""
        return bool(np.isfinite(self.objective) and np.isfinite(self.gap).all())


@final
class Shooting:
    """The windows of a recording, and the steps of the fit."""

    def __init__(self, box: GreyBox, grid: Grid) -> None:
        self.box = box
        self.n_x, self.n_p = box.x.numel(), len(box.fitted)
        self.theta = np.array([f.start for f in box.fitted])
        self.scale = np.array([f.scale for f in box.fitted])
        self.grid = grid
        self.m = max(1, round(_WINDOW / grid.h))
        places = [(a, b, k) for a, b in grid.runs for k in range(a, b, self.m)]
        count = len(places)
        self.y = np.full((count, self.m + 1, 12), np.nan)
        self.own = np.zeros((count, self.m + 1), bool)  # its last point is that of the next window
        self.follows = np.zeros(count, bool)  # the window before
        self.steps = np.zeros((count, self.m), int)  # of the grid
        for i, (a, b, k) in enumerate(places):
            steps = min(self.m, b - k)
            self.steps[i] = k + np.minimum(np.arange(self.m), steps - 1)
            self.y[i, : steps + 1] = grid.y[:, k : k + steps + 1].T
            self.own[i, : steps + (k + steps == b)] = True
            self.follows[i] = k > a
        self.windows = Windows(box, self._inputs(grid.w), grid.h)
        self.delay = 0.0 if box.delay is None else float(self.theta[box.delay])
        self.there = np.isfinite(self.y)
        self.seen = self.there & self.own[..., None]
        self.measured = np.flatnonzero(self.seen.any(axis=(0, 1)))  # signals
        self.guess = _guess(self, grid, [k for _, _, k in places])
        self.x_scale = np.maximum(np.abs(self.guess).max(axis=0), 0.1)
        self.cuts = self._cut()

    def at(self, theta: Array, starts: Array, noise: Noise) -> Point:
        """Linearise at theta and the windows' initial states (S, n_x)."""
        with np.errstate(over="ignore", invalid="ignore"):  # of a step that is then refused
            return self._linearised(theta, starts, noise)

    def step(self, point: Point, low: Array, high: Array) -> tuple[Array, Array, float, float]:
        """Return the changes of theta and of the states, and what they do to the objective.

        These are its slope along the changes, and its curvature.
        """
        from scipy.optimize import lsq_linear

        n_x = self.n_x
        first = self._first_rows(point, self._prior(point.starts))
        away = (point.theta - self.theta) / self.scale
        of_theta = [np.column_stack([PRIOR * np.eye(self.n_p), PRIOR * away])]
        of_theta += [rows[n_x:, n_x:] for rows in first.values()]
        stacked = np.vstack(of_theta)
        ends = [(np.asarray(e) - point.theta) / self.scale for e in (low, high)]
        bounds = np.minimum(ends[0], -1e-12), np.maximum(ends[1], 1e-12)
        few = _triangular(stacked)
        solved = lsq_linear(few[:, :-1], -few[:, -1], bounds)
        d_theta = np.asarray(solved.x, dtype=float)
        d_states = np.zeros_like(point.starts)
        for i, follows in enumerate(self.follows):
            if follows:
                d_states[i] = (
                    point.A[i - 1] @ d_states[i - 1] + point.B[i - 1] @ d_theta + point.gap[i - 1]
                )
            else:
                rows = first[i]
                right = rows[:n_x, -1] + rows[:n_x, n_x:-1] @ d_theta
                d_states[i] = -np.linalg.solve(rows[:n_x, :n_x], right)
        d = np.concatenate([d_states, np.tile(d_theta, (len(d_states), 1))], axis=1)
        along = np.einsum("srn,sn->sr", point.rows[..., :-1], d)
        slope = float(np.sum(along * point.rows[..., -1])) + float(PRIOR**2 * away @ d_theta)
        curvature = float(np.sum(along**2)) + float(PRIOR**2 * d_theta @ d_theta)
        firsts = np.flatnonzero(~self.follows).tolist()
        for i, prior in zip(firsts, self._prior(point.starts), strict=True):
            change = prior[:, :n_x] @ d_states[i]
            slope += float(change @ prior[:, -1])
            curvature += float(change @ change)
        return self.scale * d_theta, self.x_scale * d_states, slope, curvature

    def information(self, point: Point, factor: Array | None = None) -> Array:
        """Return the Fisher information of theta (scaled), with all states eliminated.

        `factor` (12,) multiplies the weights of each signal.
        """
        rows = point.rows
        if factor is not None:
            shape = (len(self.follows), self.m + 1, len(self.measured), self.n_x + self.n_p + 1)
            rows = (rows.reshape(shape) * factor[self.measured, None]).reshape(rows.shape)
        weighted = replace(point, rows=rows)
        first = self._first_rows(weighted, [self._weak()] * int(np.sum(~self.follows)))
        of_theta = [r[self.n_x :, self.n_x : -1] for r in first.values()]
        return np.asarray(sum(r.T @ r for r in of_theta), dtype=float)

    def normal_equations(self, point: Point) -> tuple[Array, Array]:
        """Return information and gradient of theta (scaled), with all states eliminated."""
        first = self._first_rows(point, self._prior(point.starts))
        rows = np.vstack([r[self.n_x :, self.n_x :] for r in first.values()])
        return rows[:, :-1].T @ rows[:, :-1], rows[:, :-1].T @ rows[:, -1]

    def moved_by_integration(self, point: Point, noise: Noise) -> Array:
        """Return by how much theta (scaled) would change with steps of half the length."""
        self.windows.pieces *= 2
        try:
            finer = self.at(point.theta, point.starts, noise)
        finally:
            self.windows.pieces //= 2
        rows = point.rows.copy()
        rows[..., -1] = finer.rows[..., -1] - point.rows[..., -1]
        change = replace(point, rows=rows, gap=finer.gap - point.gap)
        first = self._first_rows(change, [self._weak()] * int(np.sum(~self.follows)))
        of_theta = np.vstack([r[self.n_x :, self.n_x :] for r in first.values()])
        prior = np.column_stack([PRIOR * np.eye(self.n_p), np.zeros(self.n_p)])
        R = _triangular(np.vstack([of_theta, prior]))
        return np.asarray(np.linalg.lstsq(R[:, :-1], -R[:, -1])[0], dtype=np.float64)

    def scores(self, point: Point) -> list[Array]:
        """Return, for each run, the scores of theta (scaled) at its points (n, n_p).

        A score is the derivative of half of the point's square, with the run's states eliminated.
        """
        n_x, found = self.n_x, []
        firsts = np.flatnonzero(~self.follows)
        for a, b in zip(firsts, [*firsts[1:], len(self.follows)], strict=True):
            total = np.zeros((b - a, point.rows.shape[1], n_x + self.n_p))
            here = np.eye(n_x, n_x + self.n_p)  # of the window's start by the run's and theta
            for i in range(a, b):
                total[i - a] = point.rows[i, :, :n_x] @ here
                total[i - a, :, n_x:] += point.rows[i, :, n_x:-1]
                here = point.A[i] @ here
                here[:, n_x:] += point.B[i]
            every = total.reshape(-1, n_x + self.n_p)
            weak = np.vstack([every[:, :n_x], _WEAK * np.eye(n_x)])
            R = _triangular(
                np.hstack([weak, np.vstack([every[:, n_x:], np.zeros((n_x, self.n_p))])])
            )
            rest = every[:, n_x:] - every[:, :n_x] @ np.linalg.solve(R[:n_x, :n_x], R[:n_x, n_x:])
            each = rest * point.rows[a:b, :, -1].reshape(-1, 1)
            shape = (b - a, self.m + 1, -1, self.n_p)
            at = self.m * np.arange(b - a)[:, None] + np.arange(self.m + 1)
            series = np.zeros((self.m * (b - a) + 1, self.n_p))
            np.add.at(series, at, each.reshape(shape).sum(axis=2))
            found.append(series)
        return found

    # ---- inside -------------------------------------------------------------------------------

    def _inputs(self, w: Array) -> Array:
        """Return inputs (S, m, 2 n_w) of the windows from those of the grid's steps."""
        return np.ascontiguousarray(w.T[self.steps])

    def _linearised(self, theta: Array, starts: Array, noise: Noise) -> Point:
        around = theta
        if (place := self.box.delay) is not None:  # inputs are delayed, and dw is what is left
            if theta[place] != self.delay and self.grid.inputs is not None:
                self.delay = float(theta[place])
                self.windows.inputs = self._inputs(self.grid.inputs.at(self.delay))
            around = theta.copy()
            around[place] = 0.0
        y, dy, end, dend = self.windows(starts, around)
        residual = y - self.y
        residual[..., ANGLES] = np.arctan2(
            np.sin(residual[..., ANGLES]), np.cos(residual[..., ANGLES])
        )
        scales = np.concatenate([self.x_scale, self.scale])
        j = self.measured
        rows = np.concatenate(
            [dy[:, :, j] * scales, np.nan_to_num(residual[..., j])[..., None]], axis=-1
        )
        residual[~self.seen] = np.nan
        if noise.rho.any():
            rows = self._innovations(rows, noise.rho[j])
        else:
            rows *= self.seen[..., j, None]
        rows /= noise.sigma[j, None]
        rows = rows.reshape(len(starts), -1, self.n_x + self.n_p + 1)
        derivative = dend * scales / self.x_scale[:, None]
        gap = np.zeros_like(end)
        inner = np.flatnonzero(self.follows)
        gap[inner - 1] = (end[inner - 1] - starts[inner]) / self.x_scale
        prior = self._prior(starts)
        squares = float(np.sum(rows[..., -1] ** 2)) + float(
            np.sum((PRIOR * (theta - self.theta) / self.scale) ** 2)
        )
        squares += float(sum(np.sum(p[:, -1] ** 2) for p in prior))
        return Point(
            theta, starts, residual, rows, derivative[..., : self.n_x],
            derivative[..., self.n_x :], gap, 0.5 * squares,
        )  # fmt: skip

    def _weak(self) -> Array:
        weak = np.zeros((self.n_x, self.n_x + self.n_p + 1))
        weak[:, : self.n_x] = _WEAK * np.eye(self.n_x)
        return weak

    def _innovations(self, rows: Array, rho: Array) -> Array:
        """Return differences of successive rows; without a predecessor, rows of less weight."""
        there = self.there[..., self.measured]
        used = there.copy()
        used[self.follows, 0] = False  # the difference to it is in the window before
        least = np.sqrt(1.0 - rho**2)
        new = rows * (used * least)[..., None]
        both = there[:, 1:] & there[:, :-1]
        change = rows[:, 1:] - rho[:, None] * rows[:, :-1]
        new[:, 1:] = np.where(both[..., None], change, new[:, 1:])
        return np.asarray(new, dtype=np.float64)

    def _first_rows(self, point: Point, prior: list[Array]) -> dict[int, Array]:
        """Return, for each run, triangular rows in its first state, theta and the residual."""
        few = _triangular(point.rows)
        priors = dict(zip(np.flatnonzero(~self.follows).tolist(), prior, strict=True))
        found: dict[int, Array] = {}
        behind: Array | None = None
        n_x = self.n_x
        for i in range(len(self.follows) - 1, -1, -1):
            rows = [few[i]]
            if behind is not None:
                s = behind[:, :n_x]
                moved = np.column_stack([s @ point.B[i], s @ point.gap[i]])
                rows.append(np.column_stack([s @ point.A[i], behind[:, n_x:] + moved]))
            if not self.follows[i]:
                rows.append(priors[i])
            few_rows = _triangular(np.vstack(rows))
            if self.follows[i]:
                behind = few_rows
            else:
                found[i], behind = few_rows, None
        return found

    def _prior(self, starts: Array) -> list[Array]:
        """Return weak rows on each run's first state: the length of q, a shaft's speed, others."""
        found = []
        for i in np.flatnonzero(~self.follows):
            rows = []
            for (part, name), place in self.box.x_places.items():
                x = starts[i, place]
                if part == self.box.hull and name == "q_nb":
                    row = np.zeros((1, self.n_x + self.n_p + 1))
                    row[0, place] = 2e2 * x * self.x_scale[place]
                    row[0, -1] = 1e2 * (x @ x - 1.0)
                else:
                    row = np.zeros((len(x), self.n_x + self.n_p + 1))
                    row[:, place] = 0.1 * np.eye(len(x))
                    row[:, -1] = 0.1 * (x - self.guess[i, place]) / self.x_scale[place]
                rows.append(row)
            found.append(np.vstack(rows))
        return found

    def _cut(self) -> int:
        """Cut runs where an unstable model makes the state depend on the first one too strongly."""
        point = self.at(self.theta, self.guess, Noise(np.ones(12), np.zeros(12)))
        cuts, grown = 0, np.eye(self.n_x)
        for i in range(1, len(self.follows)):
            grown = point.A[i - 1] @ grown if self.follows[i] else np.eye(self.n_x)
            if not np.abs(grown).max() < _GROWTH:
                self.follows[i] = False
                cuts, grown = cuts + 1, np.eye(self.n_x)
        return cuts

    def series(self, values: Array) -> Iterator[Array]:
        """Yield values (S, m + 1, 12) of each signal over time, NaN where none is."""
        run = np.cumsum(~self.follows) - 1
        first = self.m * np.arange(len(run)) + _BETWEEN * run
        at = first[:, None] + np.arange(self.m + 1)
        for j in range(12):
            good = np.isfinite(values[..., j])
            found = np.full(int(at[-1, -1]) + 1, np.nan)
            found[at[good]] = values[..., j][good]
            yield found

    def innovations(self, point: Point, noise: Noise) -> Array:
        """Return the residuals (S, m + 1, 12) less what their predecessors tell, NaN for none."""
        j = self.measured
        values = point.rows[..., -1].reshape(len(self.follows), self.m + 1, len(j))
        used = self.there.copy()
        used[self.follows, 0] = False
        found = np.full(self.y.shape, np.nan)
        found[..., j] = np.where(used[..., j], values * noise.sigma[j], np.nan)
        return found if noise.rho.any() else point.residual


def _triangular(rows: Array) -> Array:
    """Return fewer rows with the same sum of squares: R of a QR decomposition.

    Many rows are decomposed in parts: for a larger matrix, libraries of linear algebra start
    threads, which cost more than they gain.
    """
    count, n = rows.shape[-2:]
    parts = -(-count * n // _ALONE)
    if parts > 1 and count > 2 * n:
        each = -(-count // parts)
        padded = np.zeros((*rows.shape[:-2], parts * each, n))
        padded[..., :count, :] = rows
        few = _triangular(padded.reshape(*rows.shape[:-2], parts, each, n))
        rows = few.reshape(*rows.shape[:-2], -1, n)
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=np.float64)


def measured_motion(grid: Grid) -> Array:
    """Return eta and nu (12, n) at every grid point, interpolated; velocities by differences."""
    from scipy.ndimage import uniform_filter1d

    y = grid.y.copy()
    n = y.shape[1]
    for j in range(12):
        good = np.isfinite(y[j])
        if good.any():
            y[j] = np.interp(np.arange(n), np.flatnonzero(good), y[j, good])
    if not np.isfinite(y[2]).all():
        y[2] = 10.0  # deep enough that no surface is near
    y[:6] = np.nan_to_num(y[:6])
    for j in range(6):
        if not np.isfinite(y[6 + j]).all():
            rate = np.gradient(y[j], grid.h)
            y[6 + j] = np.convolve(rate, np.ones(5) / 5, mode="same") if j >= 3 else 0.0
    if not np.isfinite(grid.y[6:9]).any():
        # u v w from positions and attitude, smoothed over five steps
        rates = uniform_filter1d(np.gradient(y[:3], grid.h, axis=1), 5, axis=1)
        y[6:9] = _attitude(y).inv().apply(rates.T).T
    return y


def _attitude(y: Array) -> Rotation:
    from scipy.spatial.transform import Rotation

    return Rotation.from_euler("ZYX", y[[5, 4, 3]].T)


def _guess(problem: Shooting, grid: Grid, places: list[int]) -> Array:
    """Return initial states (S, n_x) of the windows: the hull's measured, the others simulated."""
    box = problem.box
    y = measured_motion(grid)
    out = np.tile(box.start(), (len(places), 1))
    hull = box.hull
    out[:, box.x_places[hull, "p"]] = y[:3, places].T
    out[:, box.x_places[hull, "q_nb"]] = _attitude(y[:, places]).as_quat(scalar_first=True)
    out[:, box.x_places[hull, "nu_b"]] = y[6:, places].T
    others = [p for (i, _), p in box.x_places.items() if i != hull]
    if others:
        end = problem.windows(out, problem.theta)[2]
        inner = np.flatnonzero(problem.follows)
        for place in others:
            out[inner, place] = np.nan_to_num(end[inner - 1, place])
    return out
