"""C text of a kernel's driver, which calls the declarations in the plan's order."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import groupby

from uuvsim_cosim.fmus.codegen.emit_c import literal
from uuvsim_cosim.kernels.codegen.fusible import Fused, Member
from uuvsim_cosim.kernels.codegen.units import Places, Units, Work, shared_text, units_of
from uuvsim_cosim.orchestrator.plan.plan import Transfer
from uuvsim_cosim.orchestrator.plan.seeds import path_words

__all__ = ["copies", "driver_text", "initialization"]

_SMALL = 4  # states of a component of which several are stepped side by side

_ON_STACK = 2048  # values of a local array; 16 lanes of them take 256 kB


def driver_text(fused: Fused, tokens: Sequence[str]) -> str:
    """Return the C that steps and initializes a block of lanes according to the plan.

    `tokens` identify the compiled declarations; they make the driver's text depend on them.
    """
    tick = fused.plan.tick
    n_periods = len(fused.periods)
    most = max(map(len, _side_by_side(fused)))
    scratch = 0
    for m in fused.members:
        # A step may hold one value for each operation.
        held = 5 * m.layout.count["state"] + m.layout.operations
        scratch = max(scratch, most * max(held, m.layout.draws + 2))
    named = zip(fused.sources, tokens, strict=True)
    periods = ", ".join(f"{p}u" for p in fused.periods) or "0"
    seeded = []  # start cell and hash of the path, of members whose key the system's seed makes
    for planned, m in zip(fused.plan.components, fused.members, strict=True):
        if m.is_seed("seed") and "seed" not in planned.start:
            first, second = path_words(m.path)
            seeded.append(
                f"{{{m.start_cell + m.layout.offset_of('seed')}, {{{first}u, {second}u}}}}"
            )
    units = units_of(fused)
    masks = partial(_masks, fused)
    arguments = ["const uuv_lane_time *now", "const uuv_lane_sources *at", "V *scratch"]
    parts, steps = shared_text("part", arguments, _steps(fused, units), units, masks)
    initial_parts, initial = shared_text("initial", [], _initial_outputs(fused, units), units)
    members = (
        f"    {{{m.declaration}, {m.cell}, {m.start_cell}, {int(m.rate >= 0)}}},"
        for m in fused.members
    )
    return "\n".join(
        [
            "/* Generated from a plan: do not edit. It calls",
            *(f" * {i}: {name} {token}" for i, (name, token) in enumerate(named)),
            " */",
            '#include "uuv_lane_steps.h"',
            "",
            f"enum {{ N_CELLS = {fused.n_cells}, N_START = {fused.n_start}, "
            f"N_PERIODS = {n_periods}, N_WORDS = {fused.n_words},",
            f"       N_WORD_CELLS = {fused.members[0].cell}, N_SEEDED = {len(seeded)}, "
            f"N_MEMBERS = {len(fused.members)},",
            f"       N_OPERATIONS = {sum(map(_operations, fused.members))} }};",
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
            *(_periods_text(p) for p in dict.fromkeys(m.periods for m in fused.members)),
            "",
            *parts,
            "static void step(V *m, const uuv_lane_sources *at) {",
            f"    {_place(scratch)}V scratch[{scratch}];",
            "    const uuv_lane_time here = lane_time(m, 0, 1, tick_num, tick_den), *now = &here;",
            *masks(steps),
            *steps,
            "    lane_advance(m, N_PERIODS, period_ticks);",
            "}",
            "",
            *initial_parts,
            "/* Outputs at the start, in the order in which they depend on each other. */",
            "static void initial_outputs(V *m) {",
            *initial,
            "}",
            "",
            "static const struct {",
            "    uint32_t declaration, cell, start, is_slower;",
            "} members[] = {",
            *members,
            "};",
            "",
            '#include "uuv_lane_blocks.h"',
            "",
        ]
    )


def _steps(fused: Fused, units: Units) -> Iterator[Work]:
    """Yield a step: inputs from outputs valid at its start, then the members in turn.

    Just before its step, a member gets the inputs that come from outputs of the same step.
    """
    late = [t for t in fused.plan.transfers if not fused.is_early(t)]
    yield from _copying(fused, units, late, stepping=True)
    for group in _side_by_side(fused):
        yield units.of[group[0]], partial(_group_step, fused, group)
    for m, unit in zip(fused.members, units.of, strict=True):
        if m.rate >= 0:
            yield unit, partial(_becoming_visible, m)


def _copying(
    fused: Fused, units: Units, transfers: Iterable[Transfer], *, stepping: bool = False
) -> Iterator[Work]:
    """Yield the copies of transfers, unit by unit: they do not depend on each other."""

    def unit_of(t: Transfer) -> int:
        return units.of[t.target]

    for unit, into in groupby(sorted(transfers, key=unit_of), unit_of):
        yield unit, partial(copies, fused, list(into), stepping=stepping)


def _group_step(fused: Fused, group: Sequence[int], places: Places) -> Iterator[str]:
    """Yield the step of a member, or of several side by side, while other memory is fetched."""
    m = fused.members[group[0]]
    yield f"    lane_fetch(at, {len(group) * _operations(m)});"
    if places.base == "m":
        yield f"    /* {', '.join(fused.members[i].path for i in group)} */"
    own, call = places.address(m.cell), f"stepper[{m.declaration}]"
    if len(group) > 1:
        yield (
            f"    {call}->do_step_together(m, {own}, {len(group)}, {m.cuts[0].pieces}, now, "
            "at, scratch);"
        )
        return
    yield from copies(fused, fused.early_into(group[0]), places, stepping=True)
    if m.rate >= 0:
        yield f"    if (uuv_any(due_{m.rate})) {_slower(m)}(m, {own}, due_{m.rate}, at, scratch);"
        return
    yield (
        f"    {call}->do_step(m, {own}, {m.cuts[0].pieces}, {_periods(m.periods)}, N_PERIODS, "
        "now, at, scratch);"
    )


def _operations(m: Member) -> int:
    """Return about how many operations a step of a member has, at least 1."""
    return (4 if m.layout.count["state"] else 1) * m.layout.operations + 1


def _periods(periods: Sequence[int]) -> str:
    return "_".join(map(str, ("periods", *periods)))


def _periods_text(periods: Sequence[int]) -> str:
    return (
        f"static const uint8_t {_periods(periods)}[] = {{{', '.join(map(str, periods)) or '0'}}};"
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


def _initial_outputs(fused: Fused, units: Units) -> Iterator[Work]:
    """Yield the initialization of a block of lanes that has its start values and states."""

    def outputs(i: int, places: Places) -> Iterator[str]:
        m = fused.members[i]
        own = places.address(m.cell)
        at = places.address(m.cell + m.layout.offset["output"])
        yield f"    declared[{m.declaration}]->outputs({own}, {own}, {at});"

    for operation in initialization(fused):
        if isinstance(operation, int):
            yield units.of[operation], partial(outputs, operation)
        else:
            yield from _copying(fused, units, operation)


def initialization(fused: Fused) -> list[int | tuple[Transfer, ...]]:
    """Return the copies and evaluations of outputs that follow the start values.

    The order is that of orchestrator/master/initial_values.py.
    """
    operations: list[int | tuple[Transfer, ...]] = []
    every = range(len(fused.members))
    stale = set(every)  # members whose outputs do not match their inputs
    for entry in [*fused.plan.initialization, tuple(every)]:
        into = tuple(t for i in entry for t in fused.plan.to_component.get(i, ()))
        sources = {t.source for t in into}
        operations += [*sorted(sources & stale), into]
        stale -= sources
        stale |= {t.target for t in into}
    return [*operations, *every]


def copies(
    fused: Fused,
    transfers: Iterable[Transfer],
    places: Places | None = None,
    *,
    stepping: bool = False,
) -> Iterator[str]:
    """Yield the copies of transfers; while `stepping`, members with longer steps copy if due."""
    value_of = (places or Places()).value
    for t in transfers:
        source, target = fused.members[t.source], fused.members[t.target]
        a = source.cell + source.layout.offset_of(t.source_variable.name)
        b = target.cell + target.layout.offset_of(t.target_variable.name)
        fresh = source.pending - source.cell - source.layout.offset["output"]
        scaled = (t.factor, t.offset) != (1.0, 0.0)
        elements = zip(t.source_elements, t.target_elements, strict=True)
        if not scaled and not (stepping and max(source.rate, target.rate) >= 0):
            yield from (f"    {value_of(b + j)} = {value_of(a + i)};" for i, j in elements)
            continue
        for i, j in elements:
            value = value_of(a + i)
            if stepping and source.rate >= 0 and fused.is_early(t):
                value = f"uuv_select(due_{source.rate}, {value_of(a + i + fresh)}, {value})"
            if scaled:
                factor, offset = (
                    f"uuv_const({literal(t.factor)})",
                    f"uuv_const({literal(t.offset)})",
                )
                value = f"{factor} * {value} + {offset}"
            if stepping and target.rate >= 0:
                value = f"uuv_select(due_{target.rate}, {value}, {value_of(b + j)})"
            yield f"    {value_of(b + j)} = {value};"


def _masks(fused: Fused, lines: Sequence[str]) -> Iterator[str]:
    """Yield the masks that lines use: lanes in which a longer step begins, or ends with this tick.

    They are those of the tick's start until its end.
    """
    used = {m.groups() for line in lines for m in _MASK.finditer(line)}
    for name, rate in sorted(used):
        phase = 0 if name == "due" else fused.periods[int(rate)] - 1
        phase_is = f"uuv_mask_of_words(lane_phase_is(m, {rate}, {phase}))"
        yield f"    const uuv_mask {name}_{rate} = {phase_is};"


_MASK = re.compile(r"\b(due|ends)_(\d+)\b")


def _slower(m: Member) -> str:
    return f"step_{m.declaration}_{m.rate}"


def _place(values: int) -> str:
    """Return the storage of a local array: images of sonars are larger than a thread's stack."""
    return "static _Thread_local " if values > _ON_STACK else ""


def slower_steps(fused: Fused) -> Iterator[str]:
    """Yield the functions that make a longer communication step; its outputs stay pending."""
    for m in {_slower(m): m for m in fused.members if m.rate >= 0}.values():
        o, n = m.layout.offset, m.layout.count
        n_kept = n["state"] + n["discrete"]
        call = f"stepper[{m.declaration}]"
        yield f"/* {m.source} */"
        yield f"static void {_slower(m)}(V *m, V *b, uuv_mask due, const uuv_lane_sources *at, "
        yield "        V *scratch) {"
        yield "    const V *p = lane_parameters(m, b, at);"
        yield f"    V *x = b + {o['state']}, *pending = b + {m.layout.size};"
        yield f"    {_place(n_kept + 1)}V kept[{n_kept + 1}];"
        yield f"    {_place(n['output'] + 1)}V fresh[{n['output'] + 1}];"
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
                yield f"        {call}->sample(b, p, {clock}, due{also}, sample, t, scratch);"
                yield "    }"
            last = cut.end == ticks
            to = "end" if last else f"lane_time(m, {cut.end}, 0, tick_num, tick_den).t"
            exact = f"lane_time(m, 0, {length}, tick_num, tick_den).length"
            yield "#if defined(UUV_FLOAT32)"
            yield f"    {call}->integrate(b, p, t, {exact}, {cut.pieces}, scratch);"
            yield "#else"
            yield f"    {call}->integrate(b, p, t, {to} - t, {cut.pieces}, scratch);"
            yield "#endif"
        yield "    b[0] = end;"
        yield f"    declared[{m.declaration}]->outputs(b, p, fresh);"
        yield f"    for (uint32_t i = 0; i < {n_kept}; i++) x[i] = uuv_select(due, x[i], kept[i]);"
        yield f"    for (uint32_t i = 0; i < {n['output']}; i++)"
        yield "        pending[i] = uuv_select(due, fresh[i], pending[i]);"
        yield f"    lane_check(m, b, {o['state']}, {o['state'] + n_kept});"
        yield f"    lane_check(m, b, {m.layout.size}, {m.size});"
        yield "}"
        yield ""


def _becoming_visible(m: Member, places: Places) -> Iterator[str]:
    """Yield the copies that make outputs visible, if the longer step ends with this tick."""
    old = places.address(m.cell + m.layout.offset["output"])
    yield f"    for (uint32_t j = 0; j < {m.layout.count['output']}; j++)"
    new = f"({places.address(m.pending)})[j]"
    yield f"        ({old})[j] = uuv_select(ends_{m.rate}, {new}, ({old})[j]);"
