"""Scripted controllers as references: functions from observations (n, width) to actions.

They use the observations of a policy and have no memory, so that their return is a fair reference.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.task import Array, Task, TeamTask
from uuvsim_cosim.envs.tasks.altitude_following import FIRST, AltitudeFollowing
from uuvsim_cosim.envs.tasks.pose import FORCE, SPEED, PoseTask
from uuvsim_cosim.envs.tasks.target_tracking import A_MAX, OMEGA_MAX, V_MAX, TargetTracking
from uuvsim_cosim.envs.tasks.tracking_observation import OBSTACLE, OTHER, OWN, TARGET
from uuvsim_cosim.envs.tasks.trajectory import TrajectoryFollowing
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.control.vehicle_design import control_design
from uuvsim_cosim.orchestrator.shipped.tasks import HEAVY

__all__ = [
    "Policies",
    "Policy",
    "hold_pose",
    "hold_velocity",
    "scripted_policy",
    "track_target",
    "with_slope",
]

Policy = Callable[[NDArray[np.generic]], Array]
Policies = Policy | Mapping[str, Policy]  # of one agent, or by agent of a team

# Proportional and derivative, for about 2.5 rad/s of a BlueROV2 Heavy that is damped to 0.9:
KP = np.array([140.0, 140.0, 170.0, 14.0, 14.0, 8.0])  # N/m, N.m/rad
KD = np.array([90.0, 90.0, 120.0, 2.8, 2.8, 3.5])  # N.s/m, N.m.s/rad
D_L = np.array([13.7, 0.0, 33.0])  # N.s/m   (models/vehicles/bluerov2_heavy, von Benzon 2022)
PULL, MARGIN, OUTWARD, AROUND, WALL, TURN, BRAKE, SPARE = 3.5, 0.5, 0.5, 0.1, 0.8, 3.6, 0.6, 0.02
SHARE = 0.42
SINKING = 1.0
D_Q = np.array([141.0, 217.0, 190.0])  # N.s2/m2


def scripted_policy(task: Task | TeamTask) -> Policies:
    """Return a task's controller; for a team, one for each agent.

    Raises InputInvalid for a task without a controller.
    """
    if isinstance(task, TargetTracking):
        d_safe = max(task.rules.d_su, task.rules.d_st, task.rules.d_so)
        wanted = task.rules.d_st + SHARE * (task.rules.d_m - task.rules.d_st)

        def follow(o: NDArray[np.generic]) -> Array:
            return track_target(o, task.slots, wanted, d_safe, task.arena.size[:2])

        return dict.fromkeys(task.agents, follow)
    if isinstance(task, PoseTask):
        moves = isinstance(task, TrajectoryFollowing)
        name = task.actions[0].name
        over = task.altitude if isinstance(task, AltitudeFollowing) else 0.0
        if name.startswith(("allocation.", "controller.")) and task.vehicle != HEAVY:
            return _of_vehicle(task, moves, over)
        if over and name.startswith(("allocation.", "controller.")):
            hold = hold_pose if name.startswith("allocation.") else hold_velocity
            return lambda o: hold(with_slope(o, over), True)
        if name.startswith("allocation."):
            return lambda o: hold_pose(o, moves)
        if name.startswith("controller."):
            return lambda o: hold_velocity(o, moves)
    raise InputInvalid(
        type(task).__name__,
        "no scripted controller",
        "a shipped task whose action is a force or a velocity",
    )


def _of_vehicle(task: PoseTask, moves: bool, over: float) -> Policy:
    """Return the controller of a vehicle other than the BlueROV2 Heavy.

    Its gains on pose and velocity are those of `control_design`, without an integral. Axes that
    the thrusters do not control have no column.
    """
    high = np.array([c.high for c in task.actions], np.float64)
    design = control_design(task.vehicle)
    axes = list(design.thrusters.controlled)
    K_p, K_d = design.K[:, 6:12], design.K[:, 12:]

    def force(o: NDArray[np.generic]) -> Array:
        e, nu_d, nu = _errors(o, moves)
        tau = e @ K_p.T + (nu_d - nu) @ K_d.T
        return np.asarray(np.clip(tau[:, axes] / high, -1.0, 1.0))

    kept = [column for column, i in enumerate((0, 1, 2, 5)) if i in axes]

    def velocity(o: NDArray[np.generic]) -> Array:
        return np.asarray(np.clip(_velocity(o, moves)[:, kept] / high, -1.0, 1.0))

    hold = force if task.actions[0].name.startswith("allocation.") else velocity
    if over:
        return lambda o: hold(with_slope(o, over))
    return hold


def hold_pose(observation: NDArray[np.generic], moves: bool = False) -> Array:
    """Return forces: PD on the pose, with the drag of the wanted velocity fed forward."""
    e, nu_d, nu = _errors(observation, moves)
    v = nu_d[:, :3]
    tau = KP * e + KD * (nu_d - nu)
    tau[:, :3] += (D_L + D_Q * np.abs(v)) * v
    return np.asarray(np.clip(tau / FORCE, -1.0, 1.0))


def _errors(observation: NDArray[np.generic], moves: bool) -> tuple[Array, Array, Array]:
    """Return the error of pose, the wanted velocity and the velocity, each (n, 6) in b."""
    o = np.asarray(observation, float)
    down = o[:, 5:8]
    turn = np.arctan2(o[:, 3], o[:, 4])
    # A hull whose body y points down by sin(phi), and body x by -sin(theta), is turned back.
    e = np.column_stack([o[:, :3], -down[:, 1], down[:, 0], turn])
    nu_d = np.zeros((len(o), 6))
    if moves:
        nu_d[:, :3], nu_d[:, 5] = o[:, 14:17], o[:, 17]
    return e, nu_d, o[:, 8:14]


def hold_velocity(observation: NDArray[np.generic], moves: bool = False) -> Array:
    """Return velocities: proportional to the error of pose, plus the wanted velocity."""
    return np.asarray(np.clip(_velocity(observation, moves) / SPEED, -1.0, 1.0))


def _velocity(observation: NDArray[np.generic], moves: bool) -> Array:
    """Return the velocity u v w r (n, 4) that leads to the wanted pose."""
    o = np.asarray(observation, float)
    v = 1.2 * o[:, :3] + (o[:, 14:17] if moves else 0.0)
    r = 1.5 * np.arctan2(o[:, 3], o[:, 4]) + (o[:, 17] if moves else 0.0)
    return np.column_stack([v, r])


def with_slope(observation: NDArray[np.generic], altitude: float) -> Array:
    """Add the slope of the seabed, from both echoes of altitude following, to the wanted velocity.

    The vertical beam has the range d, and the beam ahead the range r, whose first echo comes from
    the angle a. The seabed then falls by r cos a - d over the distance r sin a.
    """
    o = np.array(observation, float)
    d = np.maximum(altitude + o[:, 2], 0.3)
    r = np.maximum(d / np.cos(FIRST) + o[:, 18], 0.3)
    slope = np.where(o[:, 20] > 0.5, (r * np.cos(FIRST) - d) / (r * np.sin(FIRST)), 0.0)
    o[:, 16] += SINKING * np.clip(slope, -0.6, 0.6) * o[:, 14]
    return o


def track_target(
    observation: NDArray[np.generic],
    slots: tuple[int, int],
    wanted: float,
    d_safe: float,
    arena: tuple[float, ...],
) -> Array:
    """Return (a, omega) that lead to `wanted` m from the target and away from close objects.

    The wanted velocity is a sum in the vehicle's own axes. If it points more than a right angle
    away from the bow, the vehicle drives backwards. `slots`, `arena` and `d_safe` are those of the
    task.
    """
    o = np.asarray(observation, float)
    flag, p = o[:, OWN], o[:, OWN + 1 : OWN + 3]
    distance = np.maximum(o[:, OWN + 3], 1e-6)
    bearing = p / distance[:, None]
    moved = o[:, OWN + 4 : OWN + 6] * V_MAX  # m/s, of the target
    pull = np.clip(PULL * (distance - wanted), -V_MAX, V_MAX)
    v = flag[:, None] * (pull[:, None] * bearing + moved)
    hazards: list[tuple[Array, ...]] = [(flag, bearing, distance - d_safe)]
    for there, place, gap in _around(o, slots, d_safe):
        hazards.append((there, place, gap))
        strength = there * np.clip(1.0 - gap / MARGIN, 0.0, 3.0)
        side = np.column_stack([place[:, 1], -place[:, 0]])  # around it where the target is
        side *= np.where(np.sum(side * bearing, axis=1) < 0, -1.0, 1.0)[:, None]
        v += strength[:, None] * (AROUND * side - OUTWARD * place)
    # Away from walls nearer than WALL, turned into body axes.
    half = np.array(arena[:2]) / 2
    space = half - np.abs(o[:, :2]) * half
    push = -np.sign(o[:, :2]) * 0.5 * np.clip(1.0 - space / WALL, 0.0, 1.0)
    c, s = o[:, 2], o[:, 3]
    v += np.column_stack([c * push[:, 0] + s * push[:, 1], c * push[:, 1] - s * push[:, 0]])
    speed = np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2)
    v *= np.minimum(1.0, V_MAX / np.maximum(speed, 1e-6))[:, None]
    course = np.arctan2(v[:, 1], v[:, 0])
    backwards = np.abs(course) > 0.5 * np.pi
    turn = np.where(backwards, course - np.sign(course) * np.pi, course)
    facing = np.arctan2(bearing[:, 1], bearing[:, 0])
    turn = np.where(speed > 0.05, turn, facing)
    u = _braked(v[:, 0] * np.abs(np.cos(turn)), hazards)
    a = (u - o[:, 7] * V_MAX) / 0.4
    return np.asarray(np.clip(np.column_stack([a / A_MAX, TURN * turn / OMEGA_MAX]), -1.0, 1.0))


def _around(o: Array, slots: tuple[int, int], d_safe: float) -> Iterator[tuple[Array, ...]]:
    """Return for each slot its flag, the direction, and the distance minus `d_safe`."""
    first = OWN + TARGET
    for i in range(sum(slots)):
        other = i < slots[0]
        size = OTHER if other else OBSTACLE
        slot = o[:, first : first + size]
        first += size
        place = slot[:, 1:3]
        d = np.maximum(np.sqrt(place[:, 0] ** 2 + place[:, 1] ** 2), 1e-6)
        yield slot[:, 0], place / d[:, None], d - (0.0 if other else slot[:, 3]) - d_safe


def _braked(u: Array, hazards: list[tuple[Array, ...]]) -> Array:
    """Limit the surge speed so that the vehicle can still stop before each hazard."""
    low, high = np.full(len(u), -V_MAX), np.full(len(u), V_MAX)
    for there, place, gap in hazards:
        along = place[:, 0]
        bound = BRAKE * (gap - SPARE) / np.where(np.abs(along) > 0.15, along, 1.0)
        high = np.where((there > 0) & (along > 0.15), np.minimum(high, bound), high)
        low = np.where((there > 0) & (along < -0.15), np.maximum(low, bound), low)
    return np.where(low < high, np.clip(u, low, high), 0.5 * (low + high))
