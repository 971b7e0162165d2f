"""A policy on the vehicle's computer: this file, what was written beside it, and numpy.

>>> pilot = Runner()                            # runner.npz beside runner.py
>>> pilot.begin()                               # before each episode but the first
>>> a, omega = pilot.track(eta, nu, u_d, target)  # every action_step seconds [m/s2, rad/s]
>>> pilot.act(observation)                      # or: what the task observes -> [-1, 1]
"""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["Runner"]


class Runner:
    """The policy in `file`, by default the .npz file with the name of this file."""

    def __init__(self, file: str | Path | None = None) -> None:
        file = file or Path(__file__).with_suffix(".npz")
        with np.load(file, allow_pickle=False) as read:
            self.tensors = {name: read[name] for name in read.files}
        self.head = json.loads(bytes(self.tensors.pop("head")))
        if self.head["uuvsim_policy"] != 1:
            raise ValueError(f"{file}: expected a policy of format 1")
        self.memory: Any = None
        if self.head["kind"] == "sequence":  # then runner_sequence.py is beside runner.py
            code = runpy.run_path(str(Path(__file__).with_suffix("")) + "_sequence.py")
            self.memory = code["Remembering"](self.tensors, self.head["settings"])
        self.depth = sum(n.endswith(".weight") and n[:-7].isdigit() for n in self.tensors)
        self.begin()

    def begin(self) -> None:
        """Clear the history: the next observation is the first one of an episode."""
        self.before: Any = None  # where the target was at the last action
        if self.memory is not None:
            self.memory.begin()

    def act(self, observation: Any) -> Any:
        """Return actions in [-1, 1] for an observation (width,), the next one of the episode."""
        t = self.tensors
        x = np.asarray(observation, np.float32)
        if x.shape != (len(self.head["observation"]),) or not np.all(np.isfinite(x)):
            raise ValueError(f"{x}: expected {len(self.head['observation'])} finite numbers")
        if self.memory is not None:
            return self.memory(x[None])[0]
        x = (x - t["shift"]) * t["scale"] if "shift" in t else x
        for i in range(self.depth):
            x = t[f"{i}.weight"] @ x + t[f"{i}.bias"]
            if i + 1 < self.depth:
                x = np.maximum(x, 0) if self.head["activation"] == "relu" else np.tanh(x)
        if self.head["kind"] == "grid":
            x = t["grid"][int(np.argmax(x))]
        return np.clip(np.tanh(x) if self.head["kind"] == "tanh" else x, -1.0, 1.0)

    def track(
        self, eta: Any, nu: Any, u_d: float, target: Any, others: Any = (), obstacles: Any = ()
    ) -> tuple[float, float]:
        """Return the surge acceleration [m/s2] and the yaw rate [rad/s] of target tracking.

        `eta` is N E D phi theta psi from the arena's middle [m, rad], `nu` is u v w p q r [m/s,
        rad/s], and `u_d` [m/s] is the integral of the returned accelerations. `target` is N E (D),
        `others` has (eta, nu) of each other tracker, `obstacles` (N, E, radius) of each, in m.
        """
        k = self.head["settings"]["tracking"]
        eta, nu, target = (np.asarray(v, float) for v in (eta, nu, target))
        v, psi, c, s = k["u_max"], eta[5], np.cos(eta[5]), np.sin(eta[5])
        before, self.before = target if self.before is None else self.before, target

        def level(d: Any) -> tuple[float, float]:
            return float(c * d[0] + s * d[1]), float(c * d[1] - s * d[0])

        def nearest(rows: Any, count: int, width: int) -> list[float]:
            chosen = [x for _, row in sorted(rows, key=lambda r: r[0])[:count] for x in row]
            return chosen + [0.0] * (count * width - len(chosen))

        seen = [2 * eta[0] / k["arena"][0], 2 * eta[1] / k["arena"][1], c, s]
        seen += [nu[0] / v, nu[1] / v, nu[5], u_d / v]
        x, y = level(target[:2] - eta[:2])
        far = np.inf if k["knowledge_range"] is None else k["knowledge_range"]
        moved = (d / (v * k["action_step"]) for d in level(target - before))
        seen += [1.0, x, y, np.hypot(x, y), *moved] if np.hypot(x, y) <= far else [0.0] * 6
        rows = []
        for e, n in others:
            x, y = level((e[0] - eta[0], e[1] - eta[1]))
            row = [1.0, x, y, np.cos(e[5] - psi), np.sin(e[5] - psi), n[0] / v, n[5]]
            rows.append((np.hypot(x, y), row))
        seen += nearest(rows, k["slots"][0], 7)
        spots = [(*level((north - eta[0], east - eta[1])), r) for north, east, r in obstacles]
        rows = [(np.hypot(x, y) - r, [1.0, x, y, r, np.hypot(x, y) - r]) for x, y, r in spots]
        seen += nearest(rows, k["slots"][1], 5)
        high = [o["high"] for o in self.head["observation"]]
        a, omega = self.act(np.clip(seen, -np.array(high), high)) * k["action_scale"]
        return float(a), float(omega)
