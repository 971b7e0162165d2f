"""Common part of tasks with a wanted pose of one vehicle: actions, observation, reward."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.randomisation.published import published, thruster_strength
from uuvsim_cosim.envs.randomisation.randomisation import Randomisation
from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Symbols, sin_cos
from uuvsim_cosim.envs.task.task import Array, Channel, Moment, Randomised, Task
from uuvsim_cosim.envs.tasks.coordinates import (
    R_zyx,
    R_zyx_expression,
    in_body,
    in_body_expression,
    wrap,
    wrap_expression,
)
from uuvsim_cosim.envs.tasks.ranges import flag, known_options, one_of, pair, randomised, within
from uuvsim_cosim.models.control.vehicle_design import control_design
from uuvsim_cosim.models.declaration.parameter_files import split_address, vehicle_size
from uuvsim_cosim.orchestrator.shipped.actuators import has_fins
from uuvsim_cosim.orchestrator.shipped.tasks import (
    HEAVY,
    THRUSTERS,
    ActedOn,
    Observed,
    task_system,
)
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
    """Hold a vehicle, by default a BlueROV2 Heavy, at a wanted pose.

    An episode ends at a distance of `region` m from it.

    The reward of each action, in [-effort, 1], is

        1 / (1 + (d / 0.5 m)²) · (1 + cos e_psi) / 2 · (1 + cos tilt) / 2 - effort · mean(a²)

    with the distance d, the heading error e_psi, the angle `tilt` between the hull's and the true
    vertical, the action a, and effort = 0.05.

    The observation has, in body axes, the position error over 1 m (3), sine and cosine of e_psi
    (2), the direction of down (3), nu over 1 m/s and 1 rad/s (6), the numbers that the task adds
    (`more`), and the last action. With `privileged`, the velocity of the water over 1 m/s (3), the
    hidden numbers of the task (`hidden`) and the drawn parameters follow.

    `action` is "force": six numbers, up to 110, 110, 130 N and 15, 12, 20 N.m, which the allocation
    converts to eight thrusts; "thrusters": the eight commands; or "velocity": u, v, w, r for a
    controller that keeps the hull level. `observation` is "truth" or "navigation", the estimate
    of the filter from the sensors; the reward always uses the truth. `current` [m/s] are the least
    and the greatest mean speed of the water; its direction is drawn too. `randomise` draws the hull
    within all published figures, and weaker thrusters, in each episode; `randomisation` is one of
    your own. An episode lasts `horizon` s.

    `vehicle` is another vehicle, by id or folder. The limits of its forces and speeds are then
    those of `control_design`; axes that its thrusters do not control have no action. A vehicle with
    fins has the action "thrusters" only, which is its default: the command of the propeller, and
    the deflections of the fins, whose limits are `delta_max`.
    """

    effort = 0.05

    def __init__(
        self,
        *,
        action: ActedOn | None = None,
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
        vehicle: str = HEAVY,
        **unknown: object,
    ) -> None:
        known_options(type(self), unknown)
        if action is None:
            action = "thrusters" if has_fins(vehicle) else "force"
        one_of("action", action, get_args(ActedOn))
        one_of("observation", observation, get_args(Observed))
        randomised(randomisation)
        self.region = within("region [m]", region, 1e-9, np.inf)
        self.current = pair("current [m/s]", current)
        self.privileged = flag("privileged", privileged)
        self.vehicle = vehicle
        known = "hull" if observation == "truth" else "navigation"
        system = self.made_of(action, observation, reference, disturbances)
        if flag("randomise", randomise) and randomisation is None:
            randomisation = published_vehicle(system, vehicle)
        if isinstance(randomisation, Randomisation):
            randomisation = randomisation.bound(system)
        channels = _channels(system, action, vehicle)
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
        self._width = sum(_size(system, c.name) for c in self.actions)

    # ---- for a task to override -----------------------------------------------------------

    def made_of(
        self, action: ActedOn, observation: Observed, reference: bool, disturbances: bool
    ) -> System:
        """Return the system of the task; equal arguments give the same one."""
        return task_system(action, observation, reference, disturbances, self.vehicle)

    @abstractmethod
    def wanted(self, m: Moment) -> Array:
        """Return the wanted N E D psi [m, rad], of shape (n, 4)."""

    def seen(self, m: Moment) -> Array:
        """Return the wanted pose as the vehicle knows it; the reward uses the true one."""
        return self.wanted(m)

    def more(self, m: Moment, R: Array) -> list[Array]:
        """Return additional observations, each of shape (n, k), scaled to about 1."""
        return []

    def more_limits(self) -> list[float]:
        """Return the upper limit of each number of `more`; the lower one is its negative."""
        return []

    def hidden(self, m: Moment, R: Array) -> list[Array]:
        """Return privileged observations besides the water's velocity, each of shape (n, k)."""
        return []

    def hidden_limits(self) -> list[float]:
        """Return the upper limit of each number of `hidden`; the lower one is its negative."""
        return []

    # ---- the task's methods ---------------------------------------------------------------

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
            *sin_cos(e_psi),
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
        """The limits of the observation; a position error stays below twice the region."""
        high = [2 * self.region] * 3 + [1.0] * 5 + [NU_LIMIT] * 6 + self.more_limits()
        high += [1.0] * self._width
        if self.privileged:
            high += [2.0] * 3 + self.hidden_limits()
            if isinstance(self.randomisation, Randomisation):
                high += [1.0] * len(self.randomisation.privileged_names)
        return [-h for h in high], high

    def reward(self, m: Moment) -> Array:
        """Return the reward, which the class's docstring defines, of the true pose, (n,)."""
        distance, e_psi, tilt = self._errors(m)
        far = 1.0 + (distance / LENGTH) ** 2
        upright = (1.0 + sin_cos(e_psi)[1]) * (1.0 + tilt) / 4.0
        spent = np.zeros(m.n)
        for column in (c for a in m.action.values() for c in a.T):
            spent = spent + column * column
        return np.asarray(upright / far - self.effort * (spent / self._width))

    def terminated(self, m: Moment) -> NDArray[np.bool_]:
        """Return the episodes whose vehicle is outside the region."""
        return np.asarray(self._errors(m)[0] > self.region)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the position error [m] and the heading error [rad], of shape (n,)."""
        distance, e_psi, _ = self._errors(m)
        return {"position_error": distance, "heading_error": np.abs(e_psi)}

    def pose_expressions(
        self, m: Symbols, wanted: Any, more: Callable[[Any], list[Any]] = lambda R: []
    ) -> Mapping[str, Any] | None:
        """Return the expressions of a task whose `wanted` N E D psi is known to the vehicle.

        `more(R)` returns the additional observations, as columns. None with privileged
        observations, which only NumPy has.
        """
        import casadi as ca

        from uuvsim_cosim.models.declaration.safe_math import clip

        if self.privileged:
            return None
        action, (low, high) = m.action["agent"], self.extra_limits
        known, eta = m[f"{self.known}.eta"], m["hull.eta"]
        R = R_zyx_expression(known[3], known[4], known[5])
        seen_psi = wrap_expression(wanted[3] - known[5])
        parts = [
            *in_body_expression(R, [wanted[k] - known[k] for k in range(3)]),
            ca.sin(seen_psi),
            ca.cos(seen_psi),
            *R[2],
            m[f"{self.known}.nu"],
            *more(R),
            action,
        ]
        d = [wanted[k] - eta[k] for k in range(3)]
        distance = ca.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        e_psi = wrap_expression(wanted[3] - eta[5])
        share = distance / LENGTH
        upright = (1.0 + ca.cos(e_psi)) * (1.0 + ca.cos(eta[3]) * ca.cos(eta[4])) / 4.0
        spent = sum(action[k] * action[k] for k in range(self._width)) / self._width
        return {
            "extra": clip(ca.vertcat(*parts), ca.DM(low), ca.DM(high)),
            "reward": upright / (1.0 + share * share) - self.effort * spent,
            "terminated": distance > self.region,
            "info": {"position_error": distance, "heading_error": ca.fabs(e_psi)},
        }

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: a mean current, and those of the randomisation."""
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

        size = vehicle_size(split_address(self.vehicle)[0])
        shown = SIZE if size is None or self.vehicle == HEAVY else (size.length, size.breadth)
        wanted = self.wanted(m)[row]
        ahead = self.path(m)
        return p.View(
            vehicles=[p.Vehicle("hull", m["hull.eta"][row], *shown)],
            goals=[p.Goal(wanted[:3], float(wanted[3]))],
            path=None if ahead is None else ahead[row],
            current=m[self._water][row],
            time=float(m.time[row]),
        )

    def path(self, m: Moment) -> Array | None:
        """Return the points ahead on the path, of shape (n, k, 3), for the picture."""
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
        c = sin_cos(eta[:, 3:5])[1]
        return distance, wrap(wanted[:, 3] - eta[:, 5]), c[:, 0] * c[:, 1]


def _channels(system: System, action: ActedOn, vehicle: str) -> list[Channel]:
    """Return the channels of an action, with the limits of the vehicle."""
    names = ("nu_d[1]", "nu_d[2]", "nu_d[3]", "nu_d[6]")
    if action == "thrusters":
        if vehicle == HEAVY:
            return [Channel(f"{name}.u") for name in THRUSTERS]
        found = [Channel(f"{c}.u") for c in system.components if c.startswith(("thruster", "prop"))]
        if "fins" in system.components:
            limits = np.asarray(system.describe("fins").variables["delta_max"].start, dtype=float)
            found.append(Channel("fins.u", (-limits).tolist(), limits.tolist()))
        return found
    if vehicle == HEAVY:
        if action == "force":
            return [Channel("allocation.tau_d", [-f for f in FORCE], FORCE)]
        return [Channel(f"controller.{n}", -s, s) for n, s in zip(names, SPEED, strict=True)]
    design = control_design(vehicle)
    if action == "force":
        most = design.tau_max
        return [
            Channel(f"allocation.tau_d[{i + 1}]", -most[i], most[i])
            for i in design.thrusters.controlled
        ]
    speeds = np.minimum(0.5 * design.top_speed, (np.inf,) * 3 + (1.0,) * 3)
    speeds[0] = min(speeds[0], 0.7 * design.stable_speed)
    return [
        Channel(f"controller.{name}", -speeds[i], speeds[i])
        for name, i in zip(names, (0, 1, 2, 5), strict=True)
        if i in design.thrusters.controlled
    ]


def _size(system: System, name: str) -> int:
    """Return the number of elements of an input, or of one element of it, which is 1."""
    component, _, variable = name.partition(".")
    return 1 if "[" in variable else system.describe(component).variables[variable].size


def published_vehicle(system: System, vehicle: str = HEAVY) -> Randomisation:
    """Return the randomisation of `randomise`: published intervals of the hull, weak thrusters."""
    return published(vehicle).bound(system) + thruster_strength(system).bound(system)
