/* SPDX-License-Identifier: Apache-2.0 */
/* exp, expm1, log, log1p, and the two cores that powers and hyperbolic functions share. */
#ifndef UUV_EXP_LOG_H
#define UUV_EXP_LOG_H

#include "uuv_double_double.h"
#include "uuv_polynomial.h"

/* ln 2 in two parts: a whole number below 2^11 times the first is exact. */
#define UUV_LN2_HI 0x1.62e42fefa38p-1
#define UUV_LN2_LO 0x1.ef35793c7673p-45

/* Adding it leaves the nearest whole number of |x| < 2^51 in the low bits, in two's complement. */
#define UUV_TO_WHOLE 0x1.8p52

/* 2^n of a whole number |n| < 1023 */
static inline V uuv_power_of_two_(V n) {
    return uuv_from_bits((uuv_to_bits(n + UUV_TO_WHOLE) << 52) + 0x3ff0000000000000u);
}
/* x 2^n for whole numbers |n| < 2046, in two steps, so that the result may be subnormal. */
static inline V uuv_scale_(V x, V n) {
    const V half = (0.5 * n + UUV_TO_WHOLE) - UUV_TO_WHOLE;
    return x * uuv_power_of_two_(half) * uuv_power_of_two_(n - half);
}
/* x within [-limit, limit]; NaN stays. */
static inline V uuv_limit_(V x, uuv_real limit) {
    const uuv_mask outside = uuv_mask_gt(uuv_fabs(x), uuv_const(limit));
    return uuv_select(outside, uuv_copysign(uuv_const(limit), x), x);
}

/* exp(x + x_lo) = 2^k (1 + r + t) with |r| < 0.35 exact and t below 0.07, for |x| <= 800. */
static inline void uuv_exp_core_(V x, V x_lo, V *k, V *r, V *t) {
    static const uuv_real c[12] = {
        /* (exp(r) - 1 - r) / r^2, within 2^-60 of exp(r) */
        0.5,
        0.16666666666666666,
        0.04166666666666668,
        0.008333333333333333,
        0.0013888888888879073,
        0.00019841269841263298,
        2.4801587336442236e-05,
        2.755731924721873e-06,
        2.75572632790885e-07,
        2.505207109429355e-08,
        2.0918137737642736e-09,
        1.608662795678037e-10,
    };
    *k = (x * 0x1.71547652b82fep0 + UUV_TO_WHOLE) - UUV_TO_WHOLE;
    const V a = x - *k * UUV_LN2_HI;
    const V b = *k * UUV_LN2_LO - x_lo;
    *r = a - b;
    const V r_lo = (a - *r) - b;
    *t = r_lo + *r * *r * uuv_poly12_(*r, c);
}

static inline V uuv_exp(V x) {
    V k, r, t;
    uuv_exp_core_(uuv_limit_(x, 800.0), uuv_const(0.0), &k, &r, &t);
    return uuv_scale_(1.0 + (r + t), k);
}

/* exp(x) - 1 = 2^k (hi + lo), for -100 <= x <= 800. */
static inline V uuv_expm1_core_(V x, V *hi, V *lo) {
    V k, r, t, error, whole_lo;
    uuv_exp_core_(x, uuv_const(0.0), &k, &r, &t);
    /* Beyond 2^100 the one to subtract is lost anyway, and 2^-k would leave the range. */
    const V bounded = uuv_select(uuv_mask_gt(k, uuv_const(100.0)), uuv_const(100.0), k);
    const V power = uuv_neg(uuv_power_of_two_(uuv_neg(bounded)));
    const V whole = uuv_two_sum_(uuv_const(1.0), power, &whole_lo);
    *hi = uuv_fast_two_sum_(whole, r, &error);
    *lo = whole_lo + error + t;
    return k;
}

static inline V uuv_expm1(V x) {
    V hi, lo;
    /* exp(-100) is nothing beside 1. */
    const V enough = uuv_select(uuv_mask_lt(x, uuv_const(-100.0)), uuv_const(-100.0), x);
    const V k = uuv_expm1_core_(uuv_limit_(enough, 800.0), &hi, &lo);
    return uuv_copysign(uuv_scale_(hi + lo, k), x);
}

/* x = 2^k (1 + f) with 1 + f in [sqrt(1/2), sqrt(2)), exactly, for finite x > 0. */
static inline V uuv_split_exponent_(V x, V *f) {
    const uint64_t sqrt_half = 0x3fe6a09e667f3bcdu, one = 0x3ff0000000000000u;
    const uuv_mask subnormal = uuv_mask_lt(x, uuv_const(0x1p-1022));
    const V normal = uuv_select(subnormal, x * 0x1p54, x);
    const uuv_bits bits = uuv_to_bits(normal);
    const uuv_bits biased = (bits + (one - sqrt_half)) >> 52; /* k + 1023 */
    *f = uuv_from_bits(bits - (biased << 52) + one) - 1.0;
    /* A whole number in the low bits of 2^52 is that number added to 2^52. */
    const V k = uuv_from_bits(biased | 0x4330000000000000u) - (0x1p52 + 1023.0);
    return k - uuv_keep(subnormal, uuv_const(54.0));
}

/* (2 atanh(s) - 2 s) / s^3 - 2/3 = s^2 P(s^2), within 2^-66 of 2 atanh(s) */
static const uuv_real uuv_log_c_[8] = {
    0.4,
    0.28571428571429364,
    0.22222222221655885,
    0.18181818335392802,
    0.1538459496251843,
    0.1333480469384731,
    0.11706236339491206,
    0.11723178623876518,
};

/* log(x) + n ln 2 - c, for finite x > 0 and a correction c below an ulp of x over x.
 *
 * With s = f / (2 + f), log(1 + f) = 2 atanh(s) = 2 s + s R, and 2 s = f - f^2/2 + s f^2/2, so
 * that f itself, which is exact, carries the result and the rounded terms are small. */
static inline V uuv_log_core_(V x, V n, V c) {
    V f, lo;
    const V k = uuv_split_exponent_(x, &f) + n;
    const V s = f / (2.0 + f);
    const V z = s * s;
    const V R = z * (0x1.5555555555555p-1 + z * uuv_poly8_(z, uuv_log_c_));
    const V half_square = 0.5 * f * f;
    const V hi = uuv_fast_two_sum_(k * UUV_LN2_HI, f, &lo);
    const V small = half_square - (s * (half_square + R) + (k * UUV_LN2_LO - c));
    return hi + (lo - small);
}

/* What logarithms have in common outside of finite x > 0: `result` inside, else x = +inf is kept,
 * 0 gives -inf, and the rest NaN. */
static inline V uuv_log_edges_(V x, V result) {
    const V outside = uuv_select(uuv_mask_eq(x, uuv_const(0.0)), uuv_const(-UUV_INFINITY),
                                 uuv_select(uuv_mask_gt(x, uuv_const(0.0)), x, uuv_const(UUV_NAN)));
    const uuv_mask inside =
        uuv_mask_gt(x, uuv_const(0.0)) & uuv_mask_lt(x, uuv_const(UUV_INFINITY));
    return uuv_select(inside, result, outside);
}

static inline V uuv_log(V x) {
    return uuv_log_edges_(x, uuv_log_core_(x, uuv_const(0.0), uuv_const(0.0)));
}

/* log(1 + x + x_lo): the error of 1 + x is a correction d log(u) = du / u. */
static inline V uuv_log1p_core_(V x, V x_lo) {
    V u_lo;
    const V u = uuv_two_sum_(uuv_const(1.0), x, &u_lo);
    return uuv_log_edges_(u, uuv_log_core_(u, uuv_const(0.0), uuv_neg((u_lo + x_lo) / u)));
}

static inline V uuv_log1p(V x) {
    const V result = uuv_log1p_core_(x, uuv_const(0.0));
    return uuv_select(uuv_mask_eq(x, uuv_const(0.0)), x, result); /* keeps the sign of -0 */
}

#endif
