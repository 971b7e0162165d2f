/* SPDX-License-Identifier: Apache-2.0 */
/* The communication step of a component on W lanes, each of which has a time of its own.
 *
 * The lanes see the operations of fmus/runtime/uuv_runtime.c in the same order, so that each has
 * the bits of an instance that steps alone. All clocks tick at communication points: a clock that
 * is due in some lane is evaluated for all, and its results are selected where it is due.
 *
 * A block of lanes is one array of cells. A cell is W values; the first ones hold the lanes' tick
 * counts, failures, and for each period of the system's clocks the ticks since the last sample and
 * the sample index, as integers; the components' blocks of values follow.
 */
#ifndef UUV_LANE_STEPS_H
#define UUV_LANE_STEPS_H

#include <string.h>

#include "uuv_lane_component.h"
#include "uuv_random.h"

enum { CELL_TICK, CELL_FAILED, CELL_FAILED_TICK, CELL_PHASES };

/* The beginning and the end of a step, in each lane. */
typedef struct {
    V t, end, length;
} uuv_lane_time;

#if UUV_W == 1
static inline V uuv_lane_double_(uuv_bits n) { return (V)n; }
static inline uuv_bits uuv_lane_word_(V x) { return (uint64_t)(int64_t)x & 0xffffffffu; }
#else
typedef int64_t uuv_lane_signed_ __attribute__((vector_size(8 * UUV_W)));
static inline V uuv_lane_double_(uuv_bits n) { return __builtin_convertvector(n, V); }
static inline uuv_bits uuv_lane_word_(V x) {
    return (uuv_bits)__builtin_convertvector(x, uuv_lane_signed_) & (uint64_t)0xffffffffu;
}
#endif

static inline uuv_bits lane_bits(const V *cells, uint32_t i) { return uuv_to_bits(cells[i]); }
static inline uuv_mask mask_of_equal(uuv_bits a, uint64_t b) {
#if UUV_W == 1
    return -(uint64_t)(a == b);
#else
    return (uuv_mask)(a == uuv_const_bits(b));
#endif
}

/* Seconds at the lanes' communication points: from integers, rounded once. */
static inline uuv_lane_time lane_time(const V *cells, uint64_t num, uint64_t den) {
    uuv_lane_time now;
    now.t = uuv_lane_double_(lane_bits(cells, CELL_TICK) * num) / uuv_const((double)den);
    now.end = now.t + uuv_const((double)num / (double)den);
    now.length = now.end - now.t;
    return now;
}

/* The lanes' next communication point; period j of the system's clocks is period_ticks[j]. */
static inline void lane_advance(V *cells, uint32_t n_periods, const uint64_t *period_ticks) {
    cells[CELL_TICK] = uuv_from_bits(lane_bits(cells, CELL_TICK) + (uint64_t)1);
    for (uint32_t j = 0; j < n_periods; j++) {
        V *phase = cells + CELL_PHASES + j, *sample = phase + n_periods;
        const uuv_mask was_due = mask_of_equal(uuv_to_bits(*phase), 0);
        const uuv_bits next = uuv_to_bits(*phase) + (uint64_t)1;
        *phase = uuv_from_bits(next & ~mask_of_equal(next, period_ticks[j]));
        *sample = uuv_from_bits(uuv_to_bits(*sample) + (was_due & (uint64_t)1));
    }
}

/* A lane keeps its first failure: 1 + the cell of a value that is not finite, and the tick. */
static void lane_note_failure(V *cells, const V *b, uint32_t first, uint32_t last) {
    for (int lane = 0; lane < UUV_W; lane++)
        for (uint32_t i = first; i < last; i++) {
            const double x = uuv_lane(b[i], lane);
            uint64_t *failed = (uint64_t *)(void *)(cells + CELL_FAILED) + lane;
            uint64_t known, tick, cell = (uint64_t)(b - cells) + i + 1;
            if (x - x == 0.0) continue;
            memcpy(&known, failed, sizeof known);
            if (known) break;
            memcpy(&tick, (char *)(cells + CELL_TICK) + lane * sizeof tick, sizeof tick);
            memcpy(failed, &cell, sizeof cell);
            memcpy((char *)(cells + CELL_FAILED_TICK) + lane * sizeof tick, &tick, sizeof tick);
            break;
        }
}

static inline void lane_check(V *cells, const V *b, uint32_t first, uint32_t last) {
    V sums[4] = {uuv_const(0.0), uuv_const(0.0), uuv_const(0.0), uuv_const(0.0)};
    uint32_t i = first;
    for (; i + 4 <= last; i += 4) /* zeros, and NaN from what is not finite */
        for (uint32_t j = 0; j < 4; j++) sums[j] += b[i + j] - b[i + j];
    for (; i < last; i++) sums[0] += b[i] - b[i];
    if (uuv_any(uuv_mask_nan(sums[0] + sums[1] + sums[2] + sums[3])))
        lane_note_failure(cells, b, first, last);
}

/* One classical Runge-Kutta step of length h from time t; the scratch begins with what is held. */
static inline void lane_rk4(const uuv_lane_component *c, V *b, V t, V h, V *w) {
    const uint32_t n = c->n_x;
    V *x = b + c->off_x, *x0 = w + c->n_held, *k1 = x0 + n, *k2 = k1 + n, *k3 = k2 + n, *k4 = k3 + n;
    const V half = 0.5 * h, sixth = h / 6.0, two = uuv_const(2.0);
    memcpy(x0, x, n * sizeof(V));
    b[0] = t;
    c->rhs(b, w, k1);
    b[0] = t + half;
    for (uint32_t i = 0; i < n; i++) x[i] = x0[i] + half * k1[i];
    c->rhs(b, w, k2);
    for (uint32_t i = 0; i < n; i++) x[i] = x0[i] + half * k2[i];
    c->rhs(b, w, k3);
    b[0] = t + h;
    for (uint32_t i = 0; i < n; i++) x[i] = x0[i] + h * k3[i];
    c->rhs(b, w, k4);
    for (uint32_t i = 0; i < n; i++)
        x[i] = x0[i] + sixth * (k1[i] + two * k2[i] + two * k3[i] + k4[i]);
}

static inline void lane_tick(const uuv_lane_component *c, const uuv_lane_clock *clock, V *b,
                             uuv_mask due, uuv_bits sample, V *z_new) {
    V *z = b + c->off_x + c->n_x, *draws = z_new + c->n_z;
    if (clock->n_draws)
        uuv_normal_lanes(uuv_lane_word_(b[c->off_seed]), uuv_lane_word_(b[c->off_seed + 1]),
                         clock->index, sample, clock->n_draws, draws);
    clock->update(b, draws, z_new);
    for (uint32_t i = 0; i < c->n_z; i++) z[i] = uuv_select(due, z_new[i], z[i]);
}

/* One communication step of the component whose block is b; clock i has period periods[i].
 * Integrates in n_pieces equal parts. */
static void lane_do_step(const uuv_lane_component *c, V *cells, V *b, uint32_t n_pieces,
                         const uint8_t *periods, uint32_t n_periods, const uuv_lane_time *now,
                         V *scratch) {
    for (uint32_t i = 0; i < c->n_clocks; i++) {
        const V *phase = cells + CELL_PHASES + periods[i];
        const uuv_mask due = mask_of_equal(uuv_to_bits(*phase), 0);
        if (!uuv_any(due)) continue;
        b[0] = now->t;
        lane_tick(c, &c->clocks[i], b, due, uuv_to_bits(phase[n_periods]), scratch);
    }
    if (c->n_x) {
        const V h = now->length / (double)n_pieces;
        c->held(b, scratch);
        for (uint32_t i = 0; i < n_pieces; i++)
            lane_rk4(c, b, now->t + (double)i * h, h, scratch);
    }
    b[0] = now->end;
    c->outputs(b, b + c->off_y);
    lane_check(cells, b, c->off_x, c->n_block);
}

/* Start values become derived values and states, at time 0. */
static void lane_initialize(const uuv_lane_component *c, V *b) {
    b[0] = uuv_const(0.0);
    c->derived(b, b + c->off_derived);
    c->initial(b, b + c->off_x);
}

#endif
