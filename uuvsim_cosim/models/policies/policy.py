"""A trained policy as a component: the network of its file, with its observations and actions.

A policy of target tracking replaces a pilot (policy_tracking.py): it observes vehicles and target,
and its output is a force. Any other policy observes and acts on plain numbers:

    action = (low + high) / 2 + (high - low) / 2  network(clip(observation))

sampled every `action_step` seconds and held.
"""

from __future__ import annotations

import json
from dataclasses import replace
from math import isfinite
from pathlib import Path

import casadi as ca

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.model import Model
from uuvsim_cosim.models.declaration.safe_math import clip
from uuvsim_cosim.models.declaration.sampled import held_output
from uuvsim_cosim.models.policies.policy_file import Channel, read_policy
from uuvsim_cosim.models.policies.policy_network import decided
from uuvsim_cosim.models.policies.policy_tracking import is_tracking, tracking_policy

__all__ = ["policy"]


def policy(
    id: str = "source_sac",
    file: str = "",
    action_step: str = "",
    period: str = "0.02",
    obstacles: int | str = "",
    plain: int | str = 0,
    action: str = "",
) -> Model:
    """Declare the policy of models/policies, or of a `file` (.npz).

    `action_step` [s] is how long an action lasts, if not as in the file. Of tracking, `period`
    [s] is the pilot's, `obstacles` how many there are to see, if not as trained; with `plain` it
    has observations and actions as any other policy. `action` gives name, low, high and unit of
    each action instead of the file, as a JSON list of lists; it is not for tracking.
    """
    where = Path(file).expanduser() if file else content("models", "policies") / f"{id}.npz"
    if not file and not where.is_file():
        known = sorted(p.stem for p in where.parent.glob("*.npz"))
        raise InputInvalid(f"policy {id!r}", f"one of {', '.join(known)}, or file=FILE.npz")
    read = read_policy(where)
    if is_tracking(read) and not int(plain):
        return tracking_policy(read, action_step, period, str(obstacles))
    if action:
        try:
            channels = tuple(
                Channel(str(n), float(a), float(b), str(u)) for n, a, b, u in json.loads(action)
            )
        except (ValueError, TypeError):
            channels = ()
        if len(channels) != len(read.action) or not all(isfinite(c.low + c.high) for c in channels):
            raise InputInvalid(
                "policy",
                f"action {action}",
                f"[name, low, high, unit] for each of the {len(read.action)} "
                f"actions of {read.path.name}, as JSON",
            )
        read = replace(read, action=channels)
    settings = str(read.settings.get("action_step", ""))
    usual = "0.4" if is_tracking(read) else "0.1"  # the tasks' own
    step = action_step or settings or str(read.options.get("action_step", "")) or usual
    m = Model("policy", f"A policy trained on {read.task}")
    seen = m.input(
        "observation", len(read.observation), unit="1", description="as the task gives it"
    )
    low, high = ([getattr(c, side) for c in read.observation] for side in ("low", "high"))
    sample = m.clock("sample", step)
    chosen = decided(m, sample, read, clip(seen, ca.DM(low), ca.DM(high)), 1.0)
    low, high = ([getattr(c, side) for c in read.action] for side in ("low", "high"))
    middle, half = (0.5 * (ca.DM(high) + s * ca.DM(low)) for s in (1, -1))
    held_output(
        m,
        sample,
        "action",
        middle + half * chosen,
        unit=[c.unit for c in read.action],
        start=[0.0] * len(read.action) if len(read.action) > 1 else 0.0,
        description=", ".join(c.name for c in read.action),
    )
    return m
