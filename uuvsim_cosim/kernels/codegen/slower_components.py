"""C text of components whose communication step is longer than the system's.

The whole step is made when it begins, in the lanes that are due. As in the master, its outputs
are kept in pending cells until the tick at which the step ends.
"""

from __future__ import annotations

from collections.abc import Iterator

from uuvsim_cosim.kernels.codegen.fusible import Fused

__all__ = ["becoming_visible", "due_now", "slower_steps"]


def _slow_rates(fused: Fused) -> list[int]:
    return sorted({m.rate for m in fused.members} - {-1})


def due_now(fused: Fused) -> Iterator[str]:
    """Yield the masks of the lanes that begin a longer communication step now."""
    for rate in _slow_rates(fused):
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
    for rate in _slow_rates(fused):
        last = fused.periods[rate] - 1
        ends = f"uuv_mask_of_words(lane_phase_is(m, {rate}, {last}))"
        yield f"    const uuv_mask ends_{rate} = {ends};"
        for m in fused.members:
            if m.rate == rate:
                at = m.cell + m.layout.offset["output"]
                yield f"    for (uint32_t i = 0; i < {m.layout.count['output']}; i++)"
                new, old = f"m[{m.pending} + i]", f"m[{at} + i]"
                yield f"        {old} = uuv_select(ends_{rate}, {new}, {old});"
