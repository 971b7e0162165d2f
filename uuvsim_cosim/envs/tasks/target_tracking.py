"""Target tracking: N vehicles in a pool follow a moving target, without collisions.

State (5), action (6) and reward (7) of the UUVSim paper; `tracking_reward` holds its numbers, and
docs/learning/target_tracking.md lists the choices that the paper leaves open.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.expressions import Logical, Symbols
from uuvsim_cosim.envs.task.task import Array, Channel, Mask, Moment, Randomised, Symmetry, TeamTask
from uuvsim_cosim.envs.tasks.ranges import known_options, numbers, one_of, randomised, whole, within
from uuvsim_cosim.envs.tasks.tracking_observation import (
    Seen,
    egocentric,
    egocentric_expression,
    largest,
    symmetries,
)
from uuvsim_cosim.envs.tasks.tracking_reward import (
    Scene,
    Terms,
    mean_over,
    reward_terms,
    rules_of,
    terms_expression,
)
from uuvsim_cosim.envs.tasks.tracking_start import Arena, drawn_scene, waypoints
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.shipped.tracking import (
    ARENA,
    DEPTH,
    LATENCY,
    TRACKED,
    TRACKERS_MAX,
    target_tracking,
)

if TYPE_CHECKING:
    from uuvsim_cosim.envs.pictures.picture import View

__all__ = ["TargetTracking", "tracking_system"]

SORTED = 8  # obstacles whose order is written out in the expressions
A_MAX, OMEGA_MAX, V_MAX = 0.4, 1.5, 0.4  # m/s2, rad/s, m/s: the preset tracking_pilot
Motion = Literal["random_heading", "flee", "path", "rest"]


class TargetTracking(TeamTask):
    """Target tracking: `n_trackers` vehicles follow a target among `n_obstacles` obstacles.

    An episode has 50 actions of 0.4 s. `motion` is the motion of the target with `target_speed`
    [m/s]: "random_heading", "flee", "path", or "rest", the point of the source scenario. `profile`
    selects the rules of the reward, and `rules` changes them by name (see `TrackingRules`).
    `vehicle` is "pool8" or "bluerov2_heavy", and `arena` the size of the pool in N, E and D [m].

    Positions are measured with `delay` [s], standard deviation `noise` [m] and the share `loss` of
    lost messages. A tracker that is farther from the target than `knowledge_range` [m] does not
    observe it. `slots` are the numbers of other trackers and of obstacles in an observation.
    `frame`, "body" or "world", is the frame of the velocities in the state.
    """

    def __init__(
        self,
        n_trackers: int = 2,
        n_obstacles: int = 0,
        *,
        motion: Motion = "random_heading",
        target_speed: float = 0.15,
        profile: str = "default",
        vehicle: str = "pool8",
        rules: Mapping[str, object] | None = None,
        delay: float = 0.0,
        noise: float = 0.0,
        loss: float = 0.0,
        knowledge_range: float | None = None,
        slots: tuple[int, int] | None = None,
        frame: Literal["body", "world"] = "body",
        arena: tuple[float, float, float] = ARENA,
        action_step: Fraction | str | float = "0.4",
        horizon: Fraction | str | float = 20,
        randomisation: Randomised | None = None,
        **unknown: object,
    ) -> None:
        known_options(type(self), unknown)
        one_of("motion", motion, get_args(Motion))
        one_of("frame", frame, ("body", "world"))
        randomised(randomisation)
        changes = {} if rules is None else rules
        if not isinstance(changes, Mapping) or not all(isinstance(k, str) for k in changes):
            raise InputInvalid("rules", f"{rules!r}", "values by name, as {'w_p': 0.02}")
        self.rules = rules_of(profile, vehicle, **changes)
        self.team_reward = self.rules.credit == "team"
        self.profile, self.vehicle, self.motion, self.frame = profile, vehicle, motion, frame
        self.n_trackers = whole("n_trackers", n_trackers, 1, TRACKERS_MAX)
        self.n_obstacles = whole("n_obstacles", n_obstacles, 0, 64)
        self.delay = within("delay [s]", delay, 0, LATENCY)
        self.noise = within("noise [m]", noise, 0, np.inf)
        self.loss = within("loss", loss, 0, 1)
        self.links = self.delay > 0 or self.noise > 0 or self.loss > 0
        self.knowledge_range = (
            None
            if knowledge_range is None
            else within("knowledge_range [m]", knowledge_range, 0, np.inf)
        )
        speed = within("target_speed [m/s]", target_speed, 0, np.inf)
        self.target_speed = 0.0 if motion == "rest" else speed
        least = (self.n_trackers - 1, self.n_obstacles)
        if slots is None:
            slots = max(1, least[0]), max(2, least[1])
        if not isinstance(slots, Sequence) or isinstance(slots, str) or len(slots) != 2:
            expected = f"two numbers, of other trackers and of obstacles, at least {least}"
            raise InputInvalid("slots", f"{slots!r}", expected)
        self.slots = (
            whole("slots, other trackers", slots[0], least[0]),
            whole("slots, obstacles", slots[1], least[1]),
        )
        numbers("arena [m]", arena, ("N", "E", "D"), 1e-9)
        agents = [f"tracker_{i}" for i in range(1, self.n_trackers + 1)]
        signals, shared = ["hull.eta", "hull.nu", "pilot.nu_d"], ["target.position"]
        a, omega = "pilot.a", "pilot.omega"
        if self.links:
            signals.append("positioning.y")
            shared.append("positioning.y")
            a, omega = "radio.x[1]", "radio.x[2]"
        radius = TRACKED[vehicle].radius if vehicle in TRACKED else 0.0
        self.arena = Arena(arena, from_wall=radius + 0.1)
        super().__init__(
            tracking_system(
                self.n_trackers,
                vehicle=vehicle,
                motion="random_heading" if motion == "rest" else motion,
                obstacles=self.n_obstacles,
                links=self.links,
                arena=tuple(arena),
            ),
            agents=agents,
            actions={
                agent: (
                    Channel(f"{agent}.{a}", -A_MAX, A_MAX, "m/s2"),
                    Channel(f"{agent}.{omega}", -OMEGA_MAX, OMEGA_MAX, "rad/s"),
                )
                for agent in agents
            },
            action_step=action_step,
            horizon=horizon,
            signals=[*(f"{agent}.{name}" for agent in agents for name in signals), *shared],
            randomisation=randomisation,
        )
        self.stride = V_MAX * float(self.action_step)

    # ---- the task's methods ---------------------------------------------------------------

    def observe(self, m: Moment) -> Mapping[str, Array]:
        """Return each tracker's egocentric observation, clipped to its limits."""
        return {a: np.clip(o, *self.limits(a)) for a, o in self.unclipped(m).items()}

    def unclipped(self, m: Moment) -> Mapping[str, Array]:
        """Return each tracker's egocentric observation."""
        seen, size = self._seen(m), self.arena.size
        return {
            agent: egocentric(i, seen, self.slots, (size[0], size[1]), V_MAX, self.stride)
            for i, agent in enumerate(self.agents)
        }

    def limits(self, agent: str) -> tuple[Array, Array]:
        """Return the limits of an observation."""
        high = largest(self.slots, (self.arena.size[0], self.arena.size[1]))
        return -high, high

    def symmetries(self) -> tuple[Symmetry, ...]:
        """Return the arena's symmetries; () with a path or a randomisation, which break them."""
        if self.motion == "path" or self.randomisation is not None:
            return ()
        return symmetries(self.slots)

    def reward(self, m: Moment) -> Mapping[str, Array]:
        """Return each tracker's reward, equation (7)."""
        rewards = self.terms(m).rewards(self.rules)
        return {agent: rewards[:, i] for i, agent in enumerate(self.agents)}

    def terminated(self, m: Moment) -> Mapping[str, Mask]:
        """Return the episodes that a collision has ended; none if `end_on_collision` is False."""
        ends = self.rules.end_on_collision
        ended = self.terms(m).violated.any(axis=1) if ends else np.zeros(m.n, bool)
        return dict.fromkeys(self.agents, np.asarray(ended))

    def state(self, m: Moment) -> Array:
        """Return the state, equation (5), of shape (n, width).

        It has x, y, theta of each tracker, v_x, v_y, omega of each tracker, x, y of the target, and
        x, y, radius, height of each obstacle [m, rad, m/s, rad/s].
        """
        eta, nu = self._of_all(m, "hull.eta"), self._of_all(m, "hull.nu")
        v = nu[:, :, [0, 1, 5]]
        if self.frame == "world":
            c, s = np.cos(eta[:, :, 5]), np.sin(eta[:, :, 5])
            v = np.stack([c * v[..., 0] - s * v[..., 1], s * v[..., 0] + c * v[..., 1], v[..., 2]],
                         axis=2)  # fmt: skip
        parts = [eta[:, :, [0, 1, 5]], v, m["target.position"][:, :2], self._obstacles(m)]
        flat = np.concatenate([p.reshape(m.n, -1) for p in parts], axis=1)
        low, high = self.state_limits()
        return np.asarray(np.clip(flat, low, high))

    def state_limits(self) -> tuple[Array, Array]:
        """Return the limits of the state, equation (5) [m, rad, m/s, rad/s]."""
        x, y, z = self.arena.size
        high = [x, y, np.pi] * self.n_trackers + [2.0, 2.0, 10.0] * self.n_trackers + [x, y]
        high += [x, y, max(x, y), z] * self.n_obstacles
        return -np.array(high), np.array(high)

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the metrics of this step, and the mean of each weighted term of the reward.

        "track": the nearest tracker is within d_m of the target; "dist": its distance [m]; "viol"
        and "clean": whether there is a penalty, and whether there is none.
        """
        t, rules = self.terms(m), self.rules
        viol = t.violated.any(axis=1)
        return {
            "track": t.nearest <= rules.d_m,
            "dist": t.nearest,
            "viol": viol,
            "clean": ~viol,
            "r_c": rules.w_c * t.r_c,
            "r_t": rules.w_t * mean_over(t.r_t),
            "r_a": rules.w_a * mean_over(t.r_a),
            "p_1": rules.w_p * mean_over(t.p_1),
            "p_2": rules.w_p * mean_over(t.p_2),
            "p_3": rules.w_p * mean_over(t.p_3),
        }

    def expressions(self, m: Symbols) -> Mapping[str, Any] | None:
        """Return observations, rewards, ends and infos of up to two trackers as expressions.

        None for more trackers, many obstacles, and edges of weight exp(...).
        """
        import casadi as ca

        from uuvsim_cosim.models.declaration.safe_math import clip

        if self.n_trackers > 2 or self.n_obstacles > SORTED:
            return None
        rules, agents = self.rules, self.agents
        obstacles: list[Any] = []
        if self.n_obstacles:
            rows = m.start["target.obstacles"]
            obstacles = [[rows[k, j] for j in range(4)] for k in range(rows.shape[0])]
        circles = [o[:3] for o in obstacles]
        reaches = [self.arena.size[2] - o[3] <= DEPTH for o in obstacles]

        def scene(at: Symbols) -> Scene:
            trackers = [at[f"{a}.hull.eta"] for a in agents]
            return Scene(trackers, at["target.position"], circles, reaches)

        t = terms_expression(scene(m), scene(m.before), rules, self.stride)
        if t is None:
            return None
        eta = [m[f"{a}.hull.eta"] for a in agents]
        target, earlier = m["target.position"], m.before["target.position"]
        if self.links:
            first, second = m.step == 0, m.step <= 1
            eta = [
                ca.if_else(first, x, m[f"{a}.positioning.y"])
                for a, x in zip(agents, eta, strict=True)
            ]
            target = ca.if_else(first, target, m["positioning.y"])
            earlier = ca.if_else(second, earlier, m.before["positioning.y"])
        known = [ca.SX(1.0)] * len(agents)
        if self.knowledge_range is not None:
            apart = [(target[0] - x[0], target[1] - x[1]) for x in eta]
            known = [x * x + y * y <= self.knowledge_range**2 for x, y in apart]
        seen = Seen(
            eta=eta,
            nu=[m[f"{a}.hull.nu"] for a in agents],
            u_d=[m[f"{a}.pilot.nu_d"][0] for a in agents],
            target=[target] * len(agents),
            target_before=[earlier] * len(agents),
            known=known,
            obstacles=circles,
            reaches=reaches,
        )
        size = self.arena.size[:2]
        whole = [
            egocentric_expression(i, seen, self.slots, size, V_MAX, self.stride)
            for i in range(len(agents))
        ]
        own = [
            rules.w_t * r_t + rules.w_a * r_a + rules.w_p * (p_1 + p_2 + p_3)
            for r_t, r_a, p_1, p_2, p_3 in zip(t.r_t, t.r_a, t.p_1, t.p_2, t.p_3, strict=True)
        ]
        if rules.credit == "team":
            own = [mean_over(own)] * len(agents)
        viol = ca.SX(0.0) == 1.0
        for term in (*t.p_1, *t.p_2, *t.p_3):
            viol = ca.logic_or(viol, term != 0.0)
        ended = viol if rules.end_on_collision else ca.SX(0.0)
        return {
            "observe": {a: clip(o, *self.limits(a)) for a, o in zip(agents, whole, strict=True)},
            "reward": {a: x + rules.w_c * t.r_c for a, x in zip(agents, own, strict=True)},
            "terminated": dict.fromkeys(agents, ended),
            "info": {
                "track": Logical(t.nearest <= rules.d_m),
                "dist": t.nearest,
                "viol": Logical(viol),
                "clean": Logical(ca.logic_not(viol)),
                "r_c": rules.w_c * t.r_c,
                "r_t": rules.w_t * mean_over(t.r_t),
                "r_a": rules.w_a * mean_over(t.r_a),
                "p_1": rules.w_p * mean_over(t.p_1),
                "p_2": rules.w_p * mean_over(t.p_2),
                "p_3": rules.w_p * mean_over(t.p_3),
            },
        }

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Return start values: a start without collisions, and those of the randomisation."""
        n = draws.n
        drawn = drawn_scene(draws, self.arena, self.rules, self.n_trackers, self.n_obstacles)
        start: dict[str, Array] = {
            "target.position_0": np.column_stack([drawn.target, np.full(n, DEPTH)]),
            "target.psi_0": drawn.psi_target,
            "target.speed": np.full(n, self.target_speed),
        }
        if self.motion == "path":
            start |= waypoints(draws, self.arena)
        if self.n_obstacles:
            start["target.obstacles"] = drawn.obstacles
        if self.links:
            start["positioning.delay"] = np.full(n, self.delay)
            start["positioning.sigma"] = np.full((n, 3), self.noise)
            start["positioning.loss"] = np.full(n, self.loss)
        for i, agent in enumerate(self.agents):
            pose = np.zeros((n, 6))
            pose[:, :2], pose[:, 2], pose[:, 5] = drawn.trackers[:, i], DEPTH, drawn.psi[:, i]
            start[f"{agent}.hull.eta_0"] = pose
            start[f"{agent}.pilot.depth"] = np.full(n, DEPTH)
            if self.n_obstacles:
                start[f"{agent}.pool.obstacles"] = drawn.obstacles
            if self.links:
                start[f"{agent}.radio.delay"] = np.full(n, self.delay)
                start[f"{agent}.positioning.sigma"] = np.tile([self.noise] * 3 + [0.0] * 3, (n, 1))
        return {**start, **super().start(draws)}

    def view(self, m: Moment, row: int) -> View:
        """Return the picture of one environment."""
        from uuvsim_cosim.envs.pictures import drawn as p

        x, y, z = self.arena.size
        size = 2.0 * TRACKED[self.vehicle].radius
        return p.View(
            vehicles=[
                p.Vehicle(a, m[f"{a}.hull.eta"][row], 0.8 * size, 0.6 * size) for a in self.agents
            ],
            targets=[p.Target(m["target.position"][row], reach=self.rules.d_m)],
            obstacles=[p.Cylinder(*o[:3]) for o in self._obstacles(m)[row] if o[2] > 0],
            arena=p.Arena((-x / 2, x / 2), (-y / 2, y / 2), z),
            time=float(m.time[row]),
        )

    # ---- inside ---------------------------------------------------------------------------

    def terms(self, m: Moment) -> Terms:
        """Return the terms of the reward of the action that led to this moment."""
        return reward_terms(self._scene(m), self._scene(m.before), self.rules, self.stride)

    def _scene(self, m: Moment) -> Scene:
        trackers = self._of_all(m, "hull.eta")[:, :, :2]
        obstacles = self._obstacles(m)
        return Scene(
            trackers, m["target.position"][:, :2], obstacles[:, :, :3], self._reaches(obstacles)
        )

    def _seen(self, m: Moment) -> Seen:
        eta = self._of_all(m, "hull.eta")
        target, earlier = m["target.position"], m.before["target.position"]
        if self.links:  # links have no sample yet: the start is known
            first, second = (m.step == 0)[:, None], (m.step <= 1)[:, None]
            eta = np.where(first[:, None], eta, self._of_all(m, "positioning.y"))
            target = np.where(first, target, m["positioning.y"])
            earlier = np.where(second, earlier, m.before["positioning.y"])
        target, earlier = (
            np.repeat(x[:, None, :2], self.n_trackers, axis=1) for x in (target, earlier)
        )
        known = np.ones(target.shape[:2], bool)
        if self.knowledge_range is not None:
            d = target - eta[:, :, :2]
            known = d[..., 0] ** 2 + d[..., 1] ** 2 <= self.knowledge_range**2
        obstacles = self._obstacles(m)
        return Seen(
            eta=eta,
            nu=self._of_all(m, "hull.nu"),
            u_d=self._of_all(m, "pilot.nu_d")[:, :, 0],
            target=target,
            target_before=earlier,
            known=known,
            obstacles=obstacles[:, :, :3],
            reaches=self._reaches(obstacles),
        )

    def _of_all(self, m: Moment, name: str) -> Array:
        return np.stack([m[f"{agent}.{name}"] for agent in self.agents], axis=1)

    def _obstacles(self, m: Moment) -> Array:
        if not self.n_obstacles:
            return np.zeros((m.n, 0, 4))
        return m.start["target.obstacles"]

    def _reaches(self, obstacles: Array) -> Mask:
        return np.asarray(self.arena.size[2] - obstacles[:, :, 3] <= DEPTH)


# Equal arguments give the same system, so that its kernel is made once.
tracking_system = lru_cache(maxsize=32)(target_tracking)
