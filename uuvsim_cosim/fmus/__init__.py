"""FMI 2.0 and 3.0: export of a declaration as an FMU; import of an FMU (also 1.0) as a component.

Export is in `codegen/` and `export/`, import in `importer/`, `model_exchange/` and `isolation/`.
The C around the equations is in the folder ``fmus/`` at the top. It may import `models` only.
Start with `component.py` and `description.py`, then `export/fmu_file.py`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from uuvsim_cosim.lazy import lazy

if TYPE_CHECKING:
    from uuvsim_cosim.fmus.check.simulate_fmu import simulate_fmu
    from uuvsim_cosim.fmus.codegen.native import Native
    from uuvsim_cosim.fmus.export.component_folder import write_all
    from uuvsim_cosim.fmus.export.fmu_file import build_fmu
    from uuvsim_cosim.fmus.importer.read_description import read_description
    from uuvsim_cosim.fmus.instantiation.instantiate import instantiate_fmu

__all__ = [
    "Native",
    "build_fmu",
    "instantiate_fmu",
    "read_description",
    "simulate_fmu",
    "write_all",
]

__getattr__, __dir__ = lazy(
    __name__,
    {
        "Native": "codegen.native",
        "build_fmu": "export.fmu_file",
        "instantiate_fmu": "instantiation.instantiate",
        "read_description": "importer.read_description",
        "simulate_fmu": "check.simulate_fmu",
        "write_all": "export.component_folder",
    },
)
