"""Packing: a system's declarations become FMUs inside one .ssp that other tools run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.orchestrator.elements import Connection, Element
from uuvsim_cosim.orchestrator.seeds import component_seed
from uuvsim_cosim.orchestrator.sources import FmuSource, ModelSource, resolve
from uuvsim_cosim.orchestrator.ssd import format_ssd
from uuvsim_cosim.orchestrator.ssp import write_archive
from uuvsim_cosim.orchestrator.ssp_xml import SspVersion
from uuvsim_cosim.orchestrator.system import System

__all__ = ["pack"]


def pack(
    system: System,
    path: Path,
    fmi: Literal[2, 3] = 2,
    seed: int = 0,
    platforms: Sequence[str] = ("host",),
) -> None:
    """Write a system as .ssp with all its FMUs inside: FMI 2 and SSP 1.0, or FMI 3 and SSP 2.0.

    Each component's seed is written as a value, so that other tools draw the same numbers.
    Raises SystemInvalid for components that are neither declarations nor FMUs.
    """
    packing = _Packing(fmi, seed, tuple(platforms))
    packed = packing.packed(system, "")
    if packing.problems:
        raise SystemInvalid(packing.problems)
    version: SspVersion = "1.0" if fmi == 2 else "2.0"
    root = Path()
    members = {f"resources/{name}": file.read_bytes() for name, file in packing.files.items()}
    members["SystemStructure.ssd"] = format_ssd(packed, version, root)
    write_archive(members, path)
