"""C tables that map an FMU's block of values to the cells of a fused system."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.kernels.system_fmu.variables import Exposed

__all__ = ["system_text"]


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
        ("cell_names", "N_NAMES", "uint32_t cell, array; const char *name;", _cell_names(fused)),
    ):
        written = [f"    {{{row}}}," for row in rows]
        lines.append(f"enum {{ {count} = {len(written)} }};")
        lines.append(f"static const struct {{ {fields} }} {name}[] = {{")
        lines += [*(written or ["    {0},"]), "};"]
    numbers = ", ".join(float(x).hex() for x in _start(fused)) or "0"
    lines.append(f"static const double cell_start[] = {{{numbers}}};")
    n = len(fused.sources)
    lines += [f"extern const uuv_lane_stepper uuv_the_lane_stepper_{i};" for i in range(n)]
    lines.append("/* before anybody can instantiate */")
    lines.append("__attribute__((constructor)) static void bind_declarations(void) {")
    lines += [f"    uuv_kernel_bind({i}, &uuv_the_lane_stepper_{i});" for i in range(n)]
    lines += ["}", '#include "uuv_system.h"', ""]
    return "\n".join(lines)


def _cell_names(fused: Fused) -> Iterator[str]:
    """Yield the names of the cells, for messages; pending outputs follow a component's values."""
    for m in fused.members:
        for p in m.layout.placed:
            array = int(bool(p.variable.shape))
            yield f'{m.cell + p.offset}, {array}, "{m.path}.{p.variable.name}"'
        if m.rate >= 0:
            yield f'{m.pending}, 0, "an output of {m.path}"'


def _start(fused: Fused) -> np.ndarray:
    """Return the start values of all components: those of the plan, else of the declarations."""
    start = np.zeros(fused.n_start)
    for c, m in zip(fused.plan.components, fused.members, strict=True):
        for p in m.layout.placed:
            v = p.variable
            if v.kind in ("input", "parameter"):
                value = c.start.get(v.name, v.start)
                at = m.start_cell + p.offset
                start[at : at + v.size] = np.ravel(np.asarray(value, float))
    return start
