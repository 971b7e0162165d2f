"""Export of a system of declarations as one self-contained FMU: its plan, fused for one lane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.content import content
from uuvsim_cosim.fmus.codegen.runtime import runtime
from uuvsim_cosim.fmus.description import Variable
from uuvsim_cosim.fmus.export.model_description import FmiVersion, model_identifier
from uuvsim_cosim.fmus.export.system_fmu_file import (
    Whole,
    WholeFmu,
    compiled,
    component_table,
    sources_of,
)
from uuvsim_cosim.kernels.codegen.driver import driver_text
from uuvsim_cosim.kernels.codegen.fusible import Fused, fused_of
from uuvsim_cosim.kernels.codegen.outline import written
from uuvsim_cosim.kernels.system_fmu.variables import (
    Exposed,
    Naming,
    description_of,
    exposed,
    placed,
)
from uuvsim_cosim.orchestrator.plan.flatten import flatten
from uuvsim_cosim.orchestrator.system.system import System

__all__ = ["SystemParts", "build_system_fmu", "system_parts", "system_text"]

_PAGE = """This FMU contains a whole system of components. It makes whole communication steps of its
own, so the importer's step must be a whole multiple of them. Each step gives the same bits as the
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
    parts = system_parts(system, naming=naming, signals=signals, inputs=inputs, stop_time=stop_time)
    return compiled(
        WholeFmu(
            parts.whole,
            parts.texts,
            (content("fmus", "whole"), content("fmus", "kernels"), *runtime()),
            " ".join(_PAGE.split()),
        ),
        fmi=fmi,
        platforms=platforms,
        target=target,
    )


@dataclass(frozen=True)
class SystemParts:
    """A system of declarations as one component: variables by their place, and its C files."""

    fused: Fused
    variables: tuple[Exposed, ...]
    seed: int  # place of the system's seed in the block
    whole: Whole
    texts: Mapping[str, str]  # by file; the first one has the driver and the block


def system_parts(
    system: System,
    *,
    signals: Sequence[str] = (),
    inputs: Sequence[str] = (),
    naming: Naming = "flat",
    stop_time: float = 10.0,
) -> SystemParts:
    """Write the C of a system as one component; arguments and errors of `build_system_fmu`."""
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
        description="seed of all random numbers of the system, as in `uuvsim run --seed`",
        initial="exact",
        value_references=(1 + n_before,),
    )
    every = [*inner, *placed(outputs, 2 + n_before)]
    description = description_of(system.name, system.description, plan, every, [seed])
    identifier = model_identifier(system.name)
    texts = {}  # a file for each distinct declaration, whose steps have a distinct name
    for i, (source, outline) in enumerate(fused.declarations.values()):
        text = written(source, outline, np.dtype(np.float64)).file.read_text()
        name = f"declared_{i}_{model_identifier(outline.name)}.c"
        texts[name] = f"#define uuv_the_lane_stepper uuv_the_lane_stepper_{i}\n{text}"
    driver = driver_text(fused, [content_hash([t]) for t in texts.values()])
    body = system_text(fused, every, seed.value_references[0])
    token = content_hash([*texts.values(), driver, body, repr(description), *sources_of()])
    whole = Whole(
        identifier, description, token, plan.tick, stop_time, states=True, needs_tool=False
    )
    main = "\n".join([driver, '#include "uuv_component.h"', component_table(whole), body])
    return SystemParts(
        fused, tuple(every), seed.value_references[0], whole, {f"{identifier}.c": main, **texts}
    )


def system_text(fused: Fused, variables: Sequence[Exposed], seed: int) -> str:
    """Return the C that follows the driver: tables, binding of the declarations, and the runtime.

    `seed` is the place of the system's seed in the block.
    """
    inputs: list[str] = []
    parameters: list[str] = []
    outputs: list[str] = []
    for e in variables:
        m = fused.members[e.component]
        at = m.layout.offset_of(e.own.name)
        cell, start = m.cell + at, m.start_cell + at
        if e.own.causality == "input":
            inputs += [f"{e.offset + k}, {start + k}, {cell + k}" for k in e.free]
        elif e.own.causality == "parameter":
            tunable = int(e.own.variability == "tunable")
            parameters.append(
                f"{e.offset}, {e.own.size}, {start}, {cell}, {e.component}, {tunable}"
            )
        elif e.own.causality == "output":
            outputs.append(f"{e.offset}, {cell}, {e.own.size}")
    names: list[str] = []  # for messages; pending outputs follow a component's values
    start_values = np.zeros(fused.n_start)  # of the plan, else of the declarations
    for c, m in zip(fused.plan.components, fused.members, strict=True):
        for v in m.layout.values:
            names.append(f'{m.cell + v.offset}, {int(bool(v.shape))}, "{m.path}.{v.name}"')
            if v.kind in ("input", "parameter"):
                value = c.start.get(v.name, v.start)
                at = m.start_cell + v.offset
                start_values[at : at + v.size] = np.ravel(np.asarray(value, float))
        if m.rate >= 0:
            names.append(f'{m.pending}, 0, "an output of {m.path}"')
    lines = ["#define UUV_WHOLE", '#include "shell_hooks.h"', f"enum {{ SEED = {seed} }};"]
    for name, count, fields, rows in (
        ("free_inputs", "N_FREE", "uint32_t b, start, cell;", inputs),
        (
            "parameters",
            "N_PARAMETERS",
            "uint32_t b, size, start, cell, member, tunable;",
            parameters,
        ),
        ("shown_outputs", "N_SHOWN", "uint32_t b, cell, size;", outputs),
        ("cell_names", "N_NAMES", "uint32_t cell, array; const char *name;", names),
    ):
        written = [f"    {{{row}}}," for row in rows]
        lines.append(f"enum {{ {count} = {len(written)} }};")
        lines.append(f"static const struct {{ {fields} }} {name}[] = {{")
        lines += [*(written or ["    {0},"]), "};"]
    numbers = ", ".join(float(x).hex() for x in start_values) or "0"
    lines.append(f"static const double cell_start[] = {{{numbers}}};")
    n = len(fused.sources)
    lines += [f"extern const uuv_lane_stepper uuv_the_lane_stepper_{i};" for i in range(n)]
    lines.append("/* before anybody can instantiate */")
    lines.append("__attribute__((constructor)) static void bind_declarations(void) {")
    lines += [f"    uuv_kernel_bind({i}, &uuv_the_lane_stepper_{i});" for i in range(n)]
    lines += ["}", '#include "uuv_system.h"', ""]
    return "\n".join(lines)
