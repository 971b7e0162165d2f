"""Anticipation of delays: a policy of target tracking observes a predicted state.

Positions are `seen_late` old, and an action takes `acted_late` to arrive. The vehicle knows the
actions that were sent and the speeds that it measures. Its own position is therefore predicted by
the pilot's equations (models/guidance/pilot.py: u follows the wanted u, r follows omega at the rate
k_r), and the target's position by a Kalman filter of constant velocity. The policy receives the
observation of the time t + acted_late, in the form of its training.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.policies.policy_tracking import largest

__all__ = ["Anticipating"]

Array = NDArray[np.float64]
PIECES = 8  # integration steps of the prediction in an action step
SIGMA = 0.007  # m, of a position
# (m/s2)2 s: a target at 0.15 m/s whose yaw rate wanders by 0.4 rad/s for 2 s at a time
Q_TARGET = 2.0 * 2.0 * (0.15 * 0.4) ** 2
TRUST = 0.6  # weight of a measured own position; the rest is dead reckoning


@final
class Anticipating:
    """Compensation of delays in front of a policy of target tracking: it observes predictions.

    It is for one tracker without obstacles. `act` maps observations (n, width) to actions (n, 2).
    `seen_late` is the age of the observed positions of the vehicle and the target, and `acted_late`
    the delay of a command, each from 0 to 2 s. `action_step` is the duration of an action [s],
    `arena` the size of the arena in N and E [m], and `slots` the numbers of other trackers and of
    obstacles in an observation, as in the task. A call maps observations (n, width) to actions, and
    expects one call for each action. Raises InputInvalid for other delays and other widths.

    Example:

    >>> from uuvsim_cosim.envs.tasks import evaluate
    >>> from uuvsim_cosim.learn import Anticipating, acting_in, load_policies, make_task
    >>> task = make_task("disturbed", {"seen_late": 0.4, "acted_late": 0.4})  # s
    >>> act = acting_in(task, load_policies("transition_1_masac"), "disturbed")
    >>> ahead = {agent: Anticipating(one, 0.4, 0.4) for agent, one in act.items()}
    >>> late, anticipated = (evaluate(task, p, 20).returns.mean() for p in (act, ahead))
    >>> anticipated > late
    np.True_
    >>> ahead["tracker_1"].begin()  # `evaluate` does this before its episodes
    """

    def __init__(
        self,
        act: Callable[[NDArray[np.generic]], Array],
        seen_late: float,
        acted_late: float,
        *,
        action_step: float = 0.4,
        arena: Sequence[float] = (2.6, 4.8),
        slots: tuple[int, int] = (1, 2),
    ) -> None:
        self.act, self.T = act, action_step
        self.seen, self.acted = seen_late, acted_late
        for name, late in (("seen_late", seen_late), ("acted_late", acted_late)):
            if not 0.0 <= late <= 2.0:
                raise InputInvalid(f"{name} [s]", f"{late!r}", "0 to 2")
        p = preset("controllers", "tracking_pilot", "pilot")
        self.v, self.a = p.number("u_max", "m/s"), p.number("a_max", "m/s2")
        self.omega, self.k_r = p.number("omega_max", "rad/s"), p.number("k_r", "1/s")
        self.half = np.array(arena[:2]) / 2.0
        self.limits = largest(slots, arena)
        self.begin()

    def begin(self) -> None:
        """Clear the memory: the next observations are the first ones of new episodes."""
        self._sent: list[Array] = []  # actions, oldest first
        self._speeds: list[Array] = []  # u, v, r as they were observed, oldest first
        self._own: Array | None = None
        self._target: Array | None = None
        begin = getattr(self.act, "begin", None)
        if begin is not None:
            begin()

    def __call__(self, observation: NDArray[np.generic]) -> Array:
        """Return the actions (n, 2) for observations (n, width), the next ones of the episodes."""
        o = np.array(observation, float)
        if o.ndim != 2 or o.shape[1] != len(self.limits):
            raise InputInvalid(
                "anticipation", f"observations of shape {o.shape}", f"(n, {len(self.limits)})"
            )
        nu = o[:, [4, 5, 6]] * [self.v, self.v, 1.0]
        self._speeds.append(nu)
        psi = np.arctan2(o[:, 3], o[:, 2])
        there = o[:, :2] * self.half  # as it was `seen` ago
        p_T, v_T = self._tracked(there + _turned(psi, o[:, 9:11]))
        if self._own is not None:  # measurement and dead reckoning, weighted
            moved = _turned(psi, self._before(self.seen + 0.5 * self.T)[:, :2]) * self.T
            reckoned = self._own + moved
            there = reckoned + TRUST * (there - reckoned)
        self._own = there
        pose, u, r = self._carried(np.column_stack([there, psi]), nu, o[:, 7] * self.v)
        p_T = p_T + (self.seen + self.acted) * v_T

        psi, ahead = pose[:, 2], o.copy()
        ahead[:, :2] = pose[:, :2] / self.half
        ahead[:, 2], ahead[:, 3] = np.cos(psi), np.sin(psi)
        if self.acted > 0.0:
            ahead[:, 4], ahead[:, 6] = u / self.v, r
            ahead[:, 7] = u / self.v
        away = _turned(-psi, p_T - pose[:, :2])
        ahead[:, 9:11], ahead[:, 11] = away, np.hypot(away[:, 0], away[:, 1])
        ahead[:, 12:14] = _turned(-psi, v_T) / self.v  # over an action, in strides of v T
        action = np.asarray(self.act(np.clip(ahead, -self.limits, self.limits)), float)
        self._sent.append(action)
        return action

    # ---- inside -----------------------------------------------------------------------------

    def _before(self, late: float) -> Array:
        """Return u, v, r of `late` [s] ago, between the times of observations."""
        back = min(late / self.T, len(self._speeds) - 1.0)
        i = int(back)
        j = min(i + 1, len(self._speeds) - 1)
        return (1.0 - back + i) * self._speeds[-1 - i] + (back - i) * self._speeds[-1 - j]

    def _tracked(self, seen: Array) -> tuple[Array, Array]:
        """Return the target's filtered position `seen` ago, and velocity."""
        T, n = self.T, len(seen)
        if self._target is None or len(self._target) != n:
            self._target = np.column_stack([seen, np.zeros((n, 2))])
            self._P = np.diag([SIGMA**2, 0.15**2])
            return seen, self._target[:, 2:]
        F = np.array([[1.0, T], [0.0, 1.0]])
        Q = Q_TARGET * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
        self._P = F @ self._P @ F.T + Q
        K = self._P[:, 0] / (self._P[0, 0] + SIGMA**2)
        self._P = self._P - np.outer(K, self._P[0])
        x = self._target
        p = x[:, :2] + T * x[:, 2:]
        e = seen - p
        self._target = np.column_stack([p + K[0] * e, x[:, 2:] + K[1] * e])
        return self._target[:, :2], self._target[:, 2:]

    def _carried(self, pose: Array, nu: Array, speed: Array) -> tuple[Array, Array, Array]:
        """Predict pose, u and r when the next action arrives, from the pose of `seen` ago."""
        x, psi = pose[:, :2].copy(), pose[:, 2].copy()
        h = self.T / PIECES
        for k in range(round(self.seen / h)):  # speeds that were measured since then
            at = self._before(self.seen - (k + 0.5) * h)
            x += h * _turned(psi + 0.5 * h * at[:, 2], at[:, :2])
            psi += h * at[:, 2]
        u, v, r, r_d = speed.copy(), nu[:, 1], nu[:, 2].copy(), nu[:, 2].copy()
        gain = 1.0 - np.exp(-self.k_r * h)
        for k in range(round(self.acted / h)):  # what has been sent and has not arrived
            back = int(np.ceil((self.acted - k * h) / self.T - 1e-9))
            sent = self._sent[-back] if back <= len(self._sent) else np.zeros((len(u), 2))
            before = u
            u = np.clip(u + h * self.a * sent[:, 0], -self.v, self.v)
            r_d = r_d + gain * (self.omega * sent[:, 1] - r_d)
            r_new = r + gain * (r_d - r)
            mean = 0.5 * (r + r_new)
            x += h * _turned(psi + 0.5 * h * mean, np.column_stack([0.5 * (before + u), v]))
            psi += h * mean
            r = r_new
        return np.column_stack([x, psi]), u, r


def _turned(psi: Array, v: Array) -> Array:
    """Turn vectors (n, 2) by angles (n,)."""
    c, s = np.cos(psi), np.sin(psi)
    return np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]])
