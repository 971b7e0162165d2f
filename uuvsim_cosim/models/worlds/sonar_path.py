"""Paths of a sonar's rays: bent by a profile of the speed of sound, reflected once, or straight.

In a layer of the constant gradient g, a ray at the angle b below the horizontal follows an arc of
the radius c / (g cos b), because cos b / c is constant (Snell).
fmus/runtime/worlds/uuv_sonar_path.h follows it by chords whose ends lie on the arc. `Way` is the
same in numpy.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import asinh, isfinite, sqrt

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.errors import InputInvalid
from uuvsim_cosim.models.worlds.ground import Ground
from uuvsim_cosim.models.worlds.ray_reference import first_hit

__all__ = ["STRAIGHT", "SonarPaths", "Way", "profile_levels", "profile_of_text"]

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]
OVERLAP = 1e-6  # m, UUV_PATH_OVERLAP
FLAT = 1e-3  # UUV_PATH_FLAT
CAUSTIC = 0.1  # UUV_PATH_CAUSTIC
MOST_LEVELS = 1000
SPEEDS = (1300.0, 1800.0)  # m/s: of water, from a lake to the deepest ocean
STEEPEST = 20.0  # 1/s, of a gradient


@dataclass(frozen=True, eq=False)
class SonarPaths:
    """What bends and reflects the rays; `STRAIGHT`: nothing does.

    `level` (levels, 3) holds depth [m], speed [m/s] and gradient [1/s] below each level, which is 0
    below the last; without levels, rays are straight. `chord` [m] is the longest one in a layer
    with a gradient. `surface` (257, 2) holds real and imaginary part of the squared reflection
    coefficient at equal steps of the cosine of the incidence, `bottom` (materials, 257, 2) that of
    each material of the seabed. Without rows, nothing is reflected.
    """

    level: Array
    chord: float
    surface: Float32
    bottom: Float32


STRAIGHT = SonarPaths(
    np.zeros((0, 3)), 0.0, np.zeros((0, 2), np.float32), np.zeros((0, 0, 2), np.float32)
)


def profile_of_text(text: str) -> list[tuple[float, float]]:
    """Return the (depth [m], speed [m/s]) pairs of a text such as ``0:1500,20:1490``.

    Raises InputInvalid for a text of another form.
    """
    try:
        pairs = [tuple(map(float, pair.split(":"))) for pair in text.split(",")]
        return [(depth, speed) for depth, speed in pairs]
    except ValueError:
        raise InputInvalid(
            "sound-speed profile", repr(text), "DEPTH:SPEED,DEPTH:SPEED,..., as 0:1500,20:1490"
        ) from None


def profile_levels(pairs: Sequence[tuple[float, float]]) -> Array:
    """Return the levels (n, 3) of a `SonarPaths` from pairs of depth [m] and speed [m/s].

    The depths rise.

    Between levels, the speed is linear; above the first and below the last one it is constant.
    Levels of one speed become a single one. Raises InputInvalid for depths that do not rise, for
    speeds that water does not have, and for a gradient above 20 1/s.

    Example: 0.1 1/s between the surface and 50 m.

    >>> from uuvsim_cosim.models.worlds.sonar_path import profile_levels
    >>> profile_levels([(0.0, 1500.0), (50.0, 1505.0)]).tolist()
    [[0.0, 1500.0, 0.1], [50.0, 1505.0, 0.0]]
    """
    place = "sound-speed profile"
    if not 0 < len(pairs) <= MOST_LEVELS:
        raise InputInvalid(place, f"{len(pairs)} levels", f"1 to {MOST_LEVELS}")
    z, c = np.array(pairs, float).T
    low, high = SPEEDS
    for depth, speed in pairs:
        if not low <= speed <= high:
            expected = f"{low:g} to {high:g} m/s"
            raise InputInvalid(place, f"speed {speed:g} m/s at {depth:g} m", expected)
        if not (isfinite(depth) and depth >= 0.0):
            raise InputInvalid(place, f"depth {depth:g} m", "finite depths of 0 or more")
    falls = np.flatnonzero(~(np.diff(z) > 0.0))
    if falls.size:
        i = int(falls[0])
        raise InputInvalid(place, f"depth {z[i + 1]:g} m after {z[i]:g} m", "depths that rise")
    if np.all(c == c[0]):
        return np.array([[z[0], c[0], 0.0]])
    gradient = np.append(np.diff(c) / np.diff(z), 0.0)
    steep = int(np.abs(gradient).argmax())
    if abs(gradient[steep]) > STEEPEST:
        found = f"gradient {gradient[steep]:g} 1/s below {z[steep]:g} m"
        raise InputInvalid(place, found, f"at most {STEEPEST:g} 1/s")
    return np.stack([z, c, gradient], axis=1)


@dataclass
class Way:
    """A ray on its way from `at`, in the direction `d`: `uuv_way` in numpy.

    `across` is the derivative of `d` by the ray's elevation, `length` that of the path, `range` the
    time times the speed that the instrument assumes. `wide` and `tall` [m] are those of the ray
    tube per unit of angle, `growth` that of `tall` over that of `wide`.
    """

    at: Array
    d: Array
    across: Array
    length: float = 0.0
    range: float = 0.0
    wide: float = 0.0
    tall: float = 0.0
    growth: float = 1.0
    c: float = 1.0
    c_0: float = 0.0
    normal: Array = field(default_factory=lambda: np.zeros(3))

    @property
    def spread(self) -> float:
        """Return the distance at which a straight ray has the level of this one."""
        return sqrt(self.wide * max(abs(self.tall), CAUSTIC * self.wide))

    def bounce(self) -> None:
        """Reflect the ray at what it met."""
        n = self.normal
        self.d = self.d - 2.0 * (self.d @ n) * n
        self.across = self.across - 2.0 * (self.across @ n) * n
        self.at = self.at + OVERLAP * n

    def follow(
        self, g: Ground, solids: Array, level: Array, chord: float, far: float, ref: float
    ) -> int:
        """Go on until something is met, or the range is `far`; return its kind (uuv_hit_kind)."""
        if not len(level):
            self.c_0 = 1.0
            hit, (t, self.normal) = first_hit(g, solids, self.at, self.d, far - self.range)
            self._move(self.d, t, 1.0, 0.0, 1.0)
            return hit
        i = int(np.sum(self.at[2] >= level[:, 0])) - 1
        self.c = float(np.interp(self.at[2], level[:, 0], level[:, 1]))
        self.c_0 = self.c_0 or self.c
        flat = float(np.hypot(*self.d[:2]))
        heading = self.d[:2] / flat if flat > 1e-12 else np.array([1.0, 0.0])
        sine, cosine = float(self.d[2]), flat
        for _ in range(4096):
            if self.range >= far:
                break
            gradient = level[i, 2] if i >= 0 else 0.0
            bend = gradient * cosine / self.c
            length = (far - self.range) * self.c / ref
            length = min(length, chord) if gradient else length
            length = min(length, 0.5 / abs(bend)) if bend else length
            half = 0.5 * bend * length
            chord_angle = np.arctan2(sine, cosine) - np.arcsin(half)
            end = self.at[2] + length * np.sin(chord_angle)
            after = chord_angle - np.arcsin(half)
            to = 0
            if i + 1 < len(level) and end > level[i + 1, 0]:
                to = 1
            elif i >= 0 and end < level[i, 0]:
                to = -1
            border = level[i + 1 if to > 0 else max(i, 0)]
            if to:
                end = border[0]
                after = to * np.arccos(min(1.0, cosine * border[1] / self.c))
                down = end - self.at[2]
                run = 0.0
                if sine * to > 0.0:
                    run = down * (cosine + np.cos(after)) / (sine + np.sin(after))
                elif bend:
                    run = (sine - np.sin(after)) / bend
                length = float(np.hypot(run, down))
                chord_angle = np.arctan2(down, run) if length else chord_angle
            u = np.array([*(np.cos(chord_angle) * heading), np.sin(chord_angle)])
            over = OVERLAP if to or bend else 0.0
            hit, (t, self.normal) = first_hit(g, solids, self.at, u, length + over)
            if hit:
                self._move(u, t, self.c + gradient * t * u[2], gradient, ref)
                self._turn(heading, chord_angle + np.arcsin(bend * (0.5 * length - t)))
                return hit
            c = border[1] if to else self.c + gradient * length * u[2]
            self._move(u, length, c, gradient, ref)
            self._turn(heading, after)
            sine, cosine = float(np.sin(after)), float(np.cos(after))
            if to:
                self.at[2] = end
                above = i if to > 0 else i - 1
                jump = border[2] - (level[above, 2] if above >= 0 else 0.0)
                bent = jump * cosine**2 * self.c_0 / (self.c**2 * max(abs(sine), FLAT))
                self.growth -= bent * self.tall
                i += to
        return 0

    def _move(self, u: Array, t: float, c: float, gradient: float, ref: float) -> None:
        mean = sqrt(self.c * c)
        q = 0.5 * gradient * t / mean
        self.at = self.at + t * u
        self.length += t
        self.range += t * ref / mean * (asinh(q) / q if q else 1.0)
        grown = t * 0.5 * (self.c + c) / self.c_0
        self.wide += grown
        self.tall += grown * self.growth
        self.c = c

    def _turn(self, heading: Array, angle: float) -> None:
        turned = angle - np.arctan2(self.d[2], self.d[:2] @ heading)
        c, s = np.cos(turned), np.sin(turned)
        side = np.array([-heading[1], heading[0]])
        flat, z = self.across[:2] @ heading, self.across[2]
        level = (flat * c - z * s) * heading + (self.across[:2] @ side) * side
        self.across = np.array([*level, flat * s + z * c])
        self.d = np.array([*(np.cos(angle) * heading), np.sin(angle)])
