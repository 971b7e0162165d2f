"""A policy of target tracking as a component that replaces a pilot.

Every `action_step` seconds it computes the egocentric observation of its training, from its own
pose, those of the other vehicles, the target and the obstacles (order and scales as in
envs/tasks/tracking_observation.py, nearest first; a test compares both). The network's two outputs,
times a_max and omega_max, are held until the next action. They are the inputs of the pilot's
equations (pilot.py), which are evaluated at each sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TypeAlias

import casadi as ca
import numpy as np

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.expression import Number
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import clip, norm
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.guidance.pilot import declare_pilot
from uuvsim_cosim.models.hull.pool import declare_arena
from uuvsim_cosim.models.policies.policy_file import PolicyFile
from uuvsim_cosim.models.policies.policy_network import decided

__all__ = ["TEAMS", "is_tracking", "largest", "tracking_policy"]

PRESET = "tracking_pilot"
# Trackers and obstacles of the tasks, unless their options say otherwise.
TEAMS = {
    "target-tracking": (2, 0),
    "source": (1, 0),
    "transition_1": (1, 0),
    "transition_2": (2, 0),
    "target": (2, 2),
    "disturbed": (1, 0),
    "pool_tracking": (1, 0),
    "uuvsim/TargetTracking-v0": (2, 0),
    "uuvsim/TargetTrackingSource-v0": (1, 0),
    "uuvsim/TargetTrackingTransition1-v0": (1, 0),
    "uuvsim/TargetTrackingTransition2-v0": (2, 0),
    "uuvsim/TargetTrackingTarget-v0": (2, 2),
}

# Whether it is there, its distance, and its numbers.
_Row: TypeAlias = tuple[Number, ca.SX, Sequence[Number]]


def is_tracking(file: PolicyFile) -> bool:
    """Return whether a policy was trained on target tracking."""
    return file.task in TEAMS


def tracking_policy(file: PolicyFile, action_step: str, period: str, obstacles: str) -> Model:
    """Declare it; the file's options say how many others and which arena it knows."""
    options = file.options
    team, cylinders = TEAMS[file.task]
    others = int(options.get("n_trackers", team)) - 1
    cylinders = int(options.get("n_obstacles", cylinders))
    slots = tuple(options.get("slots") or (max(1, others), max(2, cylinders)))
    arena = tuple(map(float, options.get("arena", (2.6, 4.8, 1.1))))
    size = largest(slots, arena)
    if len(size) != len(file.observation) or len(file.action) != 2:
        raise InputInvalid(
            file.path,
            f"observes {len(file.observation)} numbers and acts on {len(file.action)}",
            f"{len(size)} and 2, of {file.task} with slots {slots}",
        )
    step = Fraction(str(action_step or options.get("action_step", "0.4")))
    every = step / Fraction(str(period))
    if every.denominator != 1 or every < 1:
        raise InputInvalid(
            "policy", f"action_step {float(step):g} s", f"a multiple of its period {period} s"
        )
    m = Model("policy", f"A policy trained on {file.task}, in the place of a pilot")
    more = "added to what the policy wants"
    a = m.input("a", unit="m/s2", description=f"surge acceleration {more}")
    omega = m.input("omega", unit="rad/s", description=f"yaw rate {more}")
    eta = m.input("eta", 6, unit=ETA, description="estimate of N E D phi theta psi")
    nu = m.input("nu", 6, unit=NU, description="estimate, in b")
    target = m.input("target", 3, unit="m", description="position of the target in NED")
    m.peers["target"] = "target.position"
    team_mates = []
    for i in range(1, others + 1):
        eta_i = m.input(f"eta_{i}", 6, unit=ETA, description=f"of tracker {i} of the others")
        nu_i = m.input(f"nu_{i}", 6, unit=NU, description=f"of tracker {i} of the others, in b")
        m.peers |= {f"eta_{i}": f"tracker_{{{i}}}.hull.eta", f"nu_{i}": f"tracker_{{{i}}}.hull.nu"}
        team_mates.append((eta_i, nu_i))
    origin, pool, rows = declare_arena(m, int(obstacles) if obstacles else cylinders)
    numbers = preset("controllers", PRESET, "pilot")
    v, a_max = numbers.number("u_max", "m/s"), numbers.number("a_max", "m/s2")
    scale = ca.DM([a_max, numbers.number("omega_max", "rad/s")])
    seen_within = options.get("knowledge_range")

    def wanted(sample: Clock, p: dict[str, ca.SX], u_d: ca.SX) -> tuple[ca.SX, ca.SX]:
        before = m.discrete("target_before", (0.0, 0.0), unit="m", description="at the last action")
        count = m.discrete("count", unit="1", description="samples until the next action")
        begun = m.discrete("begun", unit="1", description="0 before the first action")
        held = m.discrete("action_held", (0.0, 0.0), unit="1", description="of the network")
        here = origin[:2]
        depth = m.variables["depth"].symbol
        now = target[:2] - here
        away = target[:2] - eta[:2]
        known = 1.0 if seen_within is None else ca.sumsqr(away) <= float(seen_within) ** 2
        seen = _Seen(
            eta=ca.vertcat(eta[:2] - here, eta[2:]),
            nu=nu,
            u_d=u_d,
            target=now,
            target_before=ca.if_else(begun > 0.5, before, now),
            known=known,
            others=[(ca.vertcat(e[:2] - here, e[2:]), n) for e, n in team_mates],
            obstacles=[(x - here[0], y - here[1], r, pool[2] - h <= depth) for x, y, r, h in rows],
        )
        observed = _egocentric(seen, slots, arena, v, v * float(step))
        due = count < 0.5
        action = ca.if_else(due, decided(m, sample, file, clip(observed, -size, size), due), held)
        m.update(sample, held, action)
        m.update(sample, before, ca.if_else(due, now, before))
        m.update(sample, begun, 1.0)
        m.update(sample, count, ca.if_else(due, float(every - 1), count - 1.0))
        return scale[0] * action[0] + a, scale[1] * action[1] + omega

    declare_pilot(m, PRESET, options.get("vehicle", "pool8"), period, eta, nu, wanted)
    held = m.variables["action_held"].symbol
    m.output("action", held, unit="1", discrete=True, description="the network's last action")
    return m


@dataclass(frozen=True)
class _Seen:
    """Knowledge of a tracker; positions from the arena's middle, in N and E [m]."""

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


def _egocentric(
    seen: _Seen, slots: Sequence[int], arena: Sequence[float], v: float, stride: float
) -> ca.SX:
    """Return the observation (width,); `v` [m/s] and `stride` [m] are its scales."""
    psi = seen.eta[5]
    here = seen.eta[:2]
    to_target = _level(psi, seen.target - here)
    moved = _level(psi, seen.target - seen.target_before) / stride
    target = [to_target[0], to_target[1], norm(to_target), moved[0], moved[1]]
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
        others.append((1.0, norm(away), row))
    obstacles: list[_Row] = []
    for north, east, radius, reaches in seen.obstacles:
        away = _level(psi, ca.vertcat(north, east) - here)
        surface = norm(away) - radius
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
