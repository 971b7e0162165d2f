"""C text of a declaration in a kernel: the functions of its FMU, and its steps on lanes."""

from __future__ import annotations

import re

import numpy as np

from uuvsim_cosim.fmus.codegen.emit_c import emit_function, emit_networks, emit_update
from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.fmus.codegen.held import moves, split
from uuvsim_cosim.kernels.codegen.tables import tables_in_lanes
from uuvsim_cosim.models.declaration.interruption import interruptible

__all__ = ["declaration_text"]

_CELL = re.compile(r"\bb\[(\d+)\]")


@interruptible()
def declaration_text(eq: Equations, dtype: np.dtype) -> str:
    """Return the C of a declaration: the functions of its FMU, their table, and its steps."""
    o, n, model = eq.layout.offset, eq.layout.count, eq.layout.model
    seed = eq.layout.offset_of("seed") if "seed" in model.variables else -1
    clocks = [
        f"    {{{sum(d.numel() for d in c.draws)}, {c.index}, update_{c.index}}},"
        for c in model.clocks
    ]
    emitted = emit_function(eq.rhs, "rhs(const V *b, V *dx)", ("b", "dx"))
    outputs = emit_function(eq.outputs, "outputs(const V *b, V *out)", ("b", "out"))
    rhs, n_held = split(
        emitted,
        moves(eq.layout),
        invert=dtype == np.float32,
        outputs=outputs,
    )
    derived = emit_function(eq.derived, "derived(const V *b, V *out)", ("b", "out"))
    seeds = {seed, seed + 1} if seed >= 0 else set()
    is_seeded = bool(seeds.intersection(int(i) for i in _CELL.findall(derived)))
    table = [
        *(["static const uuv_lane_clock clocks[] = {", *clocks, "};"] if clocks else []),
        "static const uuv_lane_component the_component = {",
        f"    .n_block = {eq.layout.size}, .off_parameters = {o['parameter']},",
        f"    .off_derived = {o['derived']}, .off_x = {o['state']},",
        f"    .n_x = {n['state']}, .n_z = {n['discrete']}, .off_y = {o['output']},",
        f"    .n_clocks = {len(clocks)}, .off_seed = {seed}, .n_held = {n_held},",
        f"    .is_seeded = {int(is_seeded)},",
        f"    .clocks = {'clocks' if clocks else '0'},",
        "    .derived = derived, .initial = initial, .held = held, .rhs = rhs,",
        "    .outputs = outputs, .outputs_of_step = outputs_of_step,",
        "};",
        '#include "uuv_lane_stepper.h"',
    ]
    stepped = [
        _with_parameters(rhs),
        _with_parameters(outputs),
        *(
            emit_update(
                f, f"update_{i}(V *b, const V *p, const V *draws, uuv_mask due)", o["discrete"]
            )
            for i, f in enumerate(eq.updates)
        ),
    ]
    if not is_seeded:
        shared = {*range(o["parameter"], o["state"])} - seeds
        stepped = [
            _CELL.sub(lambda m: f"p[{m[1]}]" if int(m[1]) in shared else m[0], text)
            for text in stepped
        ]
    parts = [
        derived,
        emit_function(eq.initial, "initial(const V *b, V *out)", ("b", "out")),
        *stepped,
        "\n".join(table),
    ]
    tables, body = tables_in_lanes("\n".join(parts) + "\n", dtype)
    head = [
        f"/* Generated from the declaration of {model.name!r}: do not edit. */",
        '#include "uuv_lane_component.h"',
        '#include "uuv_lane_lines.h"',
        '#include "uuv_lane_record.h"',
        "",
        tables,
        emit_networks([eq.derived, eq.initial, eq.rhs, eq.outputs, *eq.updates]),
    ]
    return "\n".join(head) + body


def _with_parameters(text: str) -> str:
    """Return functions of a block ``b`` with a further argument: the block ``p`` of parameters."""
    text = text.replace("(const V *b, ", "(const V *b, const V *p, ")
    return text.replace("    (void)b;\n", "    (void)b;\n    (void)p;\n")
