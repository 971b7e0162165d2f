"""C text of a kernel's driver, which calls the declarations in the plan's order."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from uuvsim_cosim.fmus.codegen.emit_c import literal
from uuvsim_cosim.kernels.codegen.fusible import Fused
from uuvsim_cosim.orchestrator.plan.plan import Transfer
from uuvsim_cosim.orchestrator.plan.seeds import path_words

__all__ = ["copies", "driver_text", "initialization"]

_SMALL = 4  # states of a component of which several are stepped side by side


def driver_text(fused: Fused, tokens: Sequence[str]) -> str:
    """Return the C that steps and initializes a block of lanes according to the plan.

    `tokens` identify the compiled declarations; they make the driver's text depend on them.
    """
    tick = fused.plan.tick
    n_periods = len(fused.periods)
    most = max(map(len, _side_by_side(fused)))
    scratch = 0
    for m in fused.members:
        eq = fused.equations[m.source]
        # A step may hold one value for each operation.
        held = int(eq.rhs.n_instructions() + eq.outputs.n_instructions())
        clocks = eq.layout.model.clocks
        draws = max((sum(int(d.numel()) for d in c.draws) for c in clocks), default=0)
        scratch = max(scratch, most * max(5 * m.layout.count["state"] + held, draws + 2))
    named = zip(fused.sources, tokens, strict=True)
    periods = ", ".join(f"{p}u" for p in fused.periods) or "0"
    seeded = []  # start cell and hash of the path, of members whose key the system's seed makes
    for planned, m in zip(fused.plan.components, fused.members, strict=True):
        if m.is_seed("seed") and "seed" not in planned.start:
            first, second = path_words(m.path)
            seeded.append(
                f"{{{m.start_cell + m.layout.offset_of('seed')}, {{{first}u, {second}u}}}}"
            )
    derivations = []
    for i, m in enumerate(fused.members):
        at = m.cell + m.layout.offset["derived"]
        call = f"declared[{m.declaration}]->derived(m + {m.cell}, m + {at})"
        derivations.append(f"        case {i}: {call}; break;")
    return "\n".join(
        [
            "/* Generated from a plan: do not edit. It calls",
            *(f" * {i}: {name} {token}" for i, (name, token) in enumerate(named)),
            " */",
            '#include "uuv_lane_steps.h"',
            "",
            f"enum {{ N_CELLS = {fused.n_cells}, N_START = {fused.n_start}, "
            f"N_PERIODS = {n_periods}, N_WORDS = {fused.n_words},",
            f"       N_WORD_CELLS = {fused.members[0].cell}, N_SEEDED = {len(seeded)} }};",
            f"static const uint64_t tick_num = {tick.numerator}u, tick_den = {tick.denominator}u;",
            f"static const uint64_t period_ticks[] = {{{periods}}};",
            "static const struct {",
            "    uint32_t cell, path[2];",
            f"}} seeded[] = {{{', '.join(seeded) or '{0, {0, 0}}'}}};",
            f"static const uuv_lane_stepper *stepper[{len(fused.sources)}];",
            f"static const uuv_lane_component *declared[{len(fused.sources)}];",
            "",
            "UUV_KERNEL_API void uuv_kernel_bind(uint32_t i, const uuv_lane_stepper *s) {",
            "    stepper[i] = s;",
            "    declared[i] = s->component;",
            "}",
            "",
            *slower_steps(fused),
            "static void step(V *m) {",
            f"    V scratch[{scratch}];",
            "    const uuv_lane_time now = lane_time(m, 0, 1, tick_num, tick_den);",
            *due_now(fused),
            *_steps(fused),
            *becoming_visible(fused),
            "    lane_advance(m, N_PERIODS, period_ticks);",
            "}",
            "",
            "static void initialize(V *m, const V *start) {",
            *_initialization(fused),
            "}",
            "",
            "static void derive(V *m, uint32_t member) {",
            "    switch (member) {",
            *derivations,
            "    }",
            "}",
            "",
            '#include "uuv_lane_blocks.h"',
            "",
        ]
    )


def _steps(fused: Fused) -> Iterator[str]:
    """Yield a step: inputs from outputs valid at its start, then the members in turn.

    Just before its step, a member gets the inputs that come from outputs of the same step.
    """
    plan = fused.plan
    yield from copies(fused, (t for t in plan.transfers if not fused.is_early(t)), stepping=True)
    for group in _side_by_side(fused):
        m = fused.members[group[0]]
        yield f"    /* {', '.join(fused.members[i].path for i in group)} */"
        if len(group) > 1:
            yield (
                f"    stepper[{m.declaration}]->do_step_together(m, m + {m.cell}, {len(group)}, "
                f"{m.cuts[0].pieces}, &now, scratch);"
            )
            continue
        i = group[0]
        early = (t for t in plan.transfers if t.target == i and fused.is_early(t))
        yield from copies(fused, early, stepping=True)
        if m.rate >= 0:
            yield f"    if (uuv_any(due_{m.rate})) step_{i}(m, due_{m.rate}, scratch);"
            continue
        periods = ", ".join(map(str, m.periods)) or "0"
        yield f"    static const uint8_t periods_{i}[] = {{{periods}}};"
        yield (
            f"    stepper[{m.declaration}]->do_step(m, m + {m.cell}, {m.cuts[0].pieces}, "
            f"periods_{i}, N_PERIODS, &now, scratch);"
        )


def _side_by_side(fused: Fused) -> list[list[int]]:
    """Return the members in stepping order, grouped if they can be stepped side by side.

    These are equal, small, independent components that step one after another.
    """
    early = {t.target for t in fused.plan.transfers if fused.is_early(t)}
    groups: list[list[int]] = []
    for i in fused.order:
        m = fused.members[i]
        last = fused.members[groups[-1][-1]] if groups else m
        joins = (
            groups
            and (m.source, m.cell) == (last.source, last.cell + last.size)
            and m.rate == last.rate == -1
            and not m.periods
            and 0 < m.layout.count["state"] <= _SMALL
            and not early & {i, groups[-1][-1]}
        )
        if joins:
            groups[-1].append(i)
        else:
            groups.append([i])
    return groups


def _initialization(fused: Fused) -> Iterator[str]:
    """Yield the initialization of a block of lanes."""
    yield "    memset(m, 0, N_WORD_CELLS * sizeof(V));"
    for m in fused.members:
        yield f"    memcpy(m + {m.cell}, start + {m.start_cell}, {m.n_start} * sizeof(V));"
        yield f"    lane_initialize(declared[{m.declaration}], m + {m.cell});"
    for operation in initialization(fused):
        if isinstance(operation, int):
            m = fused.members[operation]
            at = m.cell + m.layout.offset["output"]
            yield f"    declared[{m.declaration}]->outputs(m + {m.cell}, m + {at});"
        else:
            yield from copies(fused, operation)
    for m in fused.members:
        first, last = m.layout.offset["state"], m.layout.size
        yield f"    lane_check(m, m + {m.cell}, {first}, {last});"
        if m.rate >= 0:
            at, n = m.layout.offset["output"], m.layout.count["output"]
            yield f"    memcpy(m + {m.pending}, m + {m.cell + at}, {n} * sizeof(V));"


def initialization(fused: Fused) -> list[int | tuple[Transfer, ...]]:
    """Return what follows the start values: copies, and members whose outputs are evaluated.

    The order is that of orchestrator/master/initial_values.py.
    """
    operations: list[int | tuple[Transfer, ...]] = []
    every = range(len(fused.members))
    stale = set(every)  # members whose outputs do not match their inputs
    for entry in [*fused.plan.initialization, tuple(every)]:
        into = tuple(t for t in fused.plan.transfers if t.target in entry)
        sources = {t.source for t in into}
        operations += [*sorted(sources & stale), into]
        stale = stale - sources | {t.target for t in into}
    return [*operations, *every]


def copies(fused: Fused, transfers: Iterable[Transfer], *, stepping: bool = False) -> Iterator[str]:
    """Yield the copies of transfers; while `stepping`, members with longer steps copy if due."""
    for t in transfers:
        source, target = fused.members[t.source], fused.members[t.target]
        a = source.cell + source.layout.offset_of(t.source_variable.name)
        b = target.cell + target.layout.offset_of(t.target_variable.name)
        fresh = source.pending - source.cell - source.layout.offset["output"]
        for i, j in zip(t.source_elements, t.target_elements, strict=True):
            value = f"m[{a + i}]"
            if stepping and source.rate >= 0 and fused.is_early(t):
                value = f"uuv_select(due_{source.rate}, m[{a + i + fresh}], {value})"
            if (t.factor, t.offset) != (1.0, 0.0):
                factor, offset = (
                    f"uuv_const({literal(t.factor)})",
                    f"uuv_const({literal(t.offset)})",
                )
                value = f"{factor} * {value} + {offset}"
            if stepping and target.rate >= 0:
                value = f"uuv_select(due_{target.rate}, {value}, m[{b + j}])"
            yield f"    m[{b + j}] = {value};"


def due_now(fused: Fused) -> Iterator[str]:
    """Yield the masks of the lanes that begin a longer communication step now."""
    for rate in sorted({m.rate for m in fused.members} - {-1}):
        yield f"    const uuv_mask due_{rate} = uuv_mask_of_words(lane_phase_is(m, {rate}, 0));"


def slower_steps(fused: Fused) -> Iterator[str]:
    """Yield the functions that make a longer communication step; its outputs stay pending."""
    for i, m in enumerate(fused.members):
        if m.rate < 0:
            continue
        o, n = m.layout.offset, m.layout.count
        n_kept = n["state"] + n["discrete"]
        call = f"stepper[{m.declaration}]"
        yield f"/* {m.path} */"
        yield f"static void step_{i}(V *m, uuv_mask due, V *scratch) {{"
        yield f"    V *b = m + {m.cell}, *x = b + {o['state']}, *pending = m + {m.pending};"
        yield f"    V kept[{n_kept + 1}], fresh[{n['output'] + 1}];"
        yield f"    for (uint32_t i = 0; i < {n_kept}; i++) kept[i] = x[i];"
        ticks = fused.periods[m.rate]
        yield f"    const V end = lane_time(m, 0, {ticks}, tick_num, tick_den).end;"
        yield "    V t;"
        for cut in m.cuts:
            length = cut.end - cut.begin
            yield f"    t = lane_time(m, {cut.begin}, 0, tick_num, tick_den).t;"
            for clock in cut.clocks:
                period = m.periods[clock]
                yield "    {"
                yield f"        const uuv_words sample = *lane_words(m, WORD_PHASES + {period} + "
                yield f"            N_PERIODS) + (uint64_t){cut.begin // fused.periods[period]};"
                also = (
                    ""
                    if fused.periods[period] <= ticks
                    else (f" & uuv_mask_of_words(lane_phase_is(m, {period}, 0))")
                )
                yield f"        {call}->sample(b, {clock}, due{also}, sample, t, scratch);"
                yield "    }"
            last = cut.end == ticks
            to = "end" if last else f"lane_time(m, {cut.end}, 0, tick_num, tick_den).t"
            exact = f"lane_time(m, 0, {length}, tick_num, tick_den).length"
            yield "#if defined(UUV_FLOAT32)"
            yield f"    {call}->integrate(b, t, {exact}, {cut.pieces}, scratch);"
            yield "#else"
            yield f"    {call}->integrate(b, t, {to} - t, {cut.pieces}, scratch);"
            yield "#endif"
        yield "    b[0] = end;"
        yield f"    declared[{m.declaration}]->outputs(b, fresh);"
        yield f"    for (uint32_t i = 0; i < {n_kept}; i++) x[i] = uuv_select(due, x[i], kept[i]);"
        yield f"    for (uint32_t i = 0; i < {n['output']}; i++)"
        yield "        pending[i] = uuv_select(due, fresh[i], pending[i]);"
        yield f"    lane_check(m, b, {o['state']}, {o['state'] + n_kept});"
        yield f"    lane_check(m, b, {m.layout.size}, {m.size});"
        yield "}"
        yield ""


def becoming_visible(fused: Fused) -> Iterator[str]:
    """Yield the copies that make outputs visible, of longer steps that end with this tick."""
    for rate in sorted({m.rate for m in fused.members} - {-1}):
        last = fused.periods[rate] - 1
        ends = f"uuv_mask_of_words(lane_phase_is(m, {rate}, {last}))"
        yield f"    const uuv_mask ends_{rate} = {ends};"
        for m in fused.members:
            if m.rate == rate:
                at = m.cell + m.layout.offset["output"]
                yield f"    for (uint32_t i = 0; i < {m.layout.count['output']}; i++)"
                new, old = f"m[{m.pending} + i]", f"m[{at} + i]"
                yield f"        {old} = uuv_select(ends_{rate}, {new}, {old});"
