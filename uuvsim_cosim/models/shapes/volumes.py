"""The volumes that a hull displaces: ellipsoids, cylinders and boxes, as its file lists them.

A file that lists none gets one equivalent volume of its outline: a box for a box, a cylinder along
x for a torpedo, an ellipsoid for an ellipsoid. Only shares matter: a set's own buoyancy is spread
over the volumes, and they are shifted together so that their middle is the set's r_b.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import pi
from typing import Any

from uuvsim_cosim.errors import ParameterInvalid
from uuvsim_cosim.models.declaration.parameter_files import (
    in_unit,
    line_of,
    vehicle_file,
    vehicle_size,
)

__all__ = ["Volume", "sphere", "vehicle_volumes"]

_FILLED = {"box": 1.0, "ellipsoid": pi / 6.0, "cylinder": pi / 4.0}
_OF_OUTLINE = {"box": "box", "torpedo": "cylinder", "ellipsoid": "ellipsoid"}


@dataclass(frozen=True)
class Volume:
    """One volume: its middle r from CO and its extents along x, y, z [m], both in b."""

    shape: str  # ellipsoid, cylinder or box
    r: tuple[float, float, float]
    size: tuple[float, float, float]
    axis: int = 0  # of a cylinder: 0, 1, 2 for x, y, z

    @property
    def displaced(self) -> float:
        """Return its volume [m3]."""
        a, b, c = self.size
        return _FILLED[self.shape] * a * b * c


def sphere(radius: float, r: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Volume:
    """Return a sphere with its middle at r from CO [m]."""
    return Volume("ellipsoid", r, (2.0 * radius,) * 3)


def vehicle_volumes(id: str) -> list[Volume]:
    """Read the volumes of a vehicle; raises ParameterInvalid with file and line of each mistake."""
    path, data = vehicle_file(id)
    if "volumes" not in data:
        size = vehicle_size(id)
        if size is None:
            raise ParameterInvalid(
                path, "neither volumes nor a size", "one of them for surface=volumes"
            )
        outline = (size.length, size.breadth, size.height)
        return [Volume(_OF_OUTLINE[size.shape], size.at, outline)]
    listed = data["volumes"]
    try:
        factor = in_unit(1.0, str(listed["unit"]), "m")
    except ValueError as error:
        line = line_of(data, ["volumes", "unit"])
        raise ParameterInvalid(f"{path}:{line}: volumes: {error}") from None

    def scaled(values: Sequence[Any]) -> tuple[float, float, float]:
        x, y, z = (factor * float(v) for v in values)
        return x, y, z

    volumes = []
    for entry in listed["of"]:
        shape, r = str(entry["shape"]), scaled(entry["r"])
        if shape == "sphere":
            volumes.append(sphere(0.5 * factor * float(entry["diameter"]), r))
        elif shape == "cylinder":
            axis = "xyz".index(str(entry["axis"]))
            extents = [entry["diameter"]] * 3
            extents[axis] = entry["length"]
            volumes.append(Volume(shape, r, scaled(extents), axis))
        else:
            volumes.append(Volume(shape, r, scaled(entry["size"])))
    return volumes
