"""C text of a declaration's tangents or adjoints on lanes; CasADi derives them."""

from __future__ import annotations

from typing import Any, Literal

import casadi as ca
import numpy as np

from uuvsim_cosim.fmus.codegen.emit_c import emit_function, emit_networks
from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.kernels.codegen.tables import tables_in_lanes

__all__ = ["Mode", "derivative_text"]

Mode = Literal["tangent", "adjoint"]
_LARGE = 5000  # operations; the search for branches in 40,000 takes two minutes
_FLOAT64 = np.dtype(np.float64)


def derivative_text(eq: Equations, mode: Mode) -> str:
    """Return the C of a declaration: its functions and their tangents, or adjoints; their steps.

    Derivatives are with respect to all values of the block except time; draws are constants.
    """
    o, n, model = eq.layout.offset, eq.layout.count, eq.layout.model
    seed = eq.layout.offset_of("seed") if "seed" in model.variables else 0
    draws = [sum(int(d.numel()) for d in c.draws) for c in model.clocks]
    names = ("derived", "initial", "rhs", "outputs")
    parts = []
    for name in names:
        f = getattr(eq, name)
        parts += [
            emit_function(f, f"{name}(const V *b, V *out)", ("b", "out")),
            _derivative(eq, f, name, mode),
        ]
    for i, f in enumerate(eq.updates):
        name = f"update_{i}"
        signature = f"{name}(const V *b, const V *draws, V *z_new)"
        parts += [
            emit_function(f, signature, ("b", "draws", "z_new")),
            _derivative(eq, f, name, mode),
        ]
    given = {"tangent": ("{0}", "0"), "adjoint": ("0", "{0}")}[mode]
    rows = [
        f"    {{{k}, {c.index}, update_{i}, "
        + ", ".join(g.format(f"update_{i}_{mode}") for g in given)
        + "},"
        for i, (c, k) in enumerate(zip(model.clocks, draws, strict=True))
    ]
    table = [
        f"enum {{ D_X = {n['state']}, D_Z = {n['discrete']}, D_Y = {n['output']}, "
        f"D_DRAWS = {max(draws, default=0)}, D_CLOCKS = {len(draws)},",
        f"       D_FIRST_X = {o['state']}, D_FIRST_Z = {o['discrete']}, "
        f"D_FIRST_Y = {o['output']}, D_SEED = {seed} }};",
        "static const uuv_lane_derivative_clock clocks[] = {",
        *(rows or ["    {0, 0, 0, 0, 0},"]),
        "};",
        '#include "uuv_lane_derivative_steps.h"',
        "UUV_KERNEL_API const uuv_lane_derivative uuv_the_lane_derivative = {",
        f"    .off_derived = {o['derived']}, .n_derived = {n['derived']},",
        "    .off_x = D_FIRST_X, .n_x = D_X, .off_z = D_FIRST_Z, .n_z = D_Z,",
        "    .off_y = D_FIRST_Y, .n_y = D_Y,",
        "    .derived = derived, .initial = initial, .outputs = outputs,",
        *(f"    .{f}_{mode} = {f}_{mode}," for f in ("derived", "initial", "outputs")),
        f"    .step = derivative_step, .step_{mode} = derivative_step_{mode},",
        "};",
        "",
    ]
    tables, body = tables_in_lanes("\n".join([*parts, *table]), _FLOAT64)
    head = [
        f"/* Generated from the declaration of {model.name!r}: do not edit. */",
        *(["#define UUV_TANGENT"] if mode == "tangent" else []),
        '#include "uuv_lane_derivative.h"',
        '#include "uuv_lane_lines.h"',
        '#include "uuv_lane_record.h"',
        "",
        tables,
        emit_networks([eq.derived, eq.initial, eq.rhs, eq.outputs, *eq.updates]),
    ]
    return "\n".join(head) + body


def _derivative(eq: Equations, f: Any, name: str, mode: Mode) -> str:
    """Return ``name_tangent(b, d, out)`` or ``name_adjoint(b, seed, a)``; updates take draws."""
    b = eq.layout.block
    more = [ca.SX.sym("draws", f.size1_in(1))] if f.n_in() == 2 else []
    value = f(b, *more)
    takes = "const V *b, const V *draws" if more else "const V *b"
    arrays = ("b", "draws") if more else ("b",)
    rest = b[1:]  # all but time
    if mode == "tangent":
        d = ca.SX.sym("d", b.numel())
        moved = ca.jtimes(value, rest, d[1:]) if value.numel() and rest.numel() else value * 0
        g = _function(f"{name}_tangent", [b, *more, d], moved)
        return _emitted(g, f"{name}_tangent({takes}, const V *d, V *out)", (*arrays, "d", "out"))
    seed = ca.SX.sym("seed", value.numel())
    cells = sorted({c for c in f.jac_sparsity(0, 0).get_triplet()[1] if c > 0})
    gradient = ca.SX(0, 1)
    if cells:
        gradient = ca.jtimes(value, rest, seed, True)[[c - 1 for c in cells]]
    g = _function(f"{name}_gradient", [b, *more, seed], gradient)
    lines = "".join(f"    a[{c}] += out[{i}];\n" for i, c in enumerate(cells))
    inside = ", ".join((*arrays, "seed", "out"))
    signature = f"{name}_gradient({takes}, const V *seed, V *out)"
    return _emitted(g, signature, (*arrays, "seed", "out")) + (
        f"static void {name}_adjoint({takes}, const V *seed, V *a) {{\n"
        f"    V out[{len(cells) + 1}];\n    {name}_gradient({inside});\n    (void)a;\n{lines}}}\n"
    )


def _emitted(g: Any, signature: str, arrays: tuple[str, ...]) -> str:
    return emit_function(g, signature, arrays, branches=g.n_instructions() < _LARGE)


def _function(name: str, arguments: list[Any], value: Any) -> Any:
    return ca.Function(name, arguments, [ca.densify(value)], {"cse": True})
