"""A system of declarations compiled into one WebAssembly module, with the table of its variables.

The module imports nothing: no library, no clock, no file. `fmus/page/uuv_page.h` has its functions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from uuvsim_cosim.content import content
from uuvsim_cosim.errors import Problem, SystemInvalid
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.codegen.toolchain import compile_web_assembly, generated_sources
from uuvsim_cosim.kernels.system_fmu.system_fmu import SystemParts, system_parts
from uuvsim_cosim.kernels.system_fmu.variables import Exposed
from uuvsim_cosim.kernels.web_assembly.scene_size import refuse_large_scenes
from uuvsim_cosim.orchestrator.master.core_library import by_type
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.plan.plan import Plan
from uuvsim_cosim.orchestrator.plan.seeds import path_words
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["WebAssembly", "web_assembly"]

_REAL = ("Float64", "Float32")


@dataclass(frozen=True)
class WebAssembly:
    """A system's module in the cache, and the system's parts that it was compiled from."""

    module: Path
    parts: SystemParts

    @property
    def table(self) -> dict[str, Any]:
        """The variables with their places in the block, as the script of a page reads them."""
        found: dict[str, Any] = {
            "name": self.parts.whole.description.name,
            "tick": [self.parts.whole.tick.numerator, self.parts.whole.tick.denominator],
            "size": self.parts.whole.size,
            "seed": self.parts.seed,
        }
        found |= {"input": [], "parameter": [], "output": []}
        for e in self.parts.variables:
            ticks = self.parts.fused.plan.components[e.component].step_ticks
            found[e.own.causality].append(_row(e, ticks))
        return found


def web_assembly(system: System) -> WebAssembly:
    """Compile a system into a WebAssembly module.

    Raises SystemInvalid, which names every component that is no declaration and every scene that
    is too large, and ToolchainError.
    """
    refuse_large_scenes(c.source for c in flatten(system).components)
    try:
        parts = system_parts(system, naming="structured")
    except SystemInvalid as error:
        raise SystemInvalid([_elsewhere(p) for p in error.problems]) from error
    main, *declared = parts.texts
    texts = {
        main: parts.texts[main] + page_text(parts),
        **{name: parts.texts[name] for name in declared},
    }
    include = [content("fmus", folder) for folder in ("page", "whole", "kernels")]
    module = compile_web_assembly(
        generated_sources(texts), name=parts.whole.identifier, include=[*include, *runtime()]
    )
    return WebAssembly(module, parts)


def page_text(parts: SystemParts) -> str:
    """Return the C that follows a system's text in a WebAssembly module."""
    outputs = [e for e in parts.variables if e.own.causality == "output"]
    fused = parts.fused
    slots = output_slots(fused.plan)
    sequential = {i for g in fused.plan.groups if g.algorithm != "jacobi" for i in g.members}
    first = fused.plan.components[0]
    own_seed = [1, *(w % 2**32 for w in first.seed)] if "seed" in first.start else [0, 0, 0]
    tables = {
        "uint8_t is_whole": [int(e.own.type not in _REAL) for e in outputs],
        "uint8_t output_kind": [_kind(e.own.type) for e in outputs],
        "uint32_t output_member": [e.component for e in outputs],
        "uint32_t output_slot": [slots[e.component, e.own.name] for e in outputs],
        "uint8_t is_sequential": [int(i in sequential) for i in range(len(fused.members))],
        "uint32_t member_period": [max(m.rate, 0) for m in fused.members],
        "uint32_t first_path": path_words(first.path),
        "uint32_t first_seed": own_seed,  # whether the system sets it, and its words
    }
    lines = [f"enum {{ UUV_N_SUMS = {sum(e.shown.size for e in outputs)} }};"]
    for name, values in tables.items():
        lines.append(f"static const {name}[] = {{{', '.join(f'{v}u' for v in values) or '0'}}};")
    return "\n".join([*lines, '#include "uuv_page.h"', ""])


def output_slots(plan: Plan) -> dict[tuple[int, str], int]:
    """Return the master's slot of each output if all are recorded, by (component, name).

    Lost samples of a fault are drawn by slot, so that a page loses the same ones.
    """
    order = [i for group in plan.groups for i in group.members]
    described = [c.description for c in plan.components]
    slot = sum(
        v.size for i in order for v in described[i].of("input") if (i, v.name) in plan.connected
    )
    slots = {}
    for i in order:
        for v in by_type(v for v in described[i].of("output") if v.type != "Clock"):
            slots[i, v.name] = slot
            slot += v.size
    return slots


def _kind(type_: str) -> int:
    """Return how a fault rounds a value: float, Boolean, signed or unsigned integer."""
    if type_ in _REAL:
        return 0
    return 1 if type_ == "Boolean" else 3 if type_.startswith("UInt") else 2


def _elsewhere(problem: Problem) -> Problem:
    """Return a problem of fusing in the words of WebAssembly."""
    return Problem(
        problem.place,
        problem.read.replace("in a kernel", "in WebAssembly"),
        problem.expected.replace("in a kernel", "in WebAssembly"),
    )


def _row(e: Exposed, ticks: int) -> Mapping[str, Any]:
    v = e.shown
    row: dict[str, Any] = {
        "name": e.full_name, "at": e.offset, "size": v.size, "shape": list(v.shape),
        "type": v.type, "text": e.own.description,
        "units": [u or "" for u in (v.units if len(set(v.units)) > 1 else v.units[:1])],
    }  # fmt: skip
    if v.causality == "output":
        return row | {"ticks": ticks}
    row |= {
        "start": np.ravel(np.asarray(v.start, float)).tolist(),
        "min": v.min,
        "max": v.max,
        "soft": v.soft_min,
        "tunable": v.causality == "input" or v.variability == "tunable",
    }
    if v.causality == "input":
        row["free"] = list(e.free)
    return row
