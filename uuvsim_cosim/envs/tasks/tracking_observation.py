"""Observation of one tracker: egocentric, of fixed width; flags mark the slots in use.

`egocentric` is for arrays of n environments, `egocentric_expression` for the symbols of one. Both
have the same operations in the same order, and so the same bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.expressions import sin_cos
from uuvsim_cosim.envs.task.task import Array, Mask, Symmetry
from uuvsim_cosim.envs.tasks.coordinates import level

__all__ = [
    "OBSTACLE", "OTHER", "OWN", "TARGET", "Seen", "egocentric", "egocentric_expression", "largest",
    "symmetries",
]  # fmt: skip


OWN = 8  # N and E over half the arena, cos and sin of heading, u v, r, wanted u
TARGET = 6  # known?, ahead and to starboard [m], distance [m], how it moved over the stride
OTHER = 7  # there?, ahead and to starboard [m], its heading's cos and sin from mine, its u and r
OBSTACLE = 5  # there?, ahead and to starboard [m], radius [m], distance of its surface [m]


@dataclass(frozen=True)
class Seen:
    """Knowledge of all trackers, in N E D: arrays, or symbols without the first axis."""

    eta: Any  # (n, N, 6)
    nu: Any  # (n, N, 6)
    u_d: Any  # (n, N) wanted surge speed, m/s
    target: Any  # (n, N, 2) target's position as each tracker knows it
    target_before: Any  # (n, N, 2) the same, one action earlier
    known: Any  # (n, N) whether each tracker knows it
    obstacles: Any  # (n, M, 3) N, E, radius
    reaches: Any  # (n, M)


def largest(slots: tuple[int, int], arena: tuple[float, float]) -> Array:
    """Return the upper limit of each number of an observation; the lower one is its negative."""
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
    turned[:4] = -1.0  # N, E, cosine and sine of the heading; the rest is egocentric
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
    s, c = sin_cos(psi)
    columns = [
        here[:, 0] / (arena[0] / 2),
        here[:, 1] / (arena[1] / 2),
        c,
        s,
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
        s, c = sin_cos(eta_j[:, :, 5] - psi[:, None])
        there = np.ones(away.shape[:2], bool)
        rows = [away[..., 0], away[..., 1], c, s, nu_j[..., 0] / v,
                nu_j[..., 5]]  # fmt: skip
        parts.append(_slots(there, rows, _size(away), slots[0], n))
    if slots[1]:
        away = level(psi, seen.obstacles[:, :, :2] - here[:, None])
        surface = _size(away) - seen.obstacles[:, :, 2]
        rows = [away[..., 0], away[..., 1], seen.obstacles[:, :, 2], surface]
        parts.append(_slots(seen.reaches, rows, surface, slots[1], n))
    return np.concatenate(parts, axis=1)


def _slots(there: Mask, rows: list[Array], key: Array, count: int, n: int) -> Array:
    """Return the `count` nearest present objects as one row; each has a flag and its numbers."""
    table = np.stack([there.astype(float), *rows], axis=2) * there[:, :, None]
    order = np.argsort(np.where(there, key, np.inf), axis=1, kind="stable")[:, :count]
    chosen = np.take_along_axis(table, order[:, :, None], axis=1)
    result = np.zeros((n, count, table.shape[2]))
    result[:, : chosen.shape[1]] = chosen
    return result.reshape(n, -1)


def egocentric_expression(
    i: int, seen: Seen, slots: tuple[int, int], arena: tuple[float, float], v: float, stride: float
) -> Any:
    """Return `egocentric` as a CasADi column; `seen` has symbols, with the first axis left out.

    `eta` and `nu` are sequences of columns, `target`, `target_before` of pairs, and `obstacles` of
    triples.
    """
    import casadi as ca

    eta, nu, psi = seen.eta[i], seen.nu[i], seen.eta[i][5]
    c, s = ca.cos(psi), ca.sin(psi)

    def level_at(x: Any, y: Any) -> tuple[Any, Any]:
        return c * x + s * y, c * y - s * x

    def size(x: Any, y: Any) -> Any:
        return ca.sqrt(x * x + y * y)

    known, there, before = seen.known[i], seen.target[i], seen.target_before[i]
    x, y = level_at(there[0] - eta[0], there[1] - eta[1])
    u, w = level_at(there[0] - before[0], there[1] - before[1])
    target = [known, x, y, size(x, y), u / stride, w / stride]
    columns = [
        eta[0] / (arena[0] / 2),
        eta[1] / (arena[1] / 2),
        c,
        s,
        nu[0] / v,
        nu[1] / v,
        nu[5],
        seen.u_d[i] / v,
        *(ca.if_else(known, x, 0.0) for x in target),
    ]
    rows = []
    for j in range(len(seen.eta)) if slots[0] else ():
        if j == i:
            continue
        x, y = level_at(seen.eta[j][0] - eta[0], seen.eta[j][1] - eta[1])
        turned, distance = seen.eta[j][5] - psi, size(x, y)
        row = [x, y, ca.cos(turned), ca.sin(turned), seen.nu[j][0] / v, seen.nu[j][5]]
        rows.append((ca.SX(1.0), distance, row))
    columns += _slots_expression(rows, slots[0], OTHER)
    rows = []
    for (north, east, radius), reaches in zip(seen.obstacles, seen.reaches, strict=True):
        x, y = level_at(north - eta[0], east - eta[1])
        surface = size(x, y) - radius
        rows.append((reaches, surface, [x, y, radius, surface]))
    columns += _slots_expression(rows, slots[1], OBSTACLE)
    return ca.vertcat(*columns)


def _slots_expression(rows: Sequence[Any], count: int, width: int) -> list[Any]:
    """Return the numbers of `count` slots: the rows sorted by their key, the nearest first."""
    import casadi as ca

    table = [
        [ca.if_else(there, key, np.inf), there, *(there * x for x in row)]
        for there, key, row in rows
    ]
    for end in range(len(table) - 1, 0, -1):  # equal keys keep their order
        for k in range(end):
            near, far = table[k], table[k + 1]
            swap = near[0] > far[0]
            pairs = list(zip(near, far, strict=True))
            table[k] = [ca.if_else(swap, b, a) for a, b in pairs]
            table[k + 1] = [ca.if_else(swap, a, b) for a, b in pairs]
    chosen = [x for row in table[:count] for x in row[1:]]
    return [*chosen, *[ca.SX(0.0)] * (count * width - len(chosen))]


def _size(v: Array) -> Array:
    return np.asarray(np.sqrt(v[..., 0] ** 2 + v[..., 1] ** 2))
