"""Altitude following: a course at constant height above a seabed, measured by echosounders."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.envs.task.episode_draws import Draws
from uuvsim_cosim.envs.task.task import Array, Moment
from uuvsim_cosim.envs.tasks.coordinates import in_body
from uuvsim_cosim.envs.tasks.pose import PoseTask
from uuvsim_cosim.envs.tasks.ranges import pair, within
from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.orchestrator.shipped.tasks import ActedOn, Observed, task_system
from uuvsim_cosim.orchestrator.system.system import System
from uuvsim_cosim.scene.shared.ray_casting import Caster

__all__ = ["FIRST", "AltitudeFollowing"]

AHEAD = np.pi / 4  # rad, by which the second beam looks forward
PLACE = (0.15, 0.0, 0.10)  # m, of both in b (models/sensors/ping)
WIDTH = np.radians(25.0)  # of both beams (models/sensors/ping)
FIRST = AHEAD - WIDTH / 2  # rad, where over level ground the first echo of it comes from
ECHOES = ("echo_down", "echo_ahead")
LEAST = 3.0  # m, of water above a vehicle where a course begins
MARGIN = 40.0  # m, from the terrain's edges, that the beginning of a course keeps


class AltitudeFollowing(PoseTask):
    """Follow a point on a straight course at a constant `altitude` [m] above a seabed.

    Each episode draws the start of the course on the seabed of `scene`, its heading, its speed
    within `speed` [m/s], and the start of the vehicle, up to `away` m from the point along each
    axis. The reward and the other options are those of all tasks with a wanted pose (`PoseTask`,
    docs/learning/tasks.md), with the true distance to the point.

    The vehicle knows N and E of the point, but not the depth of the seabed. The third number of the
    observation is therefore the range of a vertical beam (an altimeter, 10 Hz) minus `altitude`.
    The task adds the velocity of the course in body axes (3) and a 0, then the range of a beam 45
    degrees ahead minus that over level ground (over 1 m), and whether each beam has an echo (2).
    """

    def __init__(
        self,
        *,
        scene: str = "hills",
        altitude: float = 3.0,
        speed: tuple[float, float] = (0.2, 0.5),
        away: float = 0.5,
        **options: Any,
    ) -> None:
        if not isinstance(scene, str) or not scene:
            raise InputInvalid("scene", f"{scene!r}", "the name of a scene, or its path")
        self.scene = scene
        self.altitude = within("altitude [m]", altitude, 1.0, 20.0)
        self.speed = pair("speed [m/s]", speed)
        self.away = within("away [m]", away, 0, np.inf)
        signals = [f"{e}.{s}" for e in ECHOES for s in ("altitude", "valid")]
        self._begins = _begins(scene, self.altitude + LEAST)
        signals += ["reference.eta_d", "reference.nu_d"]
        super().__init__(reference=True, signals=signals, **options)

    def made_of(
        self, action: ActedOn, observation: Observed, reference: bool, disturbances: bool
    ) -> System:
        """Add two echosounders over the scene to the system of a pose."""
        return _with_echoes(action, observation, reference, disturbances, self.scene, self.vehicle)

    def wanted(self, m: Moment) -> Array:
        """Return the moving point, at its height above the true seabed."""
        point = m["reference.eta_d"][:, [0, 1, 2, 5]].copy()
        depth = self._height(point) - self.altitude
        # Beyond the terrain's edge there is no height to keep: the vehicle's own depth is wanted.
        point[:, 2] = np.where(np.isfinite(depth), depth, m["hull.eta"][:, 2])
        return point

    def seen(self, m: Moment) -> Array:
        """Return the point as the vehicle knows it, with the depth from the vertical echo."""
        eta, point = m[f"{self.known}.eta"], m["reference.eta_d"][:, [0, 1, 2, 5]].copy()
        heard = m["echo_down.altitude"] * np.cos(eta[:, 3]) * np.cos(eta[:, 4])
        beyond = heard + PLACE[2] - self.altitude
        point[:, 2] = eta[:, 2] + np.where(heard > 0, beyond, 0.0)
        return point

    def more(self, m: Moment, R: Array) -> list[Array]:
        """Return the course's velocity, and the measurement of the beam ahead."""
        psi, U = m["reference.eta_d"][:, 5], m["reference.nu_d"][:, 0]
        v = np.column_stack([U * np.cos(psi), U * np.sin(psi), np.zeros(m.n)])
        down, ahead = (m[f"{e}.altitude"] for e in ECHOES)
        beyond = np.where((ahead > 0) & (down > 0), ahead - down / np.cos(FIRST), 0.0)
        heard = [np.asarray(m[f"{e}.valid"], float) for e in ECHOES]
        return [in_body(R, v), np.zeros((m.n, 1)), beyond[:, None], np.column_stack(heard)]

    def more_limits(self) -> list[float]:
        """Return the limits of the numbers of `more`."""
        return [1.0] * 3 + [2.0, 20.0, 1.0, 1.0]

    def info(self, m: Moment) -> Mapping[str, NDArray[np.generic]]:
        """Return the errors of `PoseTask`, and the altitude [m]."""
        eta = m["hull.eta"]
        return {**super().info(m), "altitude": self._height(eta) - eta[:, 2]}

    def _height(self, place: Array) -> Array:
        """Return the seabed's depth below N and E (n, 2 or more) [m]."""
        return _caster(self.scene).height(place[:, 0], place[:, 1])

    def start(self, draws: Draws) -> Mapping[str, Array]:
        """Draw a course within the terrain, and a start near it."""
        n = draws.n
        course = draws.uniform("course", -np.pi, np.pi)
        origin = np.zeros((n, 3))
        place = draws.uniform("course/place", 0.0, len(self._begins))
        origin[:, :2] = self._begins[np.minimum(place.astype(int), len(self._begins) - 1)]
        seabed = self._height(origin)
        pose = np.zeros((n, 6))
        pose[:, :2] = origin[:, :2]
        pose[:, 2] = seabed - self.altitude
        pose[:, :3] += draws.uniform("start/p", -self.away, self.away, (3,))
        pose[:, 5] = course + draws.uniform("start/psi", -0.8, 0.8)
        curve = {
            "reference.origin": origin,
            "reference.course": course,
            "reference.U": draws.uniform("course/speed", *self.speed),
            "reference.w": np.zeros(n),
            "reference.rate": np.zeros(n),
            "reference.A": np.zeros((n, 3)),
            "reference.A_c": np.zeros(n),
        }
        return {**self.at(draws, pose), **curve, **super().start(draws)}


@lru_cache(maxsize=8)
def _with_echoes(
    action: ActedOn,
    observation: Observed,
    reference: bool,
    disturbances: bool,
    scene: str,
    vehicle: str,
) -> System:
    system = task_system(action, observation, reference, disturbances, vehicle)
    for name, pitch in zip(ECHOES, (0.0, AHEAD), strict=True):
        start = {"Theta_s": (0.0, pitch, 0.0), "r_s": PLACE, "beam_width": WIDTH,
                 "incidence_max": 1.4}  # fmt: skip
        system = system.add(name, f"model:altimeter?scene={quote(scene)}", start=start)
        system = system.connect("hull.eta", f"{name}.eta").connect("hull.q", f"{name}.q")
    return system


@lru_cache(maxsize=8)
def _caster(scene: str) -> Caster:
    return Caster(scene)


@lru_cache(maxsize=8)
def _begins(scene: str, least: float) -> Array:
    """Return the nodes (n, 2) that are deep enough and far enough from the edges for a start."""
    g = _caster(scene).ground
    if min(g.z.shape) < 2:
        raise InputInvalid(f"scene {scene!r}", "has no terrain", "one to follow")
    deep = np.nan_to_num(g.z, nan=-1.0) >= least
    rim = min(int(np.ceil(MARGIN / g.spacing)), (min(g.z.shape) - 1) // 2)
    inside = np.zeros_like(deep)
    inside[rim : g.z.shape[0] - rim, rim : g.z.shape[1] - rim] = True
    nodes = np.argwhere(deep & inside)
    if len(nodes) == 0:
        raise InputInvalid(
            f"scene {scene!r}",
            f"nowhere {least:g} m deep, {MARGIN:g} m from its edges",
            "a deeper one, or a smaller altitude",
        )
    return np.asarray(np.array(g.origin) + g.spacing * nodes)
