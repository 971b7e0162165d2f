"""Common part of tasks with a wanted pose of one vehicle: actions, observation, reward."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.published import published, thruster_strength
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Channel, Moment, Randomised, Task
from uuvsim_cosim.envs.tasks.coordinates import R_zyx, in_body, wrap
from uuvsim_cosim.envs.tasks.ranges import flag, known_options, one_of, pair, randomised, within
from uuvsim_cosim.orchestrator.shipped.tasks import THRUSTERS, ActedOn, Observed, task_system
from uuvsim_cosim.orchestrator.system.system import System

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View

__all__ = ["FORCE", "SPEED", "PoseTask", "published_vehicle"]


# X Y Z [N], K M N [N.m]: what eight T200 give in one axis at a time, less a margin for the
# others (models/controllers/bluerov2_pid/controller.yaml, tau_max).
FORCE = (110.0, 110.0, 130.0, 15.0, 12.0, 20.0)
SPEED = (0.8, 0.6, 0.6, 0.8)  # u v w [m/s], r [rad/s] of action="velocity"
NU = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)  # m/s, rad/s: what counts as 1 in an observation
NU_LIMIT = 4.0
SIZE = (0.457, 0.575)  # m, length and breadth of a BlueROV2 Heavy
LENGTH = 0.5  # m, where the reward of the distance has fallen to a half


class PoseTask(Task, ABC):
    """Hold the hull of `task_system` at a wanted pose; the episode ends `region` m away from it.

    Reward of each action, in [-effort, 1]:

        1 / (1 + (d / 0.5 m)²) · (1 + cos e_psi) / 2 · (1 + cos tilt) / 2 - effort · mean(a²)

    with d the distance, e_psi the error of heading, tilt the angle between the hull's and the
    true vertical. The observation, in body axes, is the error of position over 1 m (3), sin and
    cos of e_psi (2), the direction of down (3), nu over 1 m/s and 1 rad/s (6), the task's own
    numbers (`more`), and the last action; with `privileged` also the water's velocity over 1 m/s
    (3), the task's hidden numbers (`hidden`), and the drawn parameters. `observation` is "truth"
    or "navigation"; `randomise` draws the hull in each episode.
    """

    effort = 0.05

    def __init__(
        self,
        *,
        action: ActedOn = "force",
        observation: Observed = "truth",
        horizon: Fraction | str | float = 20,
        region: float = 5.0,
        current: tuple[float, float] = (0.0, 0.3),
        privileged: bool = False,
        randomise: bool = False,
        randomisation: Randomised | None = None,
        signals: Sequence[str] = (),
        reference: bool = False,
        disturbances: bool = False,
        **unknown: object,
    ) -> None:
        known_options(type(self), unknown)
        one_of("action", action, get_args(ActedOn))
        one_of("observation", observation, get_args(Observed))
        randomised(randomisation)
        self.region = within("region [m]", region, 1e-9, np.inf)
        self.current = pair("current [m/s]", current)
        self.privileged = flag("privileged", privileged)
        known = "hull" if observation == "truth" else "navigation"
        system = self.made_of(action, observation, reference, disturbances)
        if flag("randomise", randomise) and randomisation is None:
            randomisation = published_vehicle(system)
        if isinstance(randomisation, Randomisation):
            randomisation = randomisation.bound(system)
        if action == "force":
            channels = [Channel("allocation.tau_d", [-f for f in FORCE], FORCE)]
        elif action == "thrusters":
            channels = [Channel(f"{name}.u") for name in THRUSTERS]
        else:
            names = ("nu_d[1]", "nu_d[2]", "nu_d[3]", "nu_d[6]")
            channels = [
                Channel(f"controller.{n}", -s, s) for n, s in zip(names, SPEED, strict=True)
            ]
        self.known = known
        self._water = "ramps.v_c" if disturbances else "current.v_c"
        super().__init__(
            system,
            actions=channels,
            observations=(),
            action_step="0.1",
            horizon=horizon,
            signals=(*dict.fromkeys(("hull.eta", "hull.nu", f"{known}.eta", f"{known}.nu")),
                     self._water, *signals),
            randomisation=randomisation,
        )  # fmt: skip
        self._width = sum(6 if c.name.endswith("tau_d") else 1 for c in self.actions)

    # ---- for a task to override -----------------------------------------------------------

    def made_of(
        self, action: ActedOn, observation: Observed, reference: bool, disturbances: bool
    ) -> System:
        """Return the system of the task; equal arguments give the same one."""
        return task_system(action, observation, reference, disturbances)

    @abstractmethod
    def wanted(self, m: Moment) -> Array:
        """Return the wanted N E D psi [m, rad], of shape (n, 4)."""

    def seen(self, m: Moment) -> Array:
        """Return the wanted pose as the vehicle knows it; the reward is of the true one."""
        return self.wanted(m)

    def more(self, m: Moment, R: Array) -> list[Array]:
        """Return additional observations, each of shape (n, k), in units of about 1."""
        return []

    def more_limits(self) -> list[float]:
        """Return the largest size of each of them."""
        return []

    def hidden(self, m: Moment, R: Array) -> list[Array]:
        """Return other privileged observations than the water's velocity."""
        return []

    def hidden_limits(self) -> list[float]:
        """Return the largest size of each of them."""
        return []

    # ---- what an environment asks ---------------------------------------------------------

    def extra(self, m: Moment) -> Array:
        """Return the whole observation, clipped to its limits."""
        return np.asarray(np.clip(self.unclipped(m), *self.extra_limits))

    def unclipped(self, m: Moment) -> Array:
        """Return the whole observation."""
        eta, nu = m[f"{self.known}.eta"], m[f"{self.known}.nu"]
        R = R_zyx(eta[:, 3:])
        wanted = self.seen(m)
        e_psi = wrap(wanted[:, 3] - eta[:, 5])[:, None]
        parts = [
            in_body(R, wanted[:, :3] - eta[:, :3]),
            np.sin(e_psi),
            np.cos(e_psi),
            R[:, 2, :],
            nu / NU,
            *self.more(m, R),
            *(m.action.values() or [np.zeros((m.n, self._width))]),
        ]
        if self.privileged:
            parts += [in_body(R, m[self._water]), *self.hidden(m, R)]
            if isinstance(self.randomisation, Randomisation):
                parts.append(self.randomisation.privileged(m.start))
        return np.concatenate(parts, axis=1)

    @property
    def extra_limits(self) -> tuple[Sequence[float], Sequence[float]]:
        """The limits; an episode ends before the error exceeds twice the region."""
        high = [2 * self.region] * 3 + [1.0] * 5 + [NU_LIMIT] * 6 + self.more_limits()
        high += [1.0] * self._width
        if self.privileged:
            high += [2.0] * 3 + self.hidden_limits()
            if isinstance(self.randomisation, Randomisation):
                high += [1.0] * len(self.randomisation.privileged_names)
        return [-h for h in high], high

    def reward(self, m: Moment) -> Array:
        """Return the reward of the class's docstring, of the true pose, of shape (n,)."""
        distance, e_psi, tilt = self._errors(m)
        near = 1.0 / (1.0 + (distance / LENGTH) ** 2)
        upright = (1.0 + np.cos(e_psi)) * (1.0 + tilt) / 4.0
        spent = sum(np.sum(a * a, axis=1) for a in m.action.values()) / self._width
        return np.asarray(near * upright - self.effort * spent)

    def terminated(self, m: Moment) -> NDArray[np.bool_]:
        """Return the episodes whose vehicle is outside the region."""
        return np.asarray(self._errors(m)[0] > self.region)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the errors: of position [m], of heading [rad]."""
        distance, e_psi, _ = self._errors(m)
        return {"position_error": distance, "heading_error": np.abs(e_psi)}

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw a steady mean current, and what the randomisation declares."""
        n = draws.n
        speed = draws.uniform("task/current", *self.current)
        sets = {
            "current.speed": speed,
            "current.direction": draws.uniform("task/current/direction", -np.pi, np.pi),
            "current.sigma": 0.2 * speed,
            "current.sigma_direction": np.full(n, 0.2),
        }
        return {**sets, **super().start(draws)}

    def view(self, m: Moment, row: int) -> View:
        """Return the picture of one environment: vehicle, wanted pose, path ahead, current."""
        from uuvsim_cosim.envs.pictures import drawn as p

        wanted = self.wanted(m)[row]
        ahead = self.path(m)
        return p.View(
            vehicles=[p.Vehicle("hull", m["hull.eta"][row], *SIZE)],
            goals=[p.Goal(wanted[:3], float(wanted[3]))],
            path=None if ahead is None else ahead[row],
            current=m[self._water][row],
            time=float(m.time[row]),
        )

    def path(self, m: Moment) -> Array | None:
        """Return points that are still to come, of shape (n, k, 3), to be drawn."""
        return None

    def at(self, draws: Draws, pose: Array) -> dict[str, Array]:
        """Return start values that put the hull, and its estimate, at poses (n, 6)."""
        if self.known == "hull":
            return {"hull.eta_0": pose}
        error = draws.normal("task/estimate", (6,)) * (0.1, 0.1, 0.02, 0.0, 0.0, 0.03)
        return {"hull.eta_0": pose, "navigation.eta_0": pose + error}

    def _errors(self, m: Moment) -> tuple[Array, Array, Array]:
        eta, wanted = m["hull.eta"], self.wanted(m)
        d = wanted[:, :3] - eta[:, :3]
        distance = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2 + d[:, 2] ** 2)
        return distance, wrap(wanted[:, 3] - eta[:, 5]), np.cos(eta[:, 3]) * np.cos(eta[:, 4])


def published_vehicle(system: System) -> Randomisation:
    """Return the randomisation of `randomise`: hull within published figures, weak thrusters."""
    return published("bluerov2_heavy").bound(system) + thruster_strength(system).bound(system)
