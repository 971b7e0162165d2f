"""Contents of an .fmu: description, capabilities, binaries and other members."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.fmus.codegen.toolchain import host
from uuvsim_cosim.fmus.importer.read_description import FmuArchive, read_fmu
from uuvsim_cosim.fmus.sandbox.sandbox import only_web_assembly

__all__ = ["Inspection", "inspect", "reliance"]


def reliance(fmu: FmuArchive) -> dict[str, str]:
    """Return by topic the features that an FMU declares, and how a master manages without them."""
    d = fmu.description
    state, once = d.can_get_and_set_state, d.can_be_instantiated_only_once
    machine = host()
    here = {machine.fmi2, machine.fmi3} & set(fmu.binaries)
    undeclared = [v.name for v in d.of("output") if v.dependencies is None]
    more = f" and {len(undeclared) - 3} more" if len(undeclared) > 3 else ""
    return {
        "run": "yes" if here
        else "yes, its sources are compiled at first use" if fmu.sources
        else "yes, as WebAssembly, by the extra 'sandbox'" if only_web_assembly(fmu)
        else f"no: it has no binary for {machine.fmi2}",
        "reset": "restores its state of Initialization Mode" if state
        else "frees the instance, then makes another; nothing is unpacked or loaded again" if once
        else "takes a fresh instance from a pool; nothing is unpacked or loaded again",
        "snapshot": "no: the master refuses, because it cannot copy its state" if not state
        else "in memory and in files" if d.can_serialize_state
        else "in memory; not in files, because it cannot serialize its state",
        "iterated groups": "possible" if state
        else "no: refused, because a step cannot be repeated; an algebraic loop through it is "
        "refused as well",
        "loops in initialization": "solved with its directional derivatives"
        if d.provides_directional_derivatives else "solved with finite differences",
        "feedthrough": "declared for every output" if not undeclared
        else f"not declared for {', '.join(undeclared[:3])}{more}: assumed absent in stepping, "
        "where a loop through it is delayed and reported, and present in initialization",
        "instances": "one per process; each further one runs in a separate process" if once
        else "any number per process",
    }  # fmt: skip


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
