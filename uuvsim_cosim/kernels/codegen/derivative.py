"""C text of tangents or adjoints: of declarations (CasADi derives them), and of the driver."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, Literal

import casadi as ca
import numpy as np

from uuvsim_cosim.fmus.codegen.emit_c import emit_function, emit_networks, literal
from uuvsim_cosim.fmus.codegen.equations import Equations
from uuvsim_cosim.kernels.codegen.driver import copies, initialization
from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.kernels.codegen.tables import tables_in_lanes
from uuvsim_cosim.models.declaration.interruption import interruptible
from uuvsim_cosim.orchestrator.plan.plan import Transfer

__all__ = ["Mode", "derivative_driver_text", "derivative_text", "tape_cells"]

Mode = Literal["tangent", "adjoint"]
_LARGE = 5000  # operations; the search for branches in 40,000 takes two minutes
_FLOAT64 = np.dtype(np.float64)


@interruptible()
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


def tape_cells(fused: Fused) -> int:
    """Return the cells of the work space that a block of lanes needs."""
    evaluated = [fused.members[i] for i in initialization(fused) if isinstance(i, int)]
    end = fused.n_cells + sum(m.layout.offset["output"] for m in evaluated)
    return max(end, 2 * fused.n_cells)


def derivative_driver_text(fused: Fused, mode: Mode, tokens: Sequence[str]) -> str:
    """Return the C that steps and initializes tangents, or adjoints, of a block of lanes."""
    tick = fused.plan.tick
    named = zip(fused.sources, tokens, strict=True)
    body = _tangent_driver(fused) if mode == "tangent" else _adjoint_driver(fused)
    periods = (", ".join(map(str, m.periods)) or "0" for m in fused.members)
    return "\n".join(
        [
            f"/* Generated from a plan: do not edit. Its {mode}s call",
            *(f" * {i}: {name} {token}" for i, (name, token) in enumerate(named)),
            " */",
            *(["#define UUV_TANGENT"] if mode == "tangent" else []),
            '#include "uuv_lane_derivative.h"',
            "",
            f"enum {{ N_CELLS = {fused.n_cells}, N_START = {fused.n_start}, "
            f"N_PERIODS = {len(fused.periods)}, N_WORD_CELLS = {fused.members[0].cell},",
            f"       N_TAPE = {tape_cells(fused)} }};",
            f"static const uint64_t tick_num = {tick.numerator}u, tick_den = {tick.denominator}u;",
            f"static const uuv_lane_derivative *declared[{len(fused.sources)}];",
            *(f"static const uint8_t periods_{i}[] = {{{p}}};" for i, p in enumerate(periods)),
            "",
            "UUV_KERNEL_API void uuv_derivative_bind(uint32_t i, const uuv_lane_derivative *d) {",
            "    declared[i] = d;",
            "}",
            "",
            *body,
            '#include "uuv_lane_derivative_blocks.h"',
            "",
        ]
    )


def _tangent_driver(fused: Fused) -> Iterator[str]:
    yield "/* m and its perturbation d make one step. */"
    yield "static void step_tangent(V *m, V *d) {"
    yield "    const uuv_lane_time now = lane_time(m, 0, 1, tick_num, tick_den);"
    plan = fused.plan
    late = [t for t in plan.transfers if not fused.is_early(t)]
    yield from copies(fused, late, stepping=True)
    yield from _pushed(fused, late)
    for i in fused.order:
        early = fused.early_into(i)
        yield from copies(fused, early, stepping=True)
        yield from _pushed(fused, early)
        m = fused.members[i]
        yield f"    /* {m.path} */"
        yield (
            f"    declared[{m.declaration}]->step_tangent(m, m + {m.cell}, d + {m.cell}, "
            f"{m.cuts[0].pieces}, periods_{i}, N_PERIODS, &now);"
        )
    yield "}"
    yield ""
    yield "static void initialize_tangent(V *m, const V *start, V *d, const V *d_start) {"
    yield "    memset(m, 0, N_WORD_CELLS * sizeof(V));"
    yield "    memset(d, 0, N_CELLS * sizeof(V));"
    for m in fused.members:
        yield f"    memcpy(m + {m.cell}, start + {m.start_cell}, {m.n_start} * sizeof(V));"
        yield f"    memcpy(d + {m.cell}, d_start + {m.start_cell}, {m.n_start} * sizeof(V));"
        yield (f"    derivative_initialize(declared[{m.declaration}], m + {m.cell}, d + {m.cell});")
    for operation in initialization(fused):
        if isinstance(operation, int):
            m = fused.members[operation]
            yield (
                f"    derivative_outputs(declared[{m.declaration}], m + {m.cell}, d + {m.cell});"
            )
        else:
            yield from copies(fused, operation)
            yield from _pushed(fused, operation)
    yield "}"
    yield ""


def _adjoint_driver(fused: Fused) -> Iterator[str]:
    plan = fused.plan
    late = [t for t in plan.transfers if not fused.is_early(t)]
    early = {i: fused.early_into(i) for i in fused.order}
    read_early = {t.source for transfers in early.values() for t in transfers}
    yield "/* From m before a step, which is overwritten: the gradient a goes back over it. */"
    yield "static void step_adjoint(V *m, V *kept, V *a) {"
    yield "    const uuv_lane_time now = lane_time(m, 0, 1, tick_num, tick_den);"
    yield "    (void)kept;"
    yield from copies(fused, late, stepping=True)
    for i in fused.order:
        m = fused.members[i]
        yield from copies(fused, early[i], stepping=True)
        if i in read_early:
            yield f"    memcpy(kept + {m.cell}, m + {m.cell}, {m.size} * sizeof(V));"
            yield (
                f"    declared[{m.declaration}]->step(m, m + {m.cell}, {m.cuts[0].pieces}, "
                f"periods_{i}, N_PERIODS, &now);"
            )
    for i in reversed(fused.order):
        m = fused.members[i]
        place = "kept" if i in read_early else "m"
        yield f"    /* {m.path} */"
        yield (
            f"    declared[{m.declaration}]->step_adjoint(m, {place} + {m.cell}, a + {m.cell}, "
            f"{m.cuts[0].pieces}, periods_{i}, N_PERIODS, &now);"
        )
        yield from _pulled(fused, early[i])
    yield from _pulled(fused, late)
    yield "}"
    yield ""
    yield "/* The gradient a of the initialized block is added to that of the start values. */"
    yield "static void initialize_adjoint(V *m, const V *start, V *a, V *a_start, V *kept) {"
    yield "    V seed[N_CELLS];"
    yield "    (void)kept;"
    yield "    memset(m, 0, N_WORD_CELLS * sizeof(V));"
    for m in fused.members:
        yield f"    memcpy(m + {m.cell}, start + {m.start_cell}, {m.n_start} * sizeof(V));"
        yield f"    derivative_initialize(declared[{m.declaration}], m + {m.cell}, NULL);"
    at = 0  # of the blocks that are kept before their outputs are evaluated
    operations = initialization(fused)
    for operation in operations:
        if isinstance(operation, int):
            m = fused.members[operation]
            yield f"    memcpy(kept + {at}, m + {m.cell}, {m.layout.offset['output']} * sizeof(V));"
            yield f"    derivative_outputs(declared[{m.declaration}], m + {m.cell}, NULL);"
            at += m.layout.offset["output"]
        else:
            yield from copies(fused, operation)
    for operation in reversed(operations):
        if isinstance(operation, int):
            m = fused.members[operation]
            o, n = m.layout.offset["output"], m.layout.count["output"]
            at -= o
            yield from _pull_back("outputs", m.declaration, f"kept + {at}", m.cell, o, n)
        else:
            yield from _pulled(fused, operation)
    for m in fused.members:
        first, count = m.layout.offset, m.layout.count
        own, i = f"m + {m.cell}", m.declaration
        states = count["state"] + count["discrete"]
        yield from _pull_back("initial", i, own, m.cell, first["state"], states)
        yield from _pull_back("derived", i, own, m.cell, first["derived"], count["derived"])
        yield f"    for (uint32_t i = 0; i < {m.n_start}; i++)"
        yield f"        a_start[{m.start_cell} + i] += a[{m.cell} + i];"
    yield "}"
    yield ""


def _pull_back(
    function: str, declaration: int, block: str, cell: int, first: int, count: int
) -> Iterator[str]:
    """Yield the adjoint of a function: the gradient of its results goes to its arguments."""
    yield f"    memcpy(seed, a + {cell + first}, {count} * sizeof(V));"
    yield f"    derivative_clear(a + {cell + first}, {count});"
    yield f"    declared[{declaration}]->{function}_adjoint({block}, seed, a + {cell});"


def _real(fused: Fused, transfers: Iterable[Transfer]) -> Iterator[tuple[int, int, str]]:
    """Yield source cell, target cell and factor of every real number that is copied."""
    for t in transfers:
        source, target = fused.members[t.source], fused.members[t.target]
        if not t.source_variable.type == t.target_variable.type == "Float64":
            continue
        a = source.cell + source.layout.offset_of(t.source_variable.name)
        b = target.cell + target.layout.offset_of(t.target_variable.name)
        factor = "" if t.factor == 1.0 else f"uuv_const({literal(t.factor)}) * "
        for i, j in zip(t.source_elements, t.target_elements, strict=True):
            yield a + i, b + j, factor


def _pushed(fused: Fused, transfers: Iterable[Transfer]) -> Iterator[str]:
    for source, target, factor in _real(fused, transfers):
        yield f"    d[{target}] = {factor}d[{source}];"


def _pulled(fused: Fused, transfers: Iterable[Transfer]) -> Iterator[str]:
    for source, target, factor in _real(fused, transfers):
        yield f"    a[{source}] += {factor}a[{target}];"
        yield f"    a[{target}] = uuv_const(0);"
