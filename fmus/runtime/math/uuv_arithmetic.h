/* SPDX-License-Identifier: Apache-2.0 */
/* CasADi's exact operations: arithmetic, comparisons, logic, rounding to integers.
 *
 * Truth values are 0.0 and 1.0; as in C, everything but 0 is true, NaN too.
 */
#ifndef UUV_ARITHMETIC_H
#define UUV_ARITHMETIC_H

#include "uuv_lanes.h"

static inline V uuv_add(V a, V b) { return a + b; }
static inline V uuv_sub(V a, V b) { return a - b; }
static inline V uuv_mul(V a, V b) { return a * b; }
static inline V uuv_div(V a, V b) { return a / b; }
static inline V uuv_sq(V x) { return x * x; }
static inline V uuv_twice(V x) { return x + x; }
static inline V uuv_inv(V x) { return 1.0 / x; }

static inline V uuv_truth(uuv_mask m) { return uuv_keep(m, uuv_const(1.0)); }
static inline uuv_mask uuv_mask_true(V x) { return uuv_mask_ne(x, uuv_const(0.0)); }

static inline V uuv_lt(V a, V b) { return uuv_truth(uuv_mask_lt(a, b)); }
static inline V uuv_le(V a, V b) { return uuv_truth(uuv_mask_le(a, b)); }
static inline V uuv_eq(V a, V b) { return uuv_truth(uuv_mask_eq(a, b)); }
static inline V uuv_ne(V a, V b) { return uuv_truth(uuv_mask_ne(a, b)); }
static inline V uuv_not(V x) { return uuv_truth(~uuv_mask_true(x)); }
static inline V uuv_and(V a, V b) { return uuv_truth(uuv_mask_true(a) & uuv_mask_true(b)); }
static inline V uuv_or(V a, V b) { return uuv_truth(uuv_mask_true(a) | uuv_mask_true(b)); }

/* condition ? x : 0, which is 0 also where x is NaN or infinite. */
static inline V uuv_if_else_zero(V condition, V x) { return uuv_keep(uuv_mask_true(condition), x); }
static inline V uuv_if_else(V condition, V a, V b) {
    return uuv_select(uuv_mask_true(condition), a, b);
}

/* x itself at +0, -0 and NaN, as CasADi has it. */
static inline V uuv_sign(V x) {
    const V one = uuv_copysign(uuv_const(1.0), x);
    return uuv_select(uuv_mask_lt(uuv_const(0.0), uuv_fabs(x)), one, x);
}

/* C's fmin and fmax: a NaN argument yields the other one. Of +0 and -0 the second is taken. */
static inline V uuv_fmin(V a, V b) {
    return uuv_select(uuv_mask_lt(a, b) | uuv_mask_nan(b), a, b);
}
static inline V uuv_fmax(V a, V b) {
    return uuv_select(uuv_mask_lt(b, a) | uuv_mask_nan(b), a, b);
}

/* From 2^52 on every double is a whole number; below, adding 2^52 rounds at the units. */
#define UUV_ALL_WHOLE 0x1p52

/* Rounds |x| < 2^52 to the nearest whole number, ties to even; larger ones are left alone. */
static inline V uuv_rint_(V x) {
    const V a = uuv_fabs(x);
    const V r = uuv_copysign((a + UUV_ALL_WHOLE) - UUV_ALL_WHOLE, x);
    return uuv_select(uuv_mask_lt(a, uuv_const(UUV_ALL_WHOLE)), r, x);
}
static inline V uuv_floor(V x) {
    const V r = uuv_rint_(x);
    return r - uuv_truth(uuv_mask_gt(r, x));
}
static inline V uuv_ceil(V x) { return uuv_neg(uuv_floor(uuv_neg(x))); }

#endif
