"""Target tracking's reward, equation (7), as a function of positions in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.tasks.tracking_rules import TrackingRules

__all__ = ["Scene", "Terms", "distances", "lambda_2", "reward_terms"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
CONNECTED = 1e-9  # lambda_2 above it


@dataclass(frozen=True)
class Scene:
    """All positions at one instant, in the horizontal plane [m]."""

    trackers: Array  # (n, N, 2)
    target: Array  # (n, 2)
    obstacles: Array  # (n, M, 3): N, E, radius
    reaches: Mask  # (n, M): which obstacles are tall enough to count


@dataclass(frozen=True)
class Terms:
    """The terms of the reward, of shape (n,) or (n, N)."""

    r_c: Array
    r_t: Array
    r_a: Array
    p_1: Array
    p_2: Array
    p_3: Array
    nearest: Array  # m, of a tracker to the target

    @property
    def violated(self) -> Mask:
        """The trackers with a penalty, of shape (n, N)."""
        return np.asarray((self.p_1 != 0) | (self.p_2 != 0) | (self.p_3 != 0))

    def rewards(self, rules: TrackingRules) -> Array:
        """Return each tracker's reward, of shape (n, N)."""
        own = rules.w_t * self.r_t + rules.w_a * self.r_a
        own = own + rules.w_p * (self.p_1 + self.p_2 + self.p_3)
        if rules.credit == "team":
            own = np.repeat(own.mean(axis=1, keepdims=True), own.shape[1], axis=1)
        return np.asarray(own + rules.w_c * self.r_c[:, None])


def distances(a: Array, b: Array) -> Array:
    """Return distances (n, A, B) between points (n, A, 2) and (n, B, 2)."""
    d = a[:, :, None, :2] - b[:, None, :, :2]
    return np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2)


def lambda_2(trackers: Array, rules: TrackingRules) -> Array:
    """Return the second smallest eigenvalue of the team graph's Laplacian, (n,); 0 for one."""
    n, N, _ = trackers.shape
    if N == 1:
        return np.zeros(n)
    d = distances(trackers, trackers)
    if rules.edges == "range":
        weight = (d <= 2.0 * rules.d_m).astype(float)
    else:
        weight = np.exp(-0.5 * (d / rules.d_m) ** 2)
    if N == 2:
        return np.asarray(2.0 * weight[:, 0, 1])
    weight[:, np.arange(N), np.arange(N)] = 0.0
    laplacian = -weight
    laplacian[:, np.arange(N), np.arange(N)] = weight.sum(axis=2)
    # Row by row, so that the last bit does not depend on n; 0 is exact only up to rounding.
    second = np.linalg.eigvalsh(laplacian)[:, 1]
    return np.where(second > CONNECTED, second, 0.0)


def reward_terms(now: Scene, before: Scene, rules: TrackingRules, stride: float) -> Terms:
    """Return the terms of the action that led from `before` to `now`; `stride` is v_max dt [m]."""
    N = now.trackers.shape[1]
    d = distances(now.trackers, now.target[:, None])[:, :, 0]
    earlier = distances(before.trackers, before.target[:, None])[:, :, 0]
    second = lambda_2(now.trackers, rules)
    connected = second / N if rules.connectivity == "algebraic" else (second >= 0.0).astype(float)
    if rules.approach == "potential":
        approach = np.clip((earlier - d) / stride, -1.0, 1.0)
    else:
        approach = (d < earlier).astype(float)
    others = distances(now.trackers, now.trackers)
    others[:, np.arange(N), np.arange(N)] = np.inf
    surfaces = distances(now.trackers, now.obstacles) - now.obstacles[:, None, :, 2]
    surfaces = np.where(now.reaches[:, None, :], surfaces, np.inf)
    return Terms(
        r_c=rules.r_c * connected,
        r_t=np.where(d <= rules.d_m, rules.r_t, 0.0),
        r_a=rules.r_a * approach,
        p_1=_punished(others.min(axis=2) < rules.d_su, rules.p_1),
        p_2=_punished(d < rules.d_st, rules.p_2),
        p_3=_punished(surfaces.min(axis=2, initial=np.inf) < rules.d_so, rules.p_3),
        nearest=d.min(axis=1),
    )


def _punished(where: Mask, penalty: float) -> Array:
    return np.where(where, penalty, 0.0)
