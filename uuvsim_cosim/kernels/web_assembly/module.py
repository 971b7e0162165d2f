"""A system of declarations compiled into one WebAssembly module, with the table of its variables.

The module imports nothing: no library, no clock, no file. `fmus/page/uuv_page.h` has its functions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
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
            found[e.own.causality].append(_row(e))
        return found


def web_assembly(system: System) -> WebAssembly:
    """Compile a system into a WebAssembly module.

    Raises SystemInvalid, which names every component that is no declaration, and ToolchainError.
    """
    try:
        parts = system_parts(system, naming="structured")
    except SystemInvalid as error:
        raise SystemInvalid([_elsewhere(p) for p in error.problems]) from error
    main, *declared = parts.texts
    texts = {
        main: parts.texts[main] + page_text(parts.variables),
        **{name: parts.texts[name] for name in declared},
    }
    include = [content("fmus", folder) for folder in ("page", "whole", "kernels")]
    module = compile_web_assembly(
        generated_sources(texts), name=parts.whole.identifier, include=[*include, *runtime()]
    )
    return WebAssembly(module, parts)


def page_text(variables: Iterable[Exposed]) -> str:
    """Return the C that follows a system's text in a WebAssembly module."""
    outputs = [e for e in variables if e.own.causality == "output"]
    whole = ", ".join(str(int(e.own.type not in _REAL)) for e in outputs) or "0"
    return (
        f"enum {{ UUV_N_SUMS = {sum(e.shown.size for e in outputs)} }};\n"
        f"static const uint8_t is_whole[] = {{{whole}}};\n"
        '#include "uuv_page.h"\n'
    )


def _elsewhere(problem: Problem) -> Problem:
    """Return a problem of fusing in the words of WebAssembly."""
    return Problem(
        problem.place,
        problem.read.replace("in a kernel", "in WebAssembly"),
        problem.expected.replace("in a kernel", "in WebAssembly"),
    )


def _row(e: Exposed) -> Mapping[str, Any]:
    v = e.shown
    row: dict[str, Any] = {
        "name": e.full_name, "at": e.offset, "size": v.size, "shape": list(v.shape),
        "type": v.type, "text": e.own.description,
        "units": [u or "" for u in (v.units if len(set(v.units)) > 1 else v.units[:1])],
    }  # fmt: skip
    if v.causality == "output":
        return row
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
