"""The C text of a kernel: one file for each declaration, and a driver that calls them in order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from uuvsim_cosim.fmus.emit import emit_function, emit_tables, literal
from uuvsim_cosim.fmus.equations import Equations
from uuvsim_cosim.kernels.fusible import Fused
from uuvsim_cosim.kernels.held import split
from uuvsim_cosim.orchestrator.plan import Transfer

__all__ = ["declaration_text", "driver_text"]


def declaration_text(eq: Equations) -> str:
    """Give the C of a declaration: the functions of its FMU, and their table."""
    o, n, model = eq.layout.offset, eq.layout.count, eq.layout.model
    functions = [eq.derived, eq.initial, eq.rhs, eq.outputs, *eq.updates]
    seed = eq.layout.offset_of("seed") if "seed" in model.variables else -1
    clocks = [
        f"    {{{sum(d.numel() for d in c.draws)}, {c.index}, update_{c.index}}},"
        for c in model.clocks
    ]
    states = range(o["state"], o["state"] + n["state"])
    emitted = emit_function(eq.rhs, "rhs(const V *b, V *dx)", ("b", "dx"))
    rhs, n_held = split(emitted, lambda cell: cell == 0 or cell in states)
    table = [
        *(["static const uuv_lane_clock clocks[] = {", *clocks, "};"] if clocks else []),
        "UUV_KERNEL_API const uuv_lane_component uuv_the_lane_component = {",
        f"    .n_block = {eq.layout.size}, .off_derived = {o['derived']}, .off_x = {o['state']},",
        f"    .n_x = {n['state']}, .n_z = {n['discrete']}, .off_y = {o['output']},",
        f"    .n_clocks = {len(clocks)}, .off_seed = {seed}, .n_held = {n_held},",
        f"    .clocks = {'clocks' if clocks else '0'},",
        "    .derived = derived, .initial = initial, .held = held, .rhs = rhs,",
        "    .outputs = outputs,",
        "};",
    ]
    parts = [
        f"/* Generated from the declaration of {model.name!r}: do not edit. */\n",
        '#include "uuv_lane_component.h"\n#include "uuv_lane_table.h"\n\n',
        emit_tables(functions),
        emit_function(eq.derived, "derived(const V *b, V *out)", ("b", "out")),
        emit_function(eq.initial, "initial(const V *b, V *out)", ("b", "out")),
        rhs,
        emit_function(eq.outputs, "outputs(const V *b, V *out)", ("b", "out")),
        *(
            emit_function(
                f, f"update_{i}(const V *b, const V *draws, V *z_new)", ("b", "draws", "z_new")
            )
            for i, f in enumerate(eq.updates)
        ),
        "\n".join(table),
    ]
    return "\n".join(parts) + "\n"


def driver_text(fused: Fused, tokens: Sequence[str]) -> str:
    """Give the C that steps and initializes a block of lanes as the plan says.

    `tokens` identify the compiled declarations: a driver is bound to them alone.
    """
    tick = fused.plan.tick
    n_periods = len(fused.periods)
    scratch = max(
        max(
            5 * m.layout.count["state"] + _held(fused, m.source),
            m.layout.count["discrete"] + _draws(fused, m.source) + 2,
        )
        for m in fused.members
    )
    named = zip(fused.sources, tokens, strict=True)
    periods = ", ".join(f"{p}u" for p in fused.periods) or "0"
    return "\n".join(
        [
            "/* Generated from a plan: do not edit. It calls",
            *(f" * {i}: {name} {token}" for i, (name, token) in enumerate(named)),
            " */",
            '#include "uuv_lane_steps.h"',
            "",
            f"enum {{ N_CELLS = {fused.n_cells}, N_START = {fused.n_start}, "
            f"N_PERIODS = {n_periods} }};",
            f"static const uint64_t period_ticks[] = {{{periods}}};",
            f"static const uuv_lane_component *declared[{len(fused.sources)}];",
            "",
            "UUV_KERNEL_API void uuv_kernel_bind(uint32_t i, const uuv_lane_component *c) {",
            "    declared[i] = c;",
            "}",
            "",
            "static void step(V *m) {",
            f"    V scratch[{scratch}];",
            f"    const uuv_lane_time now = lane_time(m, {tick.numerator}u, {tick.denominator}u);",
            *_steps(fused),
            "    lane_advance(m, N_PERIODS, period_ticks);",
            "}",
            "",
            "static void initialize(V *m, const V *start) {",
            *_initialization(fused),
            "}",
            "",
            *_derivations(fused),
            "",
            '#include "uuv_lane_blocks.h"',
            "",
        ]
    )


def _held(fused: Fused, source: str) -> int:
    """Give a bound of the values that a right-hand side may hold: one for each operation."""
    return int(fused.equations[source].rhs.n_instructions())


def _draws(fused: Fused, source: str) -> int:
    clocks = fused.equations[source].layout.model.clocks
    return max((sum(int(d.numel()) for d in c.draws) for c in clocks), default=0)


def _steps(fused: Fused) -> Iterator[str]:
    """Inputs from outputs valid at the step's start; then each in turn, with what is early."""
    plan = fused.plan
    yield from _copies(fused, (t for t in plan.transfers if not fused.is_early(t)))
    for i in fused.order:
        m = fused.members[i]
        yield f"    /* {m.path} */"
        yield from _copies(
            fused, (t for t in plan.transfers if t.target == i and fused.is_early(t))
        )
        periods = ", ".join(map(str, m.periods)) or "0"
        yield (
            f"    lane_do_step(declared[{m.declaration}], m, m + {m.cell}, {m.pieces}, "
            f"(const uint8_t[]){{{periods}}}, N_PERIODS, &now, scratch);"
        )


def _initialization(fused: Fused) -> Iterator[str]:
    """Values flow as orchestrator/initial_values.py has them flow."""
    plan = fused.plan
    yield f"    memset(m, 0, {fused.members[0].cell} * sizeof(V));"
    for m in fused.members:
        yield f"    memcpy(m + {m.cell}, start + {m.start_cell}, {m.n_start} * sizeof(V));"
        yield f"    lane_initialize(declared[{m.declaration}], m + {m.cell});"
    stale = set(range(len(fused.members)))
    for entry in [*plan.initialization, tuple(stale)]:
        into = [t for t in plan.transfers if t.target in entry]
        yield from _outputs(fused, {t.source for t in into} & stale)
        stale -= {t.source for t in into}
        yield from _copies(fused, into)
        stale |= {t.target for t in into}
    yield from _outputs(fused, set(range(len(fused.members))))
    for m in fused.members:
        first, last = m.layout.offset["state"], m.layout.size
        yield f"    lane_check(m, m + {m.cell}, {first}, {last});"


def _outputs(fused: Fused, members: Iterable[int]) -> Iterator[str]:
    for i in sorted(members):
        m = fused.members[i]
        at = m.cell + m.layout.offset["output"]
        yield f"    declared[{m.declaration}]->outputs(m + {m.cell}, m + {at});"


def _derivations(fused: Fused) -> Iterator[str]:
    """What follows from parameters, anew for one component."""
    yield "static void derive(V *m, uint32_t member) {"
    yield "    switch (member) {"
    for i, m in enumerate(fused.members):
        at = m.cell + m.layout.offset["derived"]
        call = f"declared[{m.declaration}]->derived(m + {m.cell}, m + {at})"
        yield f"        case {i}: {call}; break;"
    yield "    }"
    yield "}"


def _copies(fused: Fused, transfers: Iterable[Transfer]) -> Iterator[str]:
    for t in transfers:
        source, target = fused.members[t.source], fused.members[t.target]
        a = source.cell + source.layout.offset_of(t.source_variable.name)
        b = target.cell + target.layout.offset_of(t.target_variable.name)
        for i, j in zip(t.source_elements, t.target_elements, strict=True):
            value = f"m[{a + i}]"
            if (t.factor, t.offset) != (1.0, 0.0):
                value = f"{literal(t.factor)} * {value} + {literal(t.offset)}"
            yield f"    m[{b + j}] = {value};"
