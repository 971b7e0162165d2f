"""Trajectory following: stay with a reference that moves along a line, a helix or a lemniscate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols, sin_cos
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.coordinates import in_body, in_body_expression
from uuvsim_cosim.envs.tasks.pose import PoseTask
from uuvsim_cosim.envs.tasks.ranges import pair, within
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.guidance.reference import AHEAD

__all__ = ["CURVES", "TrajectoryFollowing"]

CURVES = ("lemniscate", "helix", "line")


class TrajectoryFollowing(PoseTask):
    """Follow a reference that moves along a curve, which each episode draws anew.

    The shape is drawn from `curves` ("lemniscate", "helix", "line"), the speed within `speed`
    [m/s]. The size (radius 1.5 to 3 m), the course, the sense of rotation and the climb are drawn,
    too. The vehicle starts up to `away` m from the reference along each axis. Reward and other
    options are those of all tasks with a wanted pose (`PoseTask`, docs/learning/tasks.md). The
    observation also has the velocity of the reference in body axes (3), its yaw rate (1), and its
    next 4 points, 0.5 s apart, relative to the vehicle in body axes (12, over 1 m).
    """

    def __init__(
        self,
        *,
        curves: Sequence[str] = CURVES,
        speed: tuple[float, float] = (0.15, 0.4),
        away: float = 0.5,
        **options: Any,
    ) -> None:
        several = isinstance(curves, Sequence) and not isinstance(curves, str)
        unknown = [c for c in curves if c not in CURVES] if several else curves
        if unknown or not curves:
            raise InputInvalid("curves", f"{unknown!r}", f"some of {', '.join(CURVES)}")
        self.speed = pair("speed [m/s]", speed)
        self.away = within("away [m]", away, 0, np.inf)
        signals = ("reference.eta_d", "reference.nu_d", "reference.ahead")
        super().__init__(reference=True, signals=signals, **options)
        self.curves = tuple(curves)

    def wanted(self, m: Moment) -> Array:
        """Return the position of the reference, and its heading."""
        return m["reference.eta_d"][:, [0, 1, 2, 5]]

    def more(self, m: Moment, R: Array) -> list[Array]:
        """Return the velocity of the reference, and its next points."""
        psi = m["reference.eta_d"][:, 5]
        nu_d = m["reference.nu_d"]
        s, c = sin_cos(psi)
        moves = np.stack([nu_d[:, 0] * c, nu_d[:, 0] * s, nu_d[:, 2]], axis=1)
        here = m[f"{self.known}.eta"][:, None, :3]
        ahead = in_body(R, m["reference.ahead"].reshape(m.n, AHEAD, 3) - here)
        return [in_body(R, moves), nu_d[:, 5:], ahead.reshape(m.n, -1)]

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return the expressions of the task, which has no privileged observations."""
        import casadi as ca

        point, nu_d, ahead = (m[f"reference.{name}"] for name in ("eta_d", "nu_d", "ahead"))
        here = m[f"{self.known}.eta"]

        def more(R: Any) -> list[Any]:
            moves = [nu_d[0] * ca.cos(point[5]), nu_d[0] * ca.sin(point[5]), nu_d[2]]
            parts = [*in_body_expression(R, moves), nu_d[5]]
            for i in range(AHEAD):
                away = [ahead[3 * i + k] - here[k] for k in range(3)]
                parts += in_body_expression(R, away)
            return parts

        return self.pose_expressions(m, [point[k] for k in (0, 1, 2, 5)], more)

    def path(self, m: Moment) -> Array:
        """Return the reference and its next points."""
        here = m["reference.eta_d"][:, None, :3]
        return np.concatenate([here, m["reference.ahead"].reshape(m.n, AHEAD, 3)], axis=1)

    def more_limits(self) -> list[float]:
        """Return the limits of the numbers of `more`."""
        return [1.0] * 3 + [2.0] + [2 * self.region] * (3 * AHEAD)

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: the curve, and a start of the vehicle near the curve's start."""
        n = draws.n
        chosen = np.array([CURVES.index(c) for c in self.curves])
        kind = chosen[np.floor(draws.uniform("curve", 0, len(chosen))).astype(int)]
        speed = draws.uniform("curve/speed", *self.speed)
        size = draws.uniform("curve/size", 1.5, 3.0)
        course = draws.uniform("curve/course", -np.pi, np.pi)
        sense = np.where(draws.uniform("curve/sense") < 0.5, -1.0, 1.0)
        climb = draws.uniform("curve/climb", -0.05, 0.05)
        lemniscate, helix, line = (kind == i for i in range(len(CURVES)))
        # Gerono's lemniscate is fastest where it crosses itself: sqrt(2) size rate.
        rate = np.where(lemniscate, speed / (np.sqrt(2.0) * size), speed / size)
        A = np.zeros((n, 3))
        A[:, 0] = np.where(line, 0.0, size)
        A[:, 1] = np.where(lemniscate, 0.5 * size * sense, 0.0)
        A[:, 2] = np.where(lemniscate, 10.0 * climb, 0.0)
        origin = np.zeros((n, 3))
        origin[:, 2] = 10.0
        psi = course + np.where(lemniscate, sense * np.pi / 4, 0.0)
        pose = np.zeros((n, 6))
        pose[:, :3] = origin + draws.uniform("start/p", -self.away, self.away, (3,))
        pose[:, 5] = psi + draws.uniform("start/psi", -0.8, 0.8)
        curve = {
            "reference.origin": origin,
            "reference.course": course,
            "reference.U": np.where(line, speed, 0.0),
            "reference.w": np.where(lemniscate, 0.0, climb),
            "reference.rate": rate,
            "reference.A": A,
            "reference.A_c": np.where(helix, sense * size, 0.0),
        }
        return {**self.at(draws, pose), **curve, **super().start(draws)}
