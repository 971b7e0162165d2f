"""The C tables that lead from an FMU's block of values to the cells of a fused system."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.kernels.system_fmu.variables import Exposed

__all__ = ["system_text"]


def system_text(fused: Fused, variables: Sequence[Exposed], seed: int) -> str:
    """Return the C behind the driver: tables, the binding of the declarations, and the runtime.

    `seed` is the place of the system's seed in the block.
    """
    lines = ["#define UUV_WHOLE", '#include "shell_hooks.h"', f"enum {{ SEED = {seed} }};"]
    for name, count, fields, rows in (
        ("free_inputs", "N_FREE", "uint32_t b, start, cell;", _inputs(fused, variables)),
        (
            "parameters",
            "N_PARAMETERS",
            "uint32_t b, size, start, cell, member, tunable;",
            _parameters(fused, variables),
        ),
        ("shown_outputs", "N_SHOWN", "uint32_t b, cell, size;", _outputs(fused, variables)),
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


def _places(fused: Fused, e: Exposed) -> tuple[int, int]:
    """Return the first cell, and the first start cell, of a variable."""
    m = fused.members[e.component]
    at = m.layout.offset_of(e.own.name)
    return m.cell + at, m.start_cell + at


def _inputs(fused: Fused, variables: Sequence[Exposed]) -> Iterator[str]:
    for e in variables:
        if e.own.causality == "input":
            cell, start = _places(fused, e)
            for k in e.free:
                yield f"{e.offset + k}, {start + k}, {cell + k}"


def _parameters(fused: Fused, variables: Sequence[Exposed]) -> Iterator[str]:
    for e in variables:
        if e.own.causality == "parameter":
            cell, start = _places(fused, e)
            tunable = int(e.own.variability == "tunable")
            yield f"{e.offset}, {e.own.size}, {start}, {cell}, {e.component}, {tunable}"


def _outputs(fused: Fused, variables: Sequence[Exposed]) -> Iterator[str]:
    for e in variables:
        if e.own.causality == "output":
            yield f"{e.offset}, {_places(fused, e)[0]}, {e.own.size}"


def _cell_names(fused: Fused) -> Iterator[str]:
    """Name the cells, for messages; outputs that are not visible yet lie behind a component's."""
    for m in fused.members:
        for p in m.layout.placed:
            array = int(bool(p.variable.shape))
            yield f'{m.cell + p.offset}, {array}, "{m.path}.{p.variable.name}"'
        if m.rate >= 0:
            yield f'{m.pending}, 0, "an output of {m.path}"'


def _start(fused: Fused) -> np.ndarray:
    """Return the start values of all components: of the declarations, and of the plan."""
    start = np.zeros(fused.n_start)
    for c, m in zip(fused.plan.components, fused.members, strict=True):
        for p in m.layout.placed:
            v = p.variable
            if v.kind in ("input", "parameter"):
                value = c.start.get(v.name, v.start)
                at = m.start_cell + p.offset
                start[at : at + v.size] = np.ravel(np.asarray(value, float))
    return start
