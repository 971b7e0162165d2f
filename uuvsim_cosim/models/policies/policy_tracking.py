"""A policy of target tracking as a component in the place of a pilot.

Every `action_step` seconds it makes the egocentric observation that it was trained on, of its own
pose, the others', the target and the obstacles (envs/tasks/tracking_observation.py: order, scales,
nearest first); the network's two numbers, times a_max and omega_max, are held until the next. With
them the equations of the pilot (pilot.py) go on, sample by sample.
"""

from __future__ import annotations

from fractions import Fraction

import casadi as ca

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Clock, Model
from uuvsim_cosim.models.declaration.preset import preset
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.vectors import ETA, NU
from uuvsim_cosim.models.guidance.pilot import declare_pilot
from uuvsim_cosim.models.hull.pool import declare_arena
from uuvsim_cosim.models.policies.policy_file import PolicyFile
from uuvsim_cosim.models.policies.policy_observation import Seen, egocentric, largest
from uuvsim_cosim.models.policies.policy_sequence import decided

__all__ = ["is_tracking", "tracking_policy"]

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
        seen = Seen(
            eta=ca.vertcat(eta[:2] - here, eta[2:]),
            nu=nu,
            u_d=u_d,
            target=now,
            target_before=ca.if_else(begun > 0.5, before, now),
            known=known,
            others=[(ca.vertcat(e[:2] - here, e[2:]), n) for e, n in team_mates],
            obstacles=[(x - here[0], y - here[1], r, pool[2] - h <= depth) for x, y, r, h in rows],
        )
        observed = egocentric(seen, slots, arena, v, v * float(step))
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
