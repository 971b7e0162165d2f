/* SPDX-License-Identifier: Apache-2.0 */
/* asin, acos, atan, atan2. */
#ifndef UUV_INVERSE_TRIG_H
#define UUV_INVERSE_TRIG_H

#include "uuv_double_double.h"
#include "uuv_polynomial.h"
#include "uuv_trig_reduction.h"

/* The angle b + *tail whose sine is |x| for |x| <= 1/2, and half the angle whose cosine is |x|
 * beyond, where *beyond is set: acos(a) = 2 asin(sqrt((1 - a) / 2)), and 1 - a is exact. */
static inline V uuv_asin_core_(V x, uuv_mask *beyond, V *tail) {
    static const uuv_real c[13] = {
        /* (asin(x) - x) / x^3 of x^2, within 2^-57 of asin(x) */
        0.16666666666666669,  0.07499999999998433,  0.04464285714635543,  0.030381944138531247,
        0.02237217294214989,  0.017352392720869973, 0.013971212973552933, 0.011479177415184906,
        0.01032281435018578,  0.005457506718640358, 0.01740087944269402,  -0.014851887071247204,
        0.028757851367421566,
    };
    V root_lo;
    const V a = uuv_fabs(x);
    *beyond = uuv_mask_gt(a, uuv_const(0.5));
    const V half = 0.5 * (1.0 - a);
    const V root = uuv_two_sqrt_(half, uuv_const(0.0), &root_lo);
    const V b = uuv_select(*beyond, root, a);
    const V z = uuv_select(*beyond, half, a * a);
    *tail = b * (z * uuv_poly13_(z, c)) + uuv_keep(*beyond, root_lo);
    return b;
}

static inline V uuv_asin(V x) {
    V tail, lo;
    uuv_mask beyond;
    const V b = uuv_asin_core_(x, &beyond, &tail);
    const V hi = uuv_fast_two_sum_(uuv_const(UUV_PI_2_HI), -2.0 * b, &lo);
    const V complement = hi + (lo + (UUV_PI_2_LO - 2.0 * tail));
    return uuv_copysign(uuv_select(beyond, complement, b + tail), x);
}

static inline V uuv_acos(V x) {
    V tail, lo;
    uuv_mask beyond;
    const V one = uuv_const(1.0), two = uuv_const(2.0);
    const V b = uuv_asin_core_(x, &beyond, &tail);
    /* pi/2 - asin(x), and for x < -1/2 pi - acos(-x) */
    const V turns = uuv_select(beyond, two, one);
    const V minus = uuv_select(beyond, two, uuv_copysign(one, x));
    const V hi = uuv_fast_two_sum_(turns * UUV_PI_2_HI, uuv_neg(minus * b), &lo);
    const V obtuse = hi + (lo + (turns * UUV_PI_2_LO - minus * tail));
    return uuv_select(beyond & uuv_mask_gt(x, uuv_const(0.0)), 2.0 * (b + tail), obtuse);
}

/* atan(a / b) = returned + *lo for 0 <= a <= b, b > 0: by atan(a/b) = atan(m) + atan(t) with
 * t = (a - m b) / (b + m a), for the m of 0, 1/2 and 1 that makes |t| <= 0.35. Where m > 0,
 * a - m b is exact, so that t comes out of two roundings and weighs less than the result. */
static inline V uuv_atan_core_(V a, V b, V *lo) {
    static const uuv_real c[10] = {
        /* (atan(t) - t) / t^3 of t^2, within 2^-57 of atan(t) */
        -0.3333333333333333,  0.19999999999993992,  -0.14285714284091458, 0.1111111094062979,
        -0.09090899967601614, 0.07692026047044884,  -0.06661338270442817, 0.05819248952735004,
        -0.0480131552252986,  0.02786281798169355,
    };
    V error;
    const uuv_mask steep = uuv_mask_gt(a, 0.72 * b), middle = uuv_mask_gt(a, 0.35 * b) & ~steep;
    const V m_b = uuv_keep(steep, b) + uuv_keep(middle, 0.5 * b);
    const V m_a = uuv_keep(steep, a) + uuv_keep(middle, 0.5 * a);
    const V base = uuv_keep(steep, uuv_const(0x1.921fb54442d18p-1)) +
                   uuv_keep(middle, uuv_const(0x1.dac670561bb4fp-2));
    const V base_lo = uuv_keep(steep, uuv_const(0x1.1a62633145c07p-55)) +
                      uuv_keep(middle, uuv_const(0x1.a2b7f222f65e2p-56));
    const V t = (a - m_b) / (b + m_a);
    const V z = t * t;
    const V hi = uuv_fast_two_sum_(base, t, &error);
    *lo = error + (base_lo + t * (z * uuv_poly10_(z, c)));
    return hi;
}

/* quarters pi/2 +- (hi + lo), where quarters is 0, 1 or 2. */
static inline V uuv_unfold_(V quarters, uuv_mask minus, V hi, V lo) {
    V error;
    const V to_hi = uuv_from_bits(uuv_to_bits(hi) ^ (minus & UUV_SIGN_BIT));
    const V to_lo = uuv_from_bits(uuv_to_bits(lo) ^ (minus & UUV_SIGN_BIT));
    const V sum = uuv_fast_two_sum_(quarters * UUV_PI_2_HI, to_hi, &error);
    return sum + (error + (quarters * UUV_PI_2_LO + to_lo));
}

static inline V uuv_atan(V x) {
    V lo;
    const V a = uuv_fabs(x), one = uuv_const(1.0);
    const uuv_mask swap = uuv_mask_gt(a, one);
    const V hi = uuv_atan_core_(uuv_select(swap, one, a), uuv_select(swap, a, one), &lo);
    return uuv_copysign(uuv_unfold_(uuv_truth(swap), swap, hi, lo), x);
}

/* C's atan2, with its rules for signed zeros and infinities. */
static inline V uuv_atan2(V y, V x) {
    V lo;
    const V ax = uuv_fabs(x), ay = uuv_fabs(y), one = uuv_const(1.0);
    const uuv_mask swap = uuv_mask_gt(ay, ax);
    V a = uuv_select(swap, ax, ay), b = uuv_select(swap, ay, ax);
    /* Only the ratio counts: 0/0 is taken as 0, inf/inf as 1, and no sum may overflow or half
     * be inexact. */
    const uuv_mask both_infinite = uuv_mask_eq(a, uuv_const(UUV_INFINITY));
    const uuv_mask both_zero = uuv_mask_eq(b, uuv_const(0.0));
    a = uuv_select(both_infinite, one, a);
    b = uuv_select(both_infinite | both_zero, one, b);
    const V up = uuv_select(uuv_mask_lt(b, uuv_const(0x1p-900)), uuv_const(0x1p200), one);
    const V scale = uuv_select(uuv_mask_gt(b, uuv_const(0x1p1000)), uuv_const(0x1p-100), up);
    const V hi = uuv_atan_core_(a * scale, b * scale, &lo);
    const uuv_mask back = -(uuv_to_bits(x) >> 63);
    const V quarters = uuv_select(swap, one, uuv_keep(back, uuv_const(2.0)));
    const V result = uuv_copysign(uuv_unfold_(quarters, swap ^ back, hi, lo), y);
    const uuv_mask nan = uuv_mask_nan(x) | uuv_mask_nan(y);
    return uuv_select(nan, uuv_const(UUV_NAN), result);
}

#endif
