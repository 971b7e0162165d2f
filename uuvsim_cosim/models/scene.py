"""A scene folder: terrain, obstacles and the water's edge, as `scene.yaml` says."""

from dataclasses import dataclass
from pathlib import Path

from uuvsim_cosim.models.obstacles import Obstacle
from uuvsim_cosim.models.terrain import Terrain

__all__ = ["Scene"]


@dataclass(frozen=True, eq=False)
class Scene:
    """What stands still in a mission's world; frame `n`, its water surface at D = 0."""

    name: str
    terrain: Terrain | None
    obstacles: tuple[Obstacle, ...] = ()
    folder: Path | None = None
