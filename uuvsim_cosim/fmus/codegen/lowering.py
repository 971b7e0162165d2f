"""Lowering of a declaration to the C text of a component, which is the same for every backend."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

from uuvsim_cosim.cache import content_hash
from uuvsim_cosim.fmus.codegen.emit_c import (
    emit_function,
    emit_networks,
    emit_tables,
    emit_update,
    literal,
)
from uuvsim_cosim.fmus.codegen.equations import Equations, Layout, equations
from uuvsim_cosim.fmus.codegen.held import moves, split
from uuvsim_cosim.fmus.codegen.optimiser_code import emit_optimisers
from uuvsim_cosim.fmus.codegen.runtime import runtime_files
from uuvsim_cosim.models.declaration.interruption import interruptible
from uuvsim_cosim.models.declaration.model import Kind, Model

__all__ = [
    "Lowered",
    "lower",
]


@dataclass(frozen=True)
class Lowered:
    """The generated C of a component, and the token that identifies its contents."""

    model: Model
    equations: Equations
    source: str
    token: str

    @property
    def layout(self) -> Layout:
        """Return the layout of the block."""
        return self.equations.layout

    @property
    def files(self) -> dict[str, str]:
        """Return the generated C file by its name."""
        return {f"{self.model.name}.c": self.source}


@lru_cache
def _runtime_hash() -> str:
    return content_hash([f.read_bytes() for f in runtime_files()])


@interruptible()
def lower(model: Model) -> Lowered:
    """Lower a declaration to C; the text is a pure function of the declaration."""
    eq = equations(model)
    functions = [eq.derived, eq.initial, eq.rhs, eq.outputs, eq.forward, *eq.updates]
    at = eq.layout.offset
    data = [
        f"/* Generated from the declaration of {model.name!r}: do not edit. */\n",
        '#include "uuv_component.h"\n#include "uuv_table.h"\n\n',
        emit_tables(functions),
        emit_networks(functions),
        emit_optimisers(functions),
    ]
    outputs = emit_function(eq.outputs, "outputs(const V *b, V *out)", ("b", "out"))
    rhs = emit_function(eq.rhs, "rhs(const V *b, V *dx)", ("b", "dx"))
    step, n_held = split(rhs, moves(eq.layout), outputs=outputs)
    parts = [
        _writing(eq.derived, "derived", at["derived"]),
        _writing(eq.initial, "initial", at["state"]),
        *re.split(r"(?m)^(?=static void )", step),
        outputs,
        emit_function(
            eq.forward,
            "forward(const V *b, const V *seed, V *sensitivity)",
            ("b", "seed", "sensitivity"),
        ),
        *(
            emit_update(f, f"update_{i}(V *b, const V *draws, uuv_mask due)", at["discrete"])
            for i, f in enumerate(eq.updates)
        ),
    ]
    # The token identifies the computation; the names of places are for readers only.
    body = "\n".join([*data, *parts])
    token = content_hash([body, _tables_of(eq, "TOKEN", n_held), _runtime_hash()])
    named = "\n".join([*data, *_with_names(eq.layout, parts)])
    return Lowered(model, eq, named + _tables_of(eq, token, n_held), token)


_PLACE = re.compile(r"\bb\[(\d+)")
_STORE = re.compile(r"^(    \w+\[(\d+)\] = .*;)$", re.M)


def _with_names(layout: Layout, functions: Sequence[str]) -> Iterator[str]:
    """Write the places of the block `b` by the names of variables: ``b[v_nu + 2]``."""
    names, rows = ["v_time"], ["v_time"]
    for p in layout.placed:
        name = f"v_{re.sub('[^0-9A-Za-z_]', '_', p.variable.name)}"
        name = name if name not in names else f"{name}_at_{p.offset}"
        names += [name, *(f"{name} + {i}" for i in range(1, p.variable.size))]
        unit = p.variable.unit or ", ".join(dict.fromkeys(p.variable.units))
        rows.append(f"{name} = {p.offset}, /* {p.variable.kind} [{unit}] */")
    yield (
        "enum { /* places in the block b of an instance */\n    "
        + "\n    ".join([f"{rows[0]} = 0, /* [s] */", *rows[1:]])
        + "\n};\n"
    )
    written: dict[str, Kind] = {
        "derived": "derived", "initial": "state", "rhs": "state", "outputs": "output",
        "outputs_of_step": "output",
    }  # fmt: skip
    for text in functions:
        function = re.search(r"static void ([a-z]+(?:_of_step)?)", text)
        kind = written.get(function[1]) if function is not None else None
        if function is not None and kind is not None:
            stored = "der({})" if function[1] == "rhs" else "{}"
            first = layout.offset[kind]

            def noted(m: re.Match[str], stored: str = stored, first: int = first) -> str:
                return f"{m[1]} /* {stored.format(names[first + int(m[2])])} */"

            text = _STORE.sub(noted, text)
        yield _PLACE.sub(lambda m: f"b[{names[int(m[1])]}", text)


def _writing(f: object, name: str, offset: int) -> str:
    """Emit a function that writes a section of the block which it does not read."""
    inner = emit_function(f, f"{name}_at(const V *b, V *out)", ("b", "out"))
    return inner + f"static void {name}(V *b) {{ {name}_at(b, b + {offset}); }}\n"


def _tables_of(eq: Equations, token: str, n_held: int) -> str:
    """Return the C of a component's tables: start values, variables, clocks and offsets."""
    layout = eq.layout
    model = layout.model
    start = ["0.0"] * layout.size
    for p in layout.placed:
        if p.variable.kind in ("input", "parameter"):
            for i, value in enumerate(p.variable.start):
                start[p.offset + i] = literal(float(value))
    rows = []  # of variables, for the FMI shells
    for p in layout.placed:
        v = p.variable
        if v.kind == "derived":
            continue
        kind = {"input": "INPUT", "output": "OUTPUT", "parameter": v.variability.upper()}.get(
            v.kind, "LOCAL"
        )
        low = literal(-math.inf if v.min is None else v.min)
        high = literal(math.inf if v.max is None else v.max)
        rows.append(
            f'    {{"{v.name}", {p.offset}, {v.size}, UUV_{v.type.upper()}, UUV_{kind}, '
            f"{1 if v.shape else 0}, {int(v.soft_min)}, {low}, {high}}},"
        )
    rows += [  # a state's derivative has its references after the block
        f'    {{"der({p.variable.name})", {layout.derivative_of(p)}, {p.variable.size}, '
        f"UUV_FLOAT64, UUV_DERIVATIVE, {1 if p.variable.shape else 0}, 0, -__builtin_inf(), "
        "__builtin_inf()},"
        for p in layout.placed
        if p.variable.kind == "state"
    ]
    clocks = [
        f"    {{{c.period.numerator}u, {c.period.denominator}u, "
        f"{sum(d.numel() for d in c.draws)}, {c.index}, update_{c.index}}},"
        for c in model.clocks
    ]
    o, n = layout.offset, layout.count
    seed = layout.offset_of("seed") if "seed" in model.variables else -1
    lines = [
        f"enum {{ N_X = {n['state']}, N_HELD = {n_held}, OFF_X = {o['state']}, "
        f"OFF_Y = {o['output']} }};",
        '#include "uuv_step.h"',
        f"static const double start[] = {{{', '.join(start)}}};",
        "static const uuv_variable variables[] = {",
        '    {"time", 0, 1, UUV_FLOAT64, UUV_TIME, 0, 0, -__builtin_inf(), __builtin_inf()},',
        *rows,
        "};",
        *(["static const uuv_clock clocks[] = {", *clocks, "};"] if clocks else []),
        "const uuv_component uuv_the_component = {",
        f'    .name = "{model.name}", .token = "{token}", .n_block = {layout.size},',
        f"    .off_x = {o['state']}, .n_x = {n['state']}, .off_z = {o['discrete']}, "
        f".n_z = {n['discrete']},",
        f"    .off_y = {o['output']}, .n_y = {n['output']}, .off_u = {o['input']}, "
        f".n_u = {n['input']},",
        f"    .off_seed = {seed}, .n_clocks = {len(clocks)},",
        f"    .clocks = {'clocks' if clocks else '0'}, .h_max = {literal(model.h_max)},",
        f"    .start = start, .n_variables = {len(rows) + 1}, .variables = variables,",
        "    .n_held = N_HELD, .derived = derived, .initial = initial, .derivatives = derivatives,",
        "    .integrate = integrate, .outputs = block_outputs,",
        "    .outputs_of_step = block_outputs_of_step, .forward = forward,",
        "};",
    ]
    return "\n".join(lines) + "\n"
