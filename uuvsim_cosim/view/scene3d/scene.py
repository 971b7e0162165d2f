"""Scene of a system: the parts to draw in three dimensions, and the signals that move them.

It depends on no drawing library; the live view, the report and the exporters all read it. All
lengths are in metres, in NED (`n`), or in a body's axes FRD (`b`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from uuvsim_cosim.models.worlds.terrain import Terrain

if TYPE_CHECKING:
    from uuvsim_cosim.models.sensors.sonar_axes import SonarAxes
    from uuvsim_cosim.models.worlds.scene import Scene

__all__ = ["Arrow", "Body", "Line", "Marker", "Mesh", "Rays", "Scene3D", "Solid"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (V, 3) [m], and their indices (F, 3), anticlockwise seen from outside."""

    vertices: NDArray[np.float32]
    faces: NDArray[np.uint32]


@dataclass(frozen=True)
class Arrow:
    """A thrust: an arrow from r along e in `b`, whose length is its signal."""

    name: str
    signal: str  # "thruster_1.thrust" [N], or "wrench.thrust[1]"
    r: tuple[float, float, float]  # m
    e: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Rays:
    """Beams of a sensor: from r along directions (n, 3) in `b`, of the lengths in a signal."""

    name: str
    signal: str  # (n,) [m]; 0, less, or not finite: no echo
    r: Array  # (3,)
    directions: Array  # (n, 3); multiplied by the reading, it is the ray
    valid: str = ""  # (n,) or one for all; 0: no echo


@dataclass(frozen=True, eq=False)
class Body:
    """A vehicle: its hull, and the signals of its pose."""

    name: str
    hull: Mesh
    eta: str  # (6,) N E D [m], phi theta psi [rad]
    q: str = ""  # (4,) scalar first; "": eta's angles count
    arrows: tuple[Arrow, ...] = ()
    rays: tuple[Rays, ...] = ()
    estimate: str = ""  # signal of its navigation's estimate: N E D first

    @property
    def size(self) -> float:
        """Its longest extent [m]."""
        return float(np.ptp(self.hull.vertices, axis=0).max())


@dataclass(frozen=True)
class Marker:
    """A point that moves: a target."""

    name: str
    signal: str  # N E D first [m]
    radius: float = 0.1


@dataclass(frozen=True, eq=False)
class Line:
    """A still line: planned waypoints."""

    name: str
    points: Array  # (n, 3)


@dataclass(frozen=True, eq=False)
class Solid:
    """A still body: a pool's basin, an obstacle, a flat bottom."""

    name: str
    mesh: Mesh
    kind: str  # "obstacle", "basin" (seen from within), "floor"


@dataclass(frozen=True, eq=False)
class Scene3D:
    """All that can be drawn of one system."""

    name: str
    bodies: tuple[Body, ...] = ()
    markers: tuple[Marker, ...] = ()
    lines: tuple[Line, ...] = ()
    solids: tuple[Solid, ...] = ()
    terrain: Terrain | None = None
    bottom: float | None = None  # m, depth of a flat bottom, where there is no terrain
    notes: tuple[str, ...] = ()  # parts that could not be drawn, and why
    sonars: Mapping[str, SonarAxes] = field(default_factory=dict)  # with images, by their path
    world: Scene | None = None  # the scene whose terrain and solids these are, as rays meet it

    @property
    def signals(self) -> tuple[str, ...]:
        """List the signals that move it, each once."""
        names: list[str] = []
        for b in self.bodies:
            names += [b.eta, b.q, b.estimate, *(a.signal for a in b.arrows)]
            names += [s for r in b.rays for s in (r.signal, r.valid)]
        names += [m.signal for m in self.markers]
        return tuple(dict.fromkeys(n for n in names if n))

    def with_lines(self, *lines: Line) -> Scene3D:
        """Return the scene with these lines as well."""
        return replace(self, lines=(*self.lines, *lines))
