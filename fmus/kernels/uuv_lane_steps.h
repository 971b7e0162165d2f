/* SPDX-License-Identifier: Apache-2.0 */
/* The communication step of a component on W lanes, each of which has a time of its own.
 *
 * In float64 the lanes see the operations of fmus/runtime/component/uuv_runtime.c in the same order, so that
 * each has the bits of an instance that steps alone. All clocks tick at communication points: a
 * clock that is due in some lane is evaluated for all, and its results are selected where it is.
 *
 * A block of lanes is one array of cells. A cell is W values. The first ones hold W-lane words:
 * the lanes' tick counts, failures, and for each period of the system's clocks the ticks since the
 * last sample and the sample index; the components' blocks of values follow.
 */
#ifndef UUV_LANE_STEPS_H
#define UUV_LANE_STEPS_H

#include "uuv_lane_component.h"

enum { WORD_TICK, WORD_FAILED, WORD_FAILED_TICK, WORD_PHASES };

static inline uuv_words *lane_words(V *cells, uint32_t i) { return (uuv_words *)(void *)cells + i; }

/* Where the lanes are `after` ticks from now, and `ticks` later: from integers, rounded once. */
static inline uuv_lane_time lane_time(V *cells, uint64_t after, uint64_t ticks, uint64_t num,
                                      uint64_t den) {
    uuv_lane_time now;
    const double h = (double)(ticks * num) / (double)den;
    const uuv_doubles t = uuv_words_to_doubles((*lane_words(cells, WORD_TICK) + after) * num) /
                          (double)den;
    now.t = uuv_rounded(t);
    now.end = uuv_rounded(t + h);
#if defined(UUV_FLOAT32)
    now.length = uuv_const((uuv_real)h); /* a difference of rounded times would drift */
#else
    now.length = now.end - now.t;
#endif
    return now;
}

/* The block that has the parameters of the component at b: its own one, or the first. */
static inline const V *lane_parameters(const V *cells, const V *b, const uuv_lane_sources *at) {
    return !at->is_own || at->is_own[b - cells] ? b : b + at->to_first;
}

/* Asks for the next part of that memory, which comes while `operations` of a component are made. */
static inline void lane_fetch(const uuv_lane_sources *at, uint64_t operations) {
    uuv_lane_fetch *f = at->fetch;
    if (!f) return;
    for (uint64_t n = (operations * f->rate >> 32) + 1; n && f->next < f->end; n--, f->next += 64)
        __builtin_prefetch(f->next, 1, 3);
}

/* Ticks since the last sample of period j are 0: it is due. */
static inline uuv_words lane_phase_is(V *cells, uint32_t j, uint64_t ticks) {
    return uuv_words_equal(*lane_words(cells, WORD_PHASES + j), ticks);
}

/* The lanes' next communication point; period j of the system's clocks is period_ticks[j]. */
static inline void lane_advance(V *cells, uint32_t n_periods, const uint64_t *period_ticks) {
    *lane_words(cells, WORD_TICK) += (uint64_t)1;
    for (uint32_t j = 0; j < n_periods; j++) {
        uuv_words *phase = lane_words(cells, WORD_PHASES + j), *sample = phase + n_periods;
        const uuv_words was_due = uuv_words_equal(*phase, 0);
        const uuv_words next = *phase + (uint64_t)1;
        *phase = next & ~uuv_words_equal(next, period_ticks[j]);
        *sample += was_due & (uint64_t)1;
    }
}

/* A lane keeps its first failure: 1 + the cell of a value that is not finite, and the tick. */
__attribute__((noinline, cold, unused)) static void lane_note_failure(V *cells, const V *b,
                                                                      uint32_t first,
                                                                      uint32_t last) {
    uint64_t *words = (uint64_t *)(void *)cells;
    for (int lane = 0; lane < UUV_W; lane++)
        for (uint32_t i = first; i < last; i++) {
            const uuv_real x = uuv_lane(b[i], lane);
            uint64_t known, cell = (uint64_t)(b - cells) + i + 1;
            if (x - x == 0) continue;
            memcpy(&known, words + WORD_FAILED * UUV_W + lane, sizeof known);
            if (known) break;
            memcpy(words + WORD_FAILED * UUV_W + lane, &cell, sizeof cell);
            memcpy(words + WORD_FAILED_TICK * UUV_W + lane, words + WORD_TICK * UUV_W + lane,
                   sizeof cell);
            break;
        }
}

static inline void lane_check(V *cells, const V *b, uint32_t first, uint32_t last) {
    V sums[4] = {uuv_const(0), uuv_const(0), uuv_const(0), uuv_const(0)};
    uint32_t i = first;
    for (; i + 4 <= last; i += 4) /* zeros, and NaN from what is not finite */
        for (uint32_t j = 0; j < 4; j++) sums[j] += b[i + j] - b[i + j];
    for (; i < last; i++) sums[0] += b[i] - b[i];
    if (__builtin_expect(uuv_any(uuv_mask_nan(sums[0] + sums[1] + sums[2] + sums[3])), 0))
        lane_note_failure(cells, b, first, last);
}

/* Start values become derived values and states, at time 0. */
static inline void lane_initialize(const uuv_lane_component *c, V *b) {
    b[0] = uuv_const(0);
    c->derived(b, b + c->off_derived);
    c->initial(b, b + c->off_x);
}

#endif
