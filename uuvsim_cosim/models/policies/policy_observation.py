"""The egocentric observation of target tracking as expressions: that of its Gymnasium task.

What `envs/tasks/tracking_observation.py` computes in arrays; a test holds both equal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca
import numpy as np

from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.safe_math import norm

__all__ = ["Seen", "egocentric", "largest"]


# Whether it is there, its distance, and its numbers.
_Row: TypeAlias = tuple[Number, ca.SX, Sequence[Number]]


@dataclass(frozen=True)
class Seen:
    """What a tracker knows; positions from the arena's middle, in N and E [m]."""

    eta: ca.SX  # (6,)
    nu: ca.SX  # (6,)
    u_d: ca.SX  # wanted surge speed, m/s
    target: ca.SX  # (2,)
    target_before: ca.SX  # (2,) an action earlier
    known: Number  # whether the target is
    others: Sequence[tuple[ca.SX, ca.SX]]  # eta, nu
    obstacles: Sequence[tuple[ca.SX, ca.SX, ca.SX, ca.SX]]  # N, E, radius, whether it reaches up


def largest(slots: Sequence[int], arena: Sequence[float]) -> np.ndarray:
    """Return the largest size of each number of an observation (width,)."""
    far = float(np.hypot(arena[0], arena[1]))
    own = [1.5, 1.5, 1.0, 1.0, 3.0, 3.0, 5.0, 1.5]
    target = [1.0, far, far, far, 5.0, 5.0]
    other = [1.0, far, far, 1.0, 1.0, 3.0, 5.0]
    obstacle = [1.0, far, far, 1.0, far]
    return np.array(own + target + other * slots[0] + obstacle * slots[1])


def egocentric(
    seen: Seen, slots: Sequence[int], arena: Sequence[float], v: float, stride: float
) -> ca.SX:
    """Return the observation (width,); `v` [m/s] and `stride` [m] are its scales."""
    psi = seen.eta[5]
    here = seen.eta[:2]
    to_target = _level(psi, seen.target - here)
    moved = _level(psi, seen.target - seen.target_before) / stride
    target = [to_target[0], to_target[1], _size(to_target), moved[0], moved[1]]
    own = [
        here[0] / (arena[0] / 2),
        here[1] / (arena[1] / 2),
        ca.cos(psi),
        ca.sin(psi),
        seen.nu[0] / v,
        seen.nu[1] / v,
        seen.nu[5],
        seen.u_d / v,
    ]
    others: list[_Row] = []
    for eta, nu in seen.others:
        away, turned = _level(psi, eta[:2] - here), eta[5] - psi
        row: list[Number] = [
            1.0,
            away[0],
            away[1],
            ca.cos(turned),
            ca.sin(turned),
            nu[0] / v,
            nu[5],
        ]
        others.append((1.0, _size(away), row))
    obstacles: list[_Row] = []
    for north, east, radius, reaches in seen.obstacles:
        away = _level(psi, ca.vertcat(north, east) - here)
        surface = _size(away) - radius
        obstacles.append((reaches, surface, [1.0, away[0], away[1], radius, surface]))
    return ca.vertcat(
        *own,
        seen.known,
        *(ca.if_else(seen.known, x, 0.0) for x in target),
        *_slots(others, slots[0], 7),
        *_slots(obstacles, slots[1], 5),
    )


def _slots(rows: Sequence[_Row], count: int, width: int) -> list[Number]:
    """Return the `count` nearest that are there, (there, key, numbers), flat; zeros for none."""
    flat: list[Number] = []
    ranks = []
    for i, (_, key, _) in enumerate(rows):
        nearer: Number = 0.0
        for j, (there, other, _) in enumerate(rows):
            if i != j:
                first = other <= key if j < i else other < key
                nearer += ca.if_else(ca.logic_and(there, first), 1.0, 0.0)
        ranks.append(nearer)
    for place in range(count):
        for column in range(width):
            value: Number = 0.0
            for (there, _, numbers), rank in zip(rows, ranks, strict=True):
                mine = ca.logic_and(there, ca.fabs(rank - place) < 0.5)
                value = ca.if_else(mine, numbers[column], value)
            flat.append(value)
    return flat


def _level(psi: ca.SX, vector: ca.SX) -> ca.SX:
    c, s = ca.cos(psi), ca.sin(psi)
    return ca.vertcat(c * vector[0] + s * vector[1], c * vector[1] - s * vector[0])


def _size(v: ca.SX) -> ca.SX:
    return norm(v)
