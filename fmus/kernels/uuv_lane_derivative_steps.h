/* SPDX-License-Identifier: Apache-2.0 */
/* Tangent and adjoint of a communication step of one declaration.
 *
 * Included at the end of a generated declaration, which has its functions (rhs, update_i, …), the
 * table `clocks`, and D_X, D_Z, D_Y, D_DRAWS, D_CLOCKS, D_FIRST_X, D_FIRST_Z, D_FIRST_Y, D_SEED.
 * With UUV_TANGENT it exports tangents, else adjoints. The operations on values are those of
 * uuv_lane_stepper.h, in their order.
 */
#ifndef UUV_LANE_DERIVATIVE_STEPS_H
#define UUV_LANE_DERIVATIVE_STEPS_H

#include "uuv_random.h"

#define UUV_STEP_INLINE static inline __attribute__((always_inline))

#if UUV_W == 1
UUV_STEP_INLINE uuv_bits derivative_seed(V x) { return (uint64_t)(int64_t)x & 0xffffffffu; }
#else
typedef int64_t uuv_lane_signed_ __attribute__((vector_size(8 * UUV_W)));
UUV_STEP_INLINE uuv_bits derivative_seed(V x) {
    return (uuv_bits)__builtin_convertvector(x, uuv_lane_signed_) & (uint64_t)0xffffffffu;
}
#endif

UUV_STEP_INLINE uuv_mask derivative_due(V *cells, uint32_t period) {
    return uuv_mask_of_words(lane_phase_is(cells, period, 0));
}

UUV_STEP_INLINE void derivative_draw(V *cells, const V *b, uint32_t i, uint32_t period,
                                     uint32_t n_periods, V *draws) {
    (void)b;
    if (!clocks[i].n_draws) return;
    const uuv_words sample = *lane_words(cells, WORD_PHASES + n_periods + period);
    uuv_normal_lanes(derivative_seed(b[D_SEED]), derivative_seed(b[D_SEED + 1]), clocks[i].index,
                     (uuv_bits)sample, clocks[i].n_draws, draws);
}

/* Writes the discrete states of the lanes that are due. */
UUV_STEP_INLINE void derivative_select(uuv_mask due, const V *fresh, V *z) {
    for (uint32_t i = 0; i < D_Z; i++) z[i] = uuv_select(due, fresh[i], z[i]);
}

/* The samples that are due; d, where it is not NULL, is a perturbation. */
UUV_STEP_INLINE void derivative_samples(V *cells, V *b, V *d, const uint8_t *periods,
                                        uint32_t n_periods, V t) {
    for (uint32_t i = 0; i < D_CLOCKS; i++) {
        const uuv_mask due = derivative_due(cells, periods[i]);
        V draws[D_DRAWS + 1], fresh[D_Z + 1];
        if (!uuv_any(due)) continue;
        derivative_draw(cells, b, i, periods[i], n_periods, draws);
        b[0] = t;
#if defined(UUV_TANGENT)
        if (d) {
            clocks[i].tangent(b, draws, d, fresh);
            derivative_select(due, fresh, d + D_FIRST_Z);
        }
#else
        (void)d;
#endif
        clocks[i].update(b, draws, fresh);
        derivative_select(due, fresh, b + D_FIRST_Z);
    }
}

/* x = x0 + h k */
UUV_STEP_INLINE void derivative_advance(V *x, const V *x0, V h, const V *k) {
    for (uint32_t i = 0; i < D_X; i++) x[i] = x0[i] + h * k[i];
}

/* The derivatives k[1], k[2], k[3] of a Runge-Kutta step from b; b is left at its last stage. */
UUV_STEP_INLINE void derivative_stages(V *b, V t, V h, V x0[D_X + 1], V k[4][D_X + 1]) {
    V *x = b + D_FIRST_X;
    const V half = uuv_const(0.5) * h;
    memcpy(x0, x, D_X * sizeof(V));
    b[0] = t;
    rhs(b, k[0]);
    derivative_advance(x, x0, half, k[0]);
    b[0] = t + half;
    rhs(b, k[1]);
    derivative_advance(x, x0, half, k[1]);
    rhs(b, k[2]);
    derivative_advance(x, x0, h, k[2]);
    b[0] = t + h;
}

UUV_STEP_INLINE void derivative_settle(V *x) {
    for (uint32_t i = 0; i < D_X; i++) x[i] = uuv_settled(x[i]);
}

UUV_STEP_INLINE void derivative_sum(V k[4][D_X + 1]) {
    const V two = uuv_const(2);
    for (uint32_t i = 0; i < D_X; i++) k[0][i] = k[0][i] + two * k[1][i] + two * k[2][i] + k[3][i];
}

UUV_STEP_INLINE void derivative_runge_kutta(V *b, V t, V h) {
    V x0[D_X + 1], k[4][D_X + 1];
    derivative_stages(b, t, h, x0, k);
    rhs(b, k[3]);
    derivative_sum(k);
    derivative_advance(b + D_FIRST_X, x0, h / uuv_const(6), k[0]);
    derivative_settle(b + D_FIRST_X);
}

static void derivative_step(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods,
                            uint32_t n_periods, const uuv_lane_time *now) {
    derivative_samples(cells, b, NULL, periods, n_periods, now->t);
    const V h = now->length / uuv_const((uuv_real)n_pieces);
    for (uint32_t piece = 0; D_X && piece < n_pieces; piece++)
        derivative_runge_kutta(b, now->t + uuv_const((uuv_real)piece) * h, h);
    b[0] = now->end;
    outputs(b, b + D_FIRST_Y);
}

#if defined(UUV_TANGENT)

UUV_STEP_INLINE void tangent_runge_kutta(V *b, V *d, V t, V h) {
    V *x = b + D_FIRST_X, *dx = d + D_FIRST_X;
    V x0[D_X + 1], dx0[D_X + 1], k[4][D_X + 1], dk[4][D_X + 1];
    const V half = uuv_const(0.5) * h;
    const V after[3] = {half, half, h};
    memcpy(x0, x, D_X * sizeof(V));
    memcpy(dx0, dx, D_X * sizeof(V));
    for (uint32_t stage = 0; stage < 4; stage++) {
        b[0] = stage == 0 ? t : stage == 3 ? t + h : t + half;
        rhs(b, k[stage]);
        rhs_tangent(b, d, dk[stage]);
        if (stage == 3) break;
        derivative_advance(x, x0, after[stage], k[stage]);
        derivative_advance(dx, dx0, after[stage], dk[stage]);
    }
    derivative_sum(k);
    derivative_sum(dk);
    derivative_advance(x, x0, h / uuv_const(6), k[0]);
    derivative_settle(x);
    derivative_advance(dx, dx0, h / uuv_const(6), dk[0]);
}

static void derivative_step_tangent(V *cells, V *b, V *d, uint32_t n_pieces,
                                    const uint8_t *periods, uint32_t n_periods,
                                    const uuv_lane_time *now) {
    derivative_samples(cells, b, d, periods, n_periods, now->t);
    const V h = now->length / uuv_const((uuv_real)n_pieces);
    for (uint32_t piece = 0; D_X && piece < n_pieces; piece++)
        tangent_runge_kutta(b, d, now->t + uuv_const((uuv_real)piece) * h, h);
    b[0] = now->end;
    outputs(b, b + D_FIRST_Y);
    outputs_tangent(b, d, d + D_FIRST_Y);
}

#else

/* The gradient a of what follows a Runge-Kutta step from b becomes that of what precedes it. */
UUV_STEP_INLINE void adjoint_runge_kutta(V *b, V *a, V t, V h) {
    V *x = b + D_FIRST_X, *ax = a + D_FIRST_X;
    V x0[D_X + 1], k[4][D_X + 1], total[D_X + 1], seed[D_X + 1];
    const V half = uuv_const(0.5) * h, sixth = h / uuv_const(6), third = h / uuv_const(3);
    const V before[4] = {uuv_const(0), half, half, h}; /* a stage's step from x0 */
    const V weight[4] = {sixth, third, third, sixth};
    V end[D_X + 1];
    derivative_stages(b, t, h, x0, k);
    memcpy(end, ax, D_X * sizeof(V));
    memcpy(total, ax, D_X * sizeof(V));
    derivative_clear(ax, D_X);
    for (uint32_t back = 0; back < 4; back++) {
        const uint32_t stage = 3 - back;
        /* ax is now the gradient of the following stage's states */
        for (uint32_t i = 0; i < D_X; i++) {
            seed[i] = weight[stage] * end[i];
            if (stage < 3) seed[i] += before[stage + 1] * ax[i];
        }
        b[0] = stage == 0 ? t : stage == 3 ? t + h : t + half;
        if (stage)
            derivative_advance(x, x0, before[stage], k[stage - 1]);
        else
            memcpy(x, x0, D_X * sizeof(V));
        derivative_clear(ax, D_X);
        rhs_adjoint(b, seed, a);
        for (uint32_t i = 0; i < D_X; i++) total[i] += ax[i];
    }
    memcpy(ax, total, D_X * sizeof(V));
}

static void derivative_step_adjoint(V *cells, V *b, V *a, uint32_t n_pieces,
                                    const uint8_t *periods, uint32_t n_periods,
                                    const uuv_lane_time *now) {
    V z[D_CLOCKS + 1][D_Z + 1], x[n_pieces][D_X + 1], seed[D_Y + 1];
    const V h = now->length / uuv_const((uuv_real)n_pieces);
    /* again from the step's begin, keeping what its parts began with */
    for (uint32_t i = 0; i < D_CLOCKS; i++) {
        const uuv_mask due = derivative_due(cells, periods[i]);
        V draws[D_DRAWS + 1], fresh[D_Z + 1];
        memcpy(z[i], b + D_FIRST_Z, D_Z * sizeof(V));
        if (!uuv_any(due)) continue;
        derivative_draw(cells, b, i, periods[i], n_periods, draws);
        b[0] = now->t;
        clocks[i].update(b, draws, fresh);
        derivative_select(due, fresh, b + D_FIRST_Z);
    }
    for (uint32_t piece = 0; D_X && piece < n_pieces; piece++) {
        memcpy(x[piece], b + D_FIRST_X, D_X * sizeof(V));
        derivative_runge_kutta(b, now->t + uuv_const((uuv_real)piece) * h, h);
    }
    b[0] = now->end;
    memcpy(seed, a + D_FIRST_Y, D_Y * sizeof(V));
    derivative_clear(a + D_FIRST_Y, D_Y);
    outputs_adjoint(b, seed, a);
    for (uint32_t piece = n_pieces; D_X && piece-- > 0;) {
        memcpy(b + D_FIRST_X, x[piece], D_X * sizeof(V));
        adjoint_runge_kutta(b, a, now->t + uuv_const((uuv_real)piece) * h, h);
    }
    if (D_X) memcpy(b + D_FIRST_X, x[0], D_X * sizeof(V)); /* as samples see them */
    for (uint32_t i = D_CLOCKS; i-- > 0;) {
        const uuv_mask due = derivative_due(cells, periods[i]);
        V draws[D_DRAWS + 1], fresh[D_Z + 1];
        if (!uuv_any(due)) continue;
        memcpy(b + D_FIRST_Z, z[i], D_Z * sizeof(V));
        derivative_draw(cells, b, i, periods[i], n_periods, draws);
        b[0] = now->t;
        for (uint32_t j = 0; j < D_Z; j++) {
            V *own = a + D_FIRST_Z + j;
            fresh[j] = uuv_keep(due, *own);
            *own = uuv_keep(~due, *own);
        }
        clocks[i].adjoint(b, draws, fresh, a);
    }
}

#endif
#endif
