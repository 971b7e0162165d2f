"""Contents of an .fmu: description, capabilities, binaries and other members."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.check.reliance import reliance
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu

__all__ = ["Inspection", "inspect"]


@dataclass(frozen=True)
class Inspection:
    """The contents of an FMU."""

    fmu: FmuArchive
    members: Mapping[str, int]  # name in the archive -> size in bytes

    def as_dict(self) -> dict[str, Any]:
        """Return everything as numbers, texts, lists and dictionaries, ready for JSON."""
        d = self.fmu.description
        return {
            "file": str(self.fmu.path),
            "name": d.name,
            "fmi": d.kind.removeprefix("FMI "),
            "interface": self.fmu.interface,
            "interfaces": list(self.fmu.interfaces),
            "description": d.description,
            "tool": d.generation_tool,
            "token": d.token,
            "platforms": list(self.fmu.binaries),
            "step_size": d.default_step_size,
            "start_time": self.fmu.default_start_time,
            "stop_time": self.fmu.default_stop_time,
            "capabilities": {
                "state": d.can_get_and_set_state,
                "serialize": d.can_serialize_state,
                "directional_derivatives": d.provides_directional_derivatives,
                "adjoint_derivatives": self.fmu.adjoint_derivatives,
                "only_once_per_process": d.can_be_instantiated_only_once,
                "needs_tool": d.needs_execution_tool,
            },
            "a_master_may_rely_on": reliance(self.fmu),
            "variables": [
                {
                    "name": v.name,
                    "type": v.type,
                    "shape": list(v.shape),
                    "causality": v.causality,
                    "variability": v.variability,
                    "unit": v.unit_text or None,
                    "start": None if v.start is None else np.asarray(v.start).tolist(),
                    "min": v.min,
                    "max": v.max,
                    "description": v.description,
                    "dependencies": None if v.dependencies is None else list(v.dependencies),
                }
                for v in d.variables.values()
            ],
            "members": dict(self.members),
        }


def inspect(path: Path) -> Inspection:
    """Read an .fmu without loading its binary; raises FmuError if it cannot be read."""
    fmu = read_fmu(path)
    with zipfile.ZipFile(path) as archive:
        members = {m.filename: m.file_size for m in archive.infolist() if not m.is_dir()}
    return Inspection(fmu, members)
