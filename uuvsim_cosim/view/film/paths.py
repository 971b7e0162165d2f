"""Paths of the camera of a film: beside a vehicle, at a fixed place, or by keyframes of a file.

A path gives the camera's look at any time of the run. It does not depend on the frame rate, so that
a film at half the rate has every other frame of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import cos, pi, sin
from pathlib import Path
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.declaration.near_names import expected_names
from uuvsim_cosim.models.declaration.parameter_files import read_yaml
from uuvsim_cosim.scene.shared.ray_casting import BELOW, NOTHING, Caster
from uuvsim_cosim.view.film.renderer import Look
from uuvsim_cosim.view.scene3d.motion import Motion, turned

__all__ = ["CAMERAS", "CameraPath", "Subject", "camera_path", "keyframes"]

Array = NDArray[np.float64]
CAMERAS = ("chase", "orbit", "top", "side", "fixed")
SMOOTH = 1.5  # s, before and after a moment, over which the camera averages the vehicle's motion
TURN = 40.0  # s of the run for a turn of `orbit`
LEAST_DEPTH = 0.25  # m, of the camera
ROOM = 0.85  # share of the free way from the vehicle to the camera that is used


@final
class Subject:
    """The vehicle that a camera follows: its place and attitude at any time of the run."""

    def __init__(self, motion: Motion, name: str, size: float) -> None:
        self.name, self.size = name, size
        self._time, self._p = motion.time, motion.positions[name]
        known = np.isfinite(self._p).all(axis=1)
        if not known.any():
            raise InputInvalid(name, "no position is finite", "one sample or more")
        self._time, self._p = self._time[known], self._p[known]
        q = motion.attitudes.get(name)
        self._q = np.tile([1.0, 0.0, 0.0, 0.0], (len(self._p), 1)) if q is None else q[known]
        ahead = turned(self._q, np.tile([1.0, 0.0, 0.0], (len(self._p), 1)))
        self._yaw = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return its place (3,) and R (3, 3) from `b` to `n`, between two samples by a line."""
        at = np.array([np.interp(t, self._time, self._p[:, i]) for i in range(3)])
        k = int(np.clip(np.searchsorted(self._time, t) - 1, 0, len(self._time) - 1))
        j = min(k + 1, len(self._time) - 1)
        span = self._time[j] - self._time[k]
        part = float(np.clip((t - self._time[k]) / span, 0.0, 1.0)) if span > 0 else 0.0
        a, b = self._q[k], self._q[j]
        q = a + part * (b * (1.0 if a @ b >= 0.0 else -1.0) - a)
        q = q / (np.linalg.norm(q) or 1.0)
        return at, turned(np.tile(q, (3, 1)), np.eye(3)).T

    def smooth(self, t: float) -> tuple[Array, float]:
        """Return its place (3,) and heading [rad], averaged over `SMOOTH` before and after."""
        about = t + np.linspace(-SMOOTH, SMOOTH, 9)
        about = np.clip(about, self._time[0], self._time[-1])
        at = [float(np.interp(about, self._time, self._p[:, i]).mean()) for i in range(3)]
        return np.array(at), float(np.interp(about, self._time, self._yaw).mean())


@dataclass(frozen=True)
class CameraPath:
    """Places of a camera and of its target at a time [s]; both are (3,) in `n`.

    A `strict` path is refused outside of the water; else the camera comes nearer to the vehicle.
    """

    name: str
    places: Callable[[float], tuple[Array, Array]]
    strict: bool

    def look(self, t: float, caster: Caster, subject: Subject) -> tuple[Look, bool]:
        """Return the camera at a time, and whether it was moved nearer to the vehicle.

        Raises InputInvalid for a strict path that is out of the water or below the seabed.
        """
        eye, target = self.places(t)
        if self.strict:
            _check(self.name, t, eye, caster)
            return Look.at(eye, target), False
        start = subject.pose(t)[0]
        start = np.array([start[0], start[1], max(float(start[2]), LEAST_DEPTH)])
        way = eye - start
        eye = start + way
        moved = bool(eye[2] < LEAST_DEPTH)
        eye[2] = max(float(eye[2]), LEAST_DEPTH)
        way = eye - start
        free, kind = caster.cast(start, way[None], 1.0 / ROOM)
        if kind[0] not in (NOTHING, BELOW):
            eye, moved = start + ROOM * float(free[0]) * way, True
        return Look.at(eye, target), moved


def camera_path(camera: str, subject: Subject, start: float, caster: Caster) -> CameraPath:
    """Return the path of a camera: one of `CAMERAS`, with its distance or place after a colon.

    ``chase:4`` is 4 m behind, ``fixed:10,-5,3`` stands at N, E, D and turns to the vehicle. Raises
    InputInvalid for another camera.
    """
    name, _, rest = camera.partition(":")
    if name not in CAMERAS:
        raise InputInvalid("--camera", f"{camera!r}", expected_names(name, CAMERAS))
    if name == "fixed":
        eye = _numbers(camera, rest, 3, "three numbers in metres, such as fixed:10,-5,3")
        _check(f"--camera {camera}", start, eye, caster)
        return CameraPath(f"--camera {camera}", lambda t: (eye, subject.smooth(t)[0]), True)
    usual = {"chase": 4.5, "orbit": 5.0, "top": 8.0, "side": 4.5}[name] * max(subject.size, 0.3)
    far = float(_numbers(camera, rest, 1, f"a distance, such as {name}:4")[0]) if rest else usual
    if not 0.0 < far < 1e4:
        raise InputInvalid("--camera", f"{camera!r}", "a distance above 0 and below 10,000 m")

    def beside(t: float) -> tuple[Array, Array]:
        at, yaw = subject.smooth(t)
        if name == "top":
            return at - np.array([1e-3 * far * cos(yaw), 1e-3 * far * sin(yaw), far]), at
        angle, lift = {
            "chase": (yaw + pi - 0.35, 0.32),
            "orbit": (2.0 * pi * (t - start) / TURN + 0.6, 0.35),
            "side": (yaw + 0.5 * pi, 0.12),
        }[name]
        flat = far * cos(lift)
        return at + np.array([flat * cos(angle), flat * sin(angle), -far * sin(lift)]), at

    return CameraPath(f"--camera {camera}", beside, False)


def keyframes(file: Path, subject: Subject, start: float, end: float) -> CameraPath:
    """Return the path of a file of keyframes: places of the camera, and of what it looks at.

    Between two keyframes, each coordinate goes monotonically. Without a target, the camera looks
    at the vehicle. With ``frame: vehicle``, places are ahead, to starboard and below the vehicle,
    whose motion is averaged. Raises InputInvalid for times that do not rise, or that miss the film.
    """
    from scipy.interpolate import PchipInterpolator

    data: dict[str, Any] = read_yaml(file, "camera_path.schema.json")
    frames = data["keyframes"]
    times = np.array([float(f["at"]) for f in frames])
    if not (np.diff(times) > 0.0).all():
        raise InputInvalid(file, f"times {times.tolist()}", "times that rise")
    if times[0] > end or times[-1] < start:
        raise InputInvalid(
            file, f"keyframes from {times[0]:g} to {times[-1]:g} s",
            f"times of the film, {start:g} to {end:g} s",
        )  # fmt: skip
    eyes = np.array([f["eye"] for f in frames], float)
    have = [f.get("target") for f in frames]
    if any(h is None for h in have) and any(h is not None for h in have):
        raise InputInvalid(file, "some keyframes have a target", "a target in each, or in none")
    targets = None if have[0] is None else np.array(have, float)
    follows = data.get("frame", "ned") == "vehicle"

    def course(points: Array) -> Callable[[float], Array]:
        if len(points) == 1:
            return lambda t: points[0]
        curve = PchipInterpolator(times, points)
        return lambda t: np.asarray(curve(np.clip(t, times[0], times[-1])))

    eye_at, target_at = course(eyes), None if targets is None else course(targets)

    def places(t: float) -> tuple[Array, Array]:
        at, yaw = subject.smooth(t)
        turn = np.array([[cos(yaw), -sin(yaw), 0.0], [sin(yaw), cos(yaw), 0.0], [0.0, 0.0, 1.0]])
        eye, target = eye_at(t), at if target_at is None else target_at(t)
        if not follows:
            return eye, target
        return at + turn @ eye, at if target_at is None else at + turn @ target

    return CameraPath(str(file), places, True)


def _numbers(camera: str, text: str, count: int, expected: str) -> Array:
    try:
        found = np.array([float(part) for part in text.split(",")])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise InputInvalid("--camera", f"{camera!r}", expected)
    return found


def _check(name: str, t: float, eye: Array, caster: Caster) -> None:
    """Refuse a camera that is not in the water."""
    where = f"at t = {t:.4g} s the camera is at ({', '.join(f'{v:.4g}' for v in eye)}) m"
    bed = float(caster.height(eye[:1], eye[1:2])[0])
    inside = int(caster.inside(eye)[0]) if len(caster.ground.solids) else -1
    wrong = ""
    if eye[2] < 0.0:
        wrong = "above the water"
    elif eye[2] > bed:
        wrong = f"below the seabed at {bed:.4g} m"
    elif inside >= 0:
        wrong = f"in the obstacle {caster.ground.names[inside] or f'number {inside}'}"
    if wrong:
        raise InputInvalid(name, f"{where}, {wrong}", "a place in the water")
