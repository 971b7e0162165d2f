"""Export of a system of declarations as one self-contained FMU: its plan, fused for one lane."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.export.model_description import FmiVersion, model_identifier
from uuvsim_cosim.fmus.export.system_description import Whole, component_table
from uuvsim_cosim.fmus.export.system_fmu_file import WholeFmu, compiled, sources_of
from uuvsim_cosim.kernels.codegen.declaration import declaration_text
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import Fused, fused_of
from uuvsim_cosim.kernels.system_fmu.text import system_text
from uuvsim_cosim.kernels.system_fmu.variables import Naming, description_of, exposed, placed
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["build_system_fmu"]

_PAGE = """This is a whole system of components as one. It makes whole communication steps of its
own, so that the importer's must be a whole multiple of it. Each makes the same bits as the
master. Parameters and inputs are named as in the system, with _ for a dot."""


def build_system_fmu(
    system: System,
    *,
    fmi: FmiVersion = 2,
    platforms: Sequence[str] = ("host",),
    target: Path | None = None,
    signals: Sequence[str] = (),
    inputs: Sequence[str] = (),
    naming: Naming = "flat",
    stop_time: float = 10.0,
) -> Path:
    """Build a self-contained .fmu and return its path: `target` (file or folder), or in the cache.

    `signals` and `inputs` are patterns of the outputs and inputs to show ("hull.*"), all by
    default; other inputs keep their start values. Raises SystemInvalid with every component that
    is no declaration, InputInvalid for a pattern without a match, ToolchainError.
    """
    fused = fused_of(flatten(system))
    plan = fused.plan
    variables = placed(exposed(plan, naming=naming, signals=signals, inputs=inputs), 1)
    n_before = sum(e.shown.size for e in variables if e.shown.causality != "output")
    inner = [e for e in variables if e.shown.causality != "output"]
    outputs = [e for e in variables if e.shown.causality == "output"]
    seed = Variable(
        name="seed",
        type="Int32",
        causality="parameter",
        variability="fixed",
        start=0,
        description="seed of all random numbers of the system, as `uuvsim run --seed` has it",
        initial="exact",
        value_references=(1 + n_before,),
    )
    every = [*inner, *placed(outputs, 2 + n_before)]
    description = description_of(system.name, system.description, plan, every, [seed])
    identifier = model_identifier(system.name)
    texts = _declarations(fused)
    driver = driver_text(fused, [content_hash([t]) for t in texts.values()])
    body = system_text(fused, every, seed.value_references[0])
    token = content_hash([*texts.values(), driver, body, repr(description), *sources_of()])
    whole = Whole(
        identifier, description, token, plan.tick, stop_time, states=True, needs_tool=False
    )
    main = "\n".join([driver, '#include "uuv_component.h"', component_table(whole), body])
    return compiled(
        WholeFmu(
            whole,
            {f"{identifier}.c": main, **texts},
            (content("fmus", "whole"), content("fmus", "kernels"), *runtime()),
            " ".join(_PAGE.split()),
        ),
        fmi=fmi,
        platforms=platforms,
        target=target,
    )


def _declarations(fused: Fused) -> dict[str, str]:
    """Return a file for each distinct declaration; each exports its steps by a distinct name."""
    texts = {}
    for i, source in enumerate(fused.sources):
        eq = fused.equations[source]
        text = declaration_text(eq, np.dtype(np.float64))
        name = f"declared_{i}_{model_identifier(eq.layout.model.name)}.c"
        texts[name] = f"#define uuv_the_lane_stepper uuv_the_lane_stepper_{i}\n{text}"
    return texts
