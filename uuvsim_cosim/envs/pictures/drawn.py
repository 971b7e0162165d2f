"""Objects of a picture, as frozen values: vehicles, targets, obstacles, goals.

Positions are N E D in metres (the frame `n`), angles in radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from uuvsim_cosim.envs.pictures.canvas import rgb
from uuvsim_cosim.envs.pictures.canvas_coverage import Floats
from uuvsim_cosim.errors import InputInvalid

__all__ = ["Arena", "Cylinder", "Goal", "Target", "Vehicle", "View"]


def _numbers(place: str, value: ArrayLike, *lengths: int) -> tuple[float, ...]:
    numbers = np.asarray(value, float)
    if numbers.ndim != 1 or len(numbers) not in lengths:
        wanted = " or ".join(str(n) for n in lengths)
        raise InputInvalid(place, f"shape {numbers.shape}", f"{wanted} numbers")
    return tuple(numbers.tolist())


def _positive(place: str, value: float) -> None:
    if not 0.0 < value < np.inf:
        raise InputInvalid(place, value, "a length above 0 m")


@dataclass(frozen=True)
class Vehicle:
    """A vehicle; if its position is not finite, it is not drawn but reported as text."""

    name: str
    eta: Sequence[float]  # N E D [m], phi theta psi [rad]
    length: float  # [m]
    breadth: float  # [m]
    colour: str | None = None  # "#rrggbb"; the palette's next one by default

    def __post_init__(self) -> None:
        object.__setattr__(self, "eta", _numbers(f"vehicle {self.name!r}, eta", self.eta, 6))
        _positive(f"vehicle {self.name!r}, length", self.length)
        _positive(f"vehicle {self.name!r}, breadth", self.breadth)
        if self.colour is not None:
            rgb(self.colour)


@dataclass(frozen=True)
class Target:
    """A target that vehicles follow."""

    position: Sequence[float]  # N E D [m]
    psi: float | None = None  # heading [rad]
    name: str = "target"
    reach: float | None = None  # radius of a dashed circle, such as the tracking distance [m]

    def __post_init__(self) -> None:
        place = f"target {self.name!r}"
        object.__setattr__(self, "position", _numbers(f"{place}, position", self.position, 3))
        if self.reach is not None:
            _positive(f"{place}, reach", self.reach)


@dataclass(frozen=True)
class Cylinder:
    """An upright obstacle."""

    x: float  # N [m]
    y: float  # E [m]
    r: float  # [m]

    def __post_init__(self) -> None:
        _positive("cylinder, r", self.r)


@dataclass(frozen=True)
class Goal:
    """The wanted position of a vehicle."""

    position: Sequence[float]  # N E or N E D [m]
    psi: float | None = None  # wanted heading [rad]

    def __post_init__(self) -> None:
        object.__setattr__(self, "position", _numbers("goal, position", self.position, 2, 3))


@dataclass(frozen=True)
class Arena:
    """Upright walls and, where there is one, a floor."""

    north: tuple[float, float]  # lowest and greatest N [m]
    east: tuple[float, float]  # lowest and greatest E [m]
    floor: float | None = None  # D [m]

    def __post_init__(self) -> None:
        for name, (low, high) in (("north", self.north), ("east", self.east)):
            if not -np.inf < low < high < np.inf:
                raise InputInvalid(f"arena, {name}", f"{low} to {high}", "lower, then greater")
        if self.floor is not None:
            _positive("arena, floor", self.floor)


@dataclass(frozen=True, eq=False)
class View:
    """The content of one picture."""

    vehicles: Sequence[Vehicle] = ()
    targets: Sequence[Target] = ()
    obstacles: Sequence[Cylinder] = ()
    goals: Sequence[Goal] = ()
    path: ArrayLike | None = None  # reference, (n, 2 or 3) N E D [m]
    trails: Sequence[ArrayLike] = ()  # (n, 2 or 3) each, besides those that Picture remembers
    arena: Arena | None = None
    current: Sequence[float] | None = None  # N E or N E D [m/s]
    time: float | None = None  # [s]
    title: str = ""
    lines: Sequence[str] = ()  # such as "reward  0.93"

    def __post_init__(self) -> None:
        if self.path is not None:
            object.__setattr__(self, "path", _track("path", self.path))
        object.__setattr__(
            self, "trails", tuple(_track(f"trail {i}", t) for i, t in enumerate(self.trails))
        )
        if self.current is not None:
            object.__setattr__(self, "current", _numbers("current", self.current, 2, 3))


def _track(place: str, value: ArrayLike) -> Floats:
    """Return N and E of a track (n, 2)."""
    track = np.array(value, float)
    if track.ndim != 2 or track.shape[1] not in (2, 3):
        raise InputInvalid(place, f"shape {track.shape}", "(n, 2) or (n, 3)")
    return track[:, :2]
