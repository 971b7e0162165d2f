"""Observation of one tracker: egocentric, of fixed width, padded with zeros behind flags."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uuvsim_cosim.envs.task.task import Array, Mask, Symmetry
from uuvsim_cosim.envs.tasks.coordinates import level

__all__ = ["OBSTACLE", "OTHER", "OWN", "TARGET", "Seen", "egocentric", "largest", "symmetries"]


OWN = 8  # N and E over half the arena, cos and sin of heading, u v, r, wanted u
TARGET = 6  # known?, ahead and to starboard [m], distance [m], how it moved over the stride
OTHER = 7  # there?, ahead and to starboard [m], its heading's cos and sin from mine, its u and r
OBSTACLE = 5  # there?, ahead and to starboard [m], radius [m], distance of its surface [m]


@dataclass(frozen=True)
class Seen:
    """The knowledge of all trackers, in N E D."""

    eta: Array  # (n, N, 6)
    nu: Array  # (n, N, 6)
    u_d: Array  # (n, N) wanted surge speed, m/s
    target: Array  # (n, N, 2) as each knows it
    target_before: Array  # (n, N, 2) an action earlier
    known: Mask  # (n, N) whether each knows it
    obstacles: Array  # (n, M, 3) N, E, radius
    reaches: Mask  # (n, M)


def largest(slots: tuple[int, int], arena: tuple[float, float]) -> Array:
    """Return the largest size of each number of an observation with such slots."""
    far = float(np.hypot(*arena))
    own = [1.5, 1.5, 1.0, 1.0, 3.0, 3.0, 5.0, 1.5]
    target = [1.0, far, far, far, 5.0, 5.0]
    other = [1.0, far, far, 1.0, 1.0, 3.0, 5.0]
    obstacle = [1.0, far, far, 1.0, far]
    return np.array(own + target + other * slots[0] + obstacle * slots[1])


def symmetries(slots: tuple[int, int]) -> tuple[Symmetry, ...]:
    """Return three symmetries: the mirror image (East changes its sign), the half turn, and both.

    An action is a surge acceleration and a yaw rate.
    """
    own, target, other = (
        (1, -1, 1, -1, 1, -1, -1, 1),
        (1, 1, -1, 1, 1, -1),
        (1, 1, -1, 1, -1, 1, -1),
    )
    mirrored = np.array(own + target + other * slots[0] + (1, 1, -1, 1, 1) * slots[1], float)
    turned = np.ones_like(mirrored)
    turned[:4] = -1.0  # N, E, cos and sin of heading: all else is egocentric
    both, as_it_is = np.array([1.0, -1.0]), np.ones(2)
    return (
        Symmetry("mirror", mirrored, both),
        Symmetry("half turn", turned, as_it_is),
        Symmetry("mirror and half turn", mirrored * turned, both),
    )


def egocentric(
    i: int, seen: Seen, slots: tuple[int, int], arena: tuple[float, float], v: float, stride: float
) -> Array:
    """Return tracker i's observation (n, width), with other trackers and obstacles nearest first.

    `slots` are the numbers of other trackers and of obstacles in the observation, `arena` is its
    size [m], `v` the largest surge speed [m/s], `stride` the distance covered at it in an action
    [m].
    """
    eta, nu = seen.eta[:, i], seen.nu[:, i]
    here, psi = eta[:, :2], eta[:, 5]
    n = len(eta)
    known = seen.known[:, i]
    to_target = level(psi, seen.target[:, i] - here)
    moved = level(psi, seen.target[:, i] - seen.target_before[:, i]) / stride
    target = [known, to_target[:, 0], to_target[:, 1], _size(to_target), moved[:, 0], moved[:, 1]]
    columns = [
        here[:, 0] / (arena[0] / 2),
        here[:, 1] / (arena[1] / 2),
        np.cos(psi),
        np.sin(psi),
        nu[:, 0] / v,
        nu[:, 1] / v,
        nu[:, 5],
        seen.u_d[:, i] / v,
        *(np.where(known, x, 0.0) for x in target),
    ]
    others = [j for j in range(seen.eta.shape[1]) if j != i]
    parts = [np.stack(columns, axis=1)]
    if slots[0]:
        eta_j, nu_j = seen.eta[:, others], seen.nu[:, others]
        away = level(psi, eta_j[:, :, :2] - here[:, None])
        turned = eta_j[:, :, 5] - psi[:, None]
        there = np.ones(away.shape[:2], bool)
        rows = [away[..., 0], away[..., 1], np.cos(turned), np.sin(turned), nu_j[..., 0] / v,
                nu_j[..., 5]]  # fmt: skip
        parts.append(_slots(there, rows, _size(away), slots[0], n))
    if slots[1]:
        away = level(psi, seen.obstacles[:, :, :2] - here[:, None])
        surface = _size(away) - seen.obstacles[:, :, 2]
        rows = [away[..., 0], away[..., 1], seen.obstacles[:, :, 2], surface]
        parts.append(_slots(seen.reaches, rows, surface, slots[1], n))
    return np.concatenate(parts, axis=1)


def _slots(there: Mask, rows: list[Array], key: Array, count: int, n: int) -> Array:
    """Return the `count` nearest present ones, each a flag and its rows, as one row."""
    table = np.stack([there.astype(float), *rows], axis=2) * there[:, :, None]
    order = np.argsort(np.where(there, key, np.inf), axis=1, kind="stable")[:, :count]
    chosen = np.take_along_axis(table, order[:, :, None], axis=1)
    result = np.zeros((n, count, table.shape[2]))
    result[:, : chosen.shape[1]] = chosen
    return result.reshape(n, -1)


def _size(v: Array) -> Array:
    return np.asarray(np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2))
