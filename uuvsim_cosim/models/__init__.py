"""Models: declarations of components in CasADi, in Fossen's notation.

Hulls, actuators, sensors, control, guidance, navigation, water and worlds have a folder each; how a
component is declared is in `declaration/`. The numbers lie in the folder ``models/`` at the top. It
imports no other package of the project. Start with `declaration/model.py`, then `hull/vehicle.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.models.analysis.simulate import simulate
    from uuvsim_cosim.models.control.lqr import design_lqr
    from uuvsim_cosim.models.declaration.library import declare
    from uuvsim_cosim.models.declaration.model import Model
    from uuvsim_cosim.models.declaration.safe_math import abs_, saturate
    from uuvsim_cosim.models.sensors.allan import allan_deviation, allan_of_error
    from uuvsim_cosim.models.sensors.multibeam_and_camera import beams_of
    from uuvsim_cosim.models.vehicles.outline import write_outlines
    from uuvsim_cosim.models.worlds.terrain import Terrain

__all__ = [
    "Model",
    "Terrain",
    "abs_",
    "allan_deviation",
    "allan_of_error",
    "beams_of",
    "declare",
    "design_lqr",
    "saturate",
    "simulate",
    "write_outlines",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Model": "declaration.model",
        "Terrain": "worlds.terrain",
        "abs_": "declaration.safe_math",
        "allan_deviation": "sensors.allan",
        "allan_of_error": "sensors.allan",
        "beams_of": "sensors.multibeam_and_camera",
        "declare": "declaration.library",
        "design_lqr": "control.lqr",
        "saturate": "declaration.safe_math",
        "simulate": "analysis.simulate",
        "write_outlines": "vehicles.outline",
    },
)
