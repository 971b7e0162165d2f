/* SPDX-License-Identifier: Apache-2.0 */
/* The steps of one declaration, whose table `the_component` is known while they are compiled.
 *
 * Included at the end of a generated declaration; it exports `uuv_the_lane_stepper`.
 */
#ifndef UUV_LANE_STEPPER_H
#define UUV_LANE_STEPPER_H

#include "uuv_lane_steps.h"

#define UUV_STEP_INLINE static inline __attribute__((always_inline))

#if defined(UUV_FLOAT32)

UUV_KERNEL_API uuv_lane_draws *uuv_the_lane_draws;

/* The float64 draws, rounded; a seed lies in its cell as an integer. */
UUV_STEP_INLINE void lane_draw(const V *seed, const uuv_lane_clock *clock, uuv_words sample,
                               V *draws) {
    uuv_bits key[2];
    memcpy(key, seed, sizeof key);
    uuv_the_lane_draws((const uint32_t *)(const void *)&key[0],
                       (const uint32_t *)(const void *)&key[1], clock->index,
                       (const uint64_t *)(const void *)&sample, clock->n_draws, UUV_W,
                       (float *)(void *)draws);
}

#else

#include "uuv_random.h"

#if UUV_W == 1
UUV_STEP_INLINE uuv_bits lane_seed(V x) { return (uint64_t)(int64_t)x & 0xffffffffu; }
#else
typedef int64_t uuv_lane_signed_ __attribute__((vector_size(8 * UUV_W)));
UUV_STEP_INLINE uuv_bits lane_seed(V x) {
    return (uuv_bits)__builtin_convertvector(x, uuv_lane_signed_) & (uint64_t)0xffffffffu;
}
#endif

UUV_STEP_INLINE void lane_draw(const V *seed, const uuv_lane_clock *clock, uuv_words sample,
                               V *draws) {
    uuv_normal_lanes(lane_seed(seed[0]), lane_seed(seed[1]), clock->index, (uuv_bits)sample,
                     clock->n_draws, draws);
}

#endif

/* x = x0 + h k, of all components */
UUV_STEP_INLINE void lane_advance_states(const uuv_lane_component *c, V *b, uint32_t count, V h,
                                         const V *x0, const V *k) {
    for (uint32_t j = 0; j < count; j++)
        for (uint32_t i = 0; i < c->n_x; i++)
            b[j * c->n_block + c->off_x + i] = x0[j * c->n_x + i] + h * k[j * c->n_x + i];
}

UUV_STEP_INLINE void lane_derivatives(const uuv_lane_component *c, V *b, const V *const *p,
                                      uint32_t count, V t, const V *held, V *k) {
    for (uint32_t j = 0; j < count; j++) {
        b[j * c->n_block] = t;
        c->rhs(b + j * c->n_block, p[j], held + j * c->n_held, k + j * c->n_x);
    }
}

/* n_pieces classical Runge-Kutta steps, of `count` equal components side by side. */
UUV_STEP_INLINE void lane_integrate(const uuv_lane_component *c, V *b, const V *const *p,
                                    uint32_t count, V begin, V length, uint32_t n_pieces,
                                    V *scratch) {
    if (c->n_x == 0) return;
    const uint32_t n = count * c->n_x;
    V *x0 = scratch + count * c->n_held, *k1 = x0 + n, *k2 = k1 + n, *k3 = k2 + n, *k4 = k3 + n;
    const V h = length / uuv_const((uuv_real)n_pieces);
    const V half = uuv_const(0.5) * h, sixth = h / uuv_const(6), two = uuv_const(2);
    for (uint32_t j = 0; j < count; j++) 
        c->held(b + j * c->n_block, p[j], scratch + j * c->n_held);
    for (uint32_t piece = 0; piece < n_pieces; piece++) {
        const V t = begin + uuv_const((uuv_real)piece) * h;
        for (uint32_t j = 0; j < count; j++)
            for (uint32_t i = 0; i < c->n_x; i++)
                x0[j * c->n_x + i] = b[j * c->n_block + c->off_x + i];
        lane_derivatives(c, b, p, count, t, scratch, k1);
        lane_advance_states(c, b, count, half, x0, k1);
        lane_derivatives(c, b, p, count, t + half, scratch, k2);
        lane_advance_states(c, b, count, half, x0, k2);
        lane_derivatives(c, b, p, count, t + half, scratch, k3);
        lane_advance_states(c, b, count, h, x0, k3);
        lane_derivatives(c, b, p, count, t + h, scratch, k4);
        for (uint32_t i = 0; i < n; i++) k1[i] = k1[i] + two * k2[i] + two * k3[i] + k4[i];
        lane_advance_states(c, b, count, sixth, x0, k1);
        for (uint32_t j = 0; j < count; j++)
            for (uint32_t i = c->off_x; i < c->off_x + c->n_x; i++)
                b[j * c->n_block + i] = uuv_settled(b[j * c->n_block + i]);
    }
}

UUV_STEP_INLINE void lane_sample(const uuv_lane_component *c, const uuv_lane_clock *clock, V *b,
                                 const V *p, uuv_mask due, uuv_words sample, V t, V *draws) {
    b[0] = t;
    if (clock->n_draws) lane_draw(b + c->off_seed, clock, sample, draws);
    clock->update(b, p, draws, due);
}

static void stepper_sample(V *b, const V *p, uint32_t clock, uuv_mask due, uuv_words sample, V t,
                           V *scratch) {
    const uuv_lane_component *c = &the_component;
    for (uint32_t i = 0; i < c->n_clocks; i++)
        if (i == clock) lane_sample(c, &c->clocks[i], b, p, due, sample, t, scratch);
}

static void stepper_integrate(V *b, const V *p, V t, V length, uint32_t n_pieces, V *scratch) {
    lane_integrate(&the_component, b, &p, 1, t, length, n_pieces, scratch);
}

static void stepper_do_step(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods,
                            uint32_t n_periods, const uuv_lane_time *now,
                            const uuv_lane_sources *at, V *scratch) {
    const uuv_lane_component *c = &the_component;
    const V *p = lane_parameters(cells, b, at);
    for (uint32_t i = 0; i < c->n_clocks; i++) {
        const uuv_mask due = uuv_mask_of_words(lane_phase_is(cells, periods[i], 0));
        if (!uuv_any(due)) continue;
        const uuv_words sample = *lane_words(cells, WORD_PHASES + n_periods + periods[i]);
        lane_sample(c, &c->clocks[i], b, p, due, sample, now->t, scratch);
    }
    lane_integrate(c, b, &p, 1, now->t, now->length, n_pieces, scratch);
    b[0] = now->end;
    c->outputs_of_step(b, p, scratch, b + c->off_y);
    lane_check(cells, b, c->off_x, c->n_block);
}

static void stepper_do_step_together(V *cells, V *b, uint32_t count, uint32_t n_pieces,
                                     const uuv_lane_time *now, const uuv_lane_sources *at,
                                     V *scratch) {
    const uuv_lane_component *c = &the_component;
    const V *p[count];
    V sum = uuv_const(0);
    for (uint32_t j = 0; j < count; j++) p[j] = lane_parameters(cells, b + j * c->n_block, at);
    lane_integrate(c, b, p, count, now->t, now->length, n_pieces, scratch);
    for (uint32_t j = 0; j < count; j++) {
        V *own = b + j * c->n_block;
        own[0] = now->end;
        c->outputs_of_step(own, p[j], scratch + j * c->n_held, own + c->off_y);
        for (uint32_t i = c->off_x; i < c->n_block; i++) sum += own[i] - own[i];
    }
    if (__builtin_expect(uuv_any(uuv_mask_nan(sum)), 0))
        for (uint32_t j = 0; j < count; j++)
            lane_note_failure(cells, b + j * c->n_block, c->off_x, c->n_block);
}

UUV_KERNEL_API const uuv_lane_stepper uuv_the_lane_stepper = {
    &the_component, stepper_do_step, stepper_do_step_together, stepper_sample, stepper_integrate};

#endif
