"""Predictions of a declared model from points of a recording, with nothing from behind a point.

The state at a point is estimated from the seconds before it: the model's trajectory through that
window that fits the measurements best (moving-horizon estimate, by steps of Gauss and Newton). From
there the model runs freely with the recorded inputs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.recording.signals import Signals
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.studies.identification.fitted_model import GreyBox
from uuvsim_cosim.studies.identification.parameters import wanted_parameters
from uuvsim_cosim.studies.identification.sensitivities import Windows
from uuvsim_cosim.studies.identification.shooting import measured_motion
from uuvsim_cosim.studies.identification.signals import ANGLES, Grid, Lookup, grid_of

__all__ = ["Predictor"]

Array = NDArray[np.float64]
# Noise that is assumed of N E D [m], angles, u v w [m/s], p q r [rad/s].
_NOISE = np.array([0.02] * 3 + [0.01] * 3 + [0.02] * 3 + [0.02] * 3)
# Deviations of the first guess of position [m], attitude, u v w [m/s], p q r [rad/s], other states.
_GUESS = {"p": 1.0, "q_nb": 0.3, "nu_b": np.array([0.2] * 3 + [0.3] * 3)}
_OTHERS = 10.0
_ITERATIONS = 5
_SHORTER, _FAR = (1, 4, 16), 1e3  # of a step; m, rad, m/s and rad/s


@final
class Predictor:
    """A system's hull over a recording: predictions of what was measured, from any point.

    `adapted` are parameters that drift, as a vehicle's trim does, with the standard deviation of
    their changes: they are estimated with the state from the `past` seconds before a point.
    """

    def __init__(
        self,
        system: System,
        hull: str,
        signals: Signals,
        step: float,
        span: tuple[float, float],
        *,
        past: float = 3.0,
        adapted: Mapping[str, float] | None = None,
    ) -> None:
        plan = flatten(system.with_mismatches("warn"))
        at = next(i for i, c in enumerate(plan.components) if c.path == hull)
        drifting = wanted_parameters(plan, at, list(adapted)) if adapted else []
        self.box = GreyBox(plan, at, drifting, exact=False)
        self.grid: Grid = grid_of(
            self.box, Lookup(signals, {}), h=step, first=span[0], last=span[1]
        )
        if not np.isfinite(self.grid.y).any():
            raise InputInvalid(f"no measurement of {hull} from {span[0]:g} to {span[1]:g} s")
        self.m = round(past / step)
        self._theta = np.array([f.start for f in drifting])
        self._deviations = np.array(list((adapted or {}).values()))
        self._windows = Windows(self.box, self.grid.w[:, :1].T[None], step)
        self._quaternion = self.box.x_places[self.box.hull, "q_nb"]
        self._spread = np.full(self.box.x.numel(), _OTHERS)
        for name, deviation in _GUESS.items():
            self._spread[self.box.x_places[self.box.hull, name]] = deviation
        self._estimates: dict[int, tuple[Array, Array]] = {}

    def predict(self, at: NDArray[np.int64], steps: int) -> Array:
        """Return predictions (len(at), steps + 1, 12) from the points `at` on."""
        with np.errstate(over="ignore", invalid="ignore"):
            return np.stack([self._free(k, steps) for k in at.tolist()])

    def _free(self, k: int, steps: int) -> Array:
        """Return the free motion (steps + 1, 12) from a point on.

        Strong damping makes long steps of Runge-Kutta unstable: a motion beyond all bounds is
        computed again in shorter ones.
        """
        usual = self._windows.pieces
        try:
            for shorter in _SHORTER:
                self._windows.pieces = shorter * usual
                if k not in self._estimates or shorter > 1:
                    self._estimates[k] = self._estimate(k)
                x, theta = self._estimates[k]
                y: Array = self._from(k, steps)(x[None], theta)[0][0]
                if np.abs(y).max() < _FAR:  # not if it is NaN
                    break
        finally:
            self._windows.pieces = usual
        return y

    def _from(self, first: int, steps: int) -> Windows:
        """Return the kernel with the inputs of a window."""
        self._windows.inputs = np.ascontiguousarray(self.grid.w[:, first : first + steps].T[None])
        return self._windows

    def _estimate(self, k: int) -> tuple[Array, Array]:
        """Estimate the state (n_x,) at a point and the parameters that drift, from before it."""
        first, q = k - self.m, self._quaternion
        y = self.grid.y[:, first : k + 1].T
        guess = self._guess(first)
        n_x = len(guess)
        scale = np.concatenate([np.maximum(np.abs(guess), 0.1), self._deviations])
        prior = (scale / np.concatenate([self._spread, self._deviations])) ** 2
        weights = np.where(np.isfinite(y), 1.0 / _NOISE, 0.0)
        start = np.concatenate([guess, self._theta])
        best, least, z = start, np.inf, start.copy()
        for _ in range(_ITERATIONS):
            found, derivative, _, _ = self._from(first, self.m)(z[None, :n_x], z[n_x:])
            residual = np.nan_to_num(found[0] - y, posinf=0.0, neginf=0.0)
            residual[:, ANGLES] = np.arctan2(
                np.sin(residual[:, ANGLES]), np.cos(residual[:, ANGLES])
            )
            right = (residual * weights).ravel()
            away = (z - start) / scale
            cost = float(right @ right + prior @ away**2)
            if not (np.isfinite(found[0][np.isfinite(y)]).all() and cost < least):
                break
            best, least = z.copy(), cost
            rows = (derivative[0] * scale * weights[..., None]).reshape(-1, len(z))
            normal = rows.T @ rows + np.diag(prior)
            if not np.isfinite(normal).all():
                break
            z = z - scale * np.linalg.solve(normal, rows.T @ right + prior * away)
            z[q] /= np.linalg.norm(z[q])
        end = self._from(first, self.m)(best[None, :n_x], best[n_x:])[2][0]
        if not np.isfinite(end).all():
            return guess, self._theta
        end[q] /= np.linalg.norm(end[q])
        return end, best[n_x:]

    def _guess(self, first: int) -> Array:
        """Return a first guess of the state at a point, from the window that begins there."""
        from scipy.spatial.transform import Rotation

        grid, box, m = self.grid, self.box, self.m
        part = slice(first, first + m + 1)
        window = replace(grid, t=grid.t[: m + 1], y=grid.y[:, part], runs=((0, m),))
        y = measured_motion(window)[:, 0]
        out = box.start().copy()
        out[box.x_places[box.hull, "p"]] = y[:3]
        attitude = Rotation.from_euler("ZYX", y[[5, 4, 3]])
        out[self._quaternion] = attitude.as_quat(scalar_first=True)
        out[box.x_places[box.hull, "nu_b"]] = y[6:]
        return out
