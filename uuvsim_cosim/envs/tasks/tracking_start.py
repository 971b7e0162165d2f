"""Start of an episode of target tracking: uniform in the arena, with safe distances (legal)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.tasks.tracking_reward import TrackingRules
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.guidance.target import WAYPOINTS

__all__ = ["Arena", "Drawn", "drawn_scene", "legal_start", "waypoints"]

Array = NDArray[np.float64]
TRIES = 400
RADIUS, TALL = (0.1, 0.2), (0.7, 1.1)  # m, of obstacles


@dataclass(frozen=True)
class Arena:
    """Size of the arena, whose middle is at N = E = 0, and the distances of a legal start."""

    size: tuple[float, float, float] = (2.6, 4.8, 1.1)  # m, along N, E, D
    from_wall: float = 0.3  # m, of trackers and of the surfaces of obstacles
    target_from_wall: float = 0.25  # m
    clearance: float = 0.05  # m, in addition to the safe distances
    target_clearance: float = 0.3  # m, of the target from the surfaces of obstacles


@dataclass(frozen=True)
class Drawn:
    """All poses at the start [m, rad]; obstacles are N, E, radius, height."""

    trackers: Array  # (n, N, 2)
    psi: Array  # (n, N)
    target: Array  # (n, 2)
    psi_target: Array  # (n,)
    obstacles: Array  # (n, M, 4)


def drawn_scene(
    draws: Draws, arena: Arena, rules: TrackingRules, n_trackers: int, n_obstacles: int
) -> Drawn:
    """Draw a legal start, headings, and obstacles of 0.1 to 0.2 m radius, 0.7 to 1.1 m tall."""
    tall = draws.uniform("obstacles/height", *TALL, (n_obstacles,))
    radii = draws.uniform("obstacles/radius", *RADIUS, (n_obstacles,))
    trackers, target, places = legal_start(draws, arena, rules, n_trackers, radii)
    return Drawn(
        trackers,
        draws.uniform("start/psi", -np.pi, np.pi, (n_trackers,)),
        target,
        draws.uniform("target/psi", -np.pi, np.pi),
        np.concatenate([places, radii[..., None], tall[..., None]], axis=2),
    )


def waypoints(draws: Draws, arena: Arena) -> dict[str, Array]:
    """Draw the path of a target: four waypoints, one in each quarter of the arena, in order."""
    x, y = (s / 2 - 0.4 for s in arena.size[:2])
    share = draws.uniform("target/path", 0.2, 1.0, (4, 2))
    points = np.zeros((draws.n, WAYPOINTS, 2))
    points[:, :4] = share * [[x, y], [x, -y], [-x, -y], [-x, y]]
    return {"target.waypoints": points, "target.count": np.full(draws.n, 4.0)}


def legal_start(
    draws: Draws, arena: Arena, rules: TrackingRules, n_trackers: int, radii: Array
) -> tuple[Array, Array, Array]:
    """Draw trackers (n, N, 2), target (n, 2) and obstacles (n, M, 2) [m]; radii are (n, M).

    Obstacles are placed first, then the target, then the trackers; each is drawn again, as
    "start/1", "start/2", ..., until it is legal. Raises InputInvalid where there is no room.
    """
    n, M = draws.n, radii.shape[1]
    total = M + 1 + n_trackers
    types = np.array([2] * M + [1] + [0] * n_trackers)
    # Least distances of two types: 0 a tracker, 1 the target, 2 an obstacle.
    least = np.zeros((3, 3))
    least[0] = least[:, 0] = np.array([rules.d_su, rules.d_st, rules.d_so]) + arena.clearance
    least[1, 2] = least[2, 1] = arena.target_clearance
    own = np.zeros((n, total))
    own[:, :M] = radii
    gap = own[:, :, None] + own[:, None, :] + least[types[:, None], types]
    wall = np.where(types == 1, arena.target_from_wall, arena.from_wall) + own
    half = np.array(arena.size[:2]) / 2 - wall[:, :, None]
    if np.any(half <= 0):
        raise InputInvalid(f"arena {arena.size[:2]} m", "no room at all", "a larger one")
    points = np.full((n, total, 2), np.inf)
    placed = np.zeros((n, total), bool)
    for k in range(TRIES):
        rows = np.flatnonzero(~placed.all(axis=1))
        if not len(rows):
            break
        tried = draws.rows(rows).uniform(f"start/{k}", -1.0, 1.0, (total, 2)) * half[rows]
        for i in range(total):
            d = tried[:, i, None, :] - points[rows]
            far = np.sqrt(d[..., 0] ** 2 + d[..., 1] ** 2) >= gap[rows, i]
            # One after the other, so that the order of placing is the same in every try.
            ready = ~placed[rows, i] & placed[rows, :i].all(axis=1)
            good = rows[ready & np.all(far | ~placed[rows], axis=1)]
            points[good, i] = tried[np.isin(rows, good), i]
            placed[good, i] = True
    if not placed.all():
        raise InputInvalid(
            (
                f"no legal start in {TRIES} tries for {n_trackers} trackers and {M} "
                f"obstacles in {arena.size[0]} x {arena.size[1]} m"
            ),
            "fewer, or a larger arena",
        )
    return points[:, M + 1 :], points[:, M], points[:, :M]
