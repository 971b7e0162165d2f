"""Scenes: terrain from charts and surveyed grids, and maps of the seabed from runs.

It may import `orchestrator`, `fmus`, `models`; GDAL and others come with the extra `scene`. Start
with `terrain/make.py`, `chart/read.py`, `mapping/survey.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.scene.mapping.mapping import read_map
    from uuvsim_cosim.scene.shared.ray_casting import SEABED, Caster

__all__ = ["SEABED", "Caster", "read_map"]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Caster": "shared.ray_casting",
        "SEABED": "shared.ray_casting",
        "read_map": "mapping.mapping",
    },
)
