"""Solid primitives that stand or move in the water: box, sphere, capsule, cylinder."""

from dataclasses import dataclass

__all__ = ["Box", "Capsule", "Cylinder", "Obstacle", "Sphere"]

Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Box:
    """A box turned about the vertical."""

    centre: Vector3  # m, N E D
    half: Vector3  # m, half its length, width and height, along its own axes
    yaw: float = 0.0  # rad, from N towards E
    name: str = ""
    friction: float | None = None  # of steel on it; None: that of the contact
    material: str = ""  # that a sonar meets, of models/materials.yaml


@dataclass(frozen=True)
class Sphere:
    """A ball."""

    centre: Vector3  # m, N E D
    radius: float  # m
    name: str = ""
    friction: float | None = None  # of steel on it; None: that of the contact
    material: str = ""  # that a sonar meets, of models/materials.yaml


@dataclass(frozen=True)
class Capsule:
    """All points within `radius` of the line from `start` to `end`."""

    start: Vector3  # m, N E D
    end: Vector3  # m, N E D
    radius: float  # m
    name: str = ""
    friction: float | None = None  # of steel on it; None: that of the contact
    material: str = ""  # that a sonar meets, of models/materials.yaml


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder."""

    centre: Vector3  # m, N E D
    radius: float  # m
    half_height: float  # m
    name: str = ""
    friction: float | None = None  # of steel on it; None: that of the contact
    material: str = ""  # that a sonar meets, of models/materials.yaml


Obstacle = Box | Sphere | Capsule | Cylinder
