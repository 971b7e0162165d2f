/* SPDX-License-Identifier: Apache-2.0 */
/* pow and hypot. */
#ifndef UUV_POWER_H
#define UUV_POWER_H

#include "uuv_exp_log.h"

/* log(x) = hi + lo within 2^-64 of it, for finite x > 0: y log(x) reaches 745, and exp turns an
 * absolute error of that into a relative one. The first two terms of the series 2 s + s^3 (2/3 +
 * ...) are kept as pairs; the rest is below 2^-12 of the result. */
static inline V uuv_log_pair_(V x, V *lo) {
    V f, d_lo, e, z_lo, p_lo, v_lo, w_lo;
    const V k = uuv_split_exponent_(x, &f);
    const V d = uuv_fast_two_sum_(uuv_const(2.0), f, &d_lo);
    const V s = f / d;
    const V sd = uuv_two_product_(s, d, &e);
    const V s_lo = (((f - sd) - e) - s * d_lo) / d;
    const V z = uuv_two_product_(s, s, &e);
    z_lo = e + 2.0 * s * s_lo;
    const V higher = z * uuv_poly8_(z, uuv_log_c_);
    const V p = uuv_fast_two_sum_(uuv_const(0x1.5555555555555p-1), higher, &e);
    p_lo = e + 0x1.5555555555555p-55;
    const V v = uuv_two_product_(z, p, &e);
    v_lo = e + (z * p_lo + z_lo * p);
    const V w = uuv_two_product_(s, v, &e);
    w_lo = e + (s * v_lo + s_lo * v);
    V sum_lo, k_lo;
    const V sum = uuv_fast_two_sum_(2.0 * s, w, &sum_lo);
    const V total = uuv_fast_two_sum_(k * UUV_LN2_HI, sum, &k_lo);
    const V rest = k_lo + (k * UUV_LN2_LO + (sum_lo + (2.0 * s_lo + w_lo)));
    return uuv_fast_two_sum_(total, rest, lo);
}

/* C's pow, with all its rules for 0, 1, infinity, NaN and negative bases. */
static inline V uuv_pow(V x, V y) {
    const V zero = uuv_const(0.0), one = uuv_const(1.0), infinity = uuv_const(UUV_INFINITY);
    const V a = uuv_fabs(x);

    V log_lo, e, k, r, t;
    const V log_hi = uuv_log_pair_(a, &log_lo);
    /* Beyond 2^100 a power is 0, 1 or infinite, and the product's parts might overflow. */
    const V exponent = uuv_limit_(y, 0x1p100);
    const V p = uuv_two_product_(exponent, log_hi, &e);
    const uuv_mask within = uuv_mask_lt(uuv_fabs(p), uuv_const(800.0));
    const V p_lo = uuv_keep(within, e + exponent * log_lo);
    uuv_exp_core_(uuv_limit_(p, 800.0), p_lo, &k, &r, &t);
    V result = uuv_scale_(1.0 + (r + t), k);

    /* Limits: |x| beyond 1 grows with y > 0, |x| below 1 with y < 0. */
    const uuv_mask y_infinite = uuv_mask_eq(uuv_fabs(y), infinity);
    const uuv_mask a_extreme = uuv_mask_eq(a, zero) | uuv_mask_eq(a, infinity);
    const uuv_mask grows = ~(uuv_mask_gt(a, one) ^ uuv_mask_gt(y, zero));
    result = uuv_select(y_infinite | a_extreme, uuv_keep(grows, infinity), result);

    const uuv_mask whole = uuv_mask_eq(uuv_floor(y), y);
    const uuv_mask odd = whole & uuv_mask_ne(uuv_floor(0.5 * y), 0.5 * y);
    result = uuv_from_bits(uuv_to_bits(result) ^ (uuv_to_bits(x) & odd & UUV_SIGN_BIT));

    const uuv_mask no_root =
        uuv_mask_lt(x, zero) & uuv_mask_lt(a, infinity) & ~(whole | y_infinite);
    const uuv_mask nan = uuv_mask_nan(x) | uuv_mask_nan(y) | no_root;
    result = uuv_select(nan, uuv_const(UUV_NAN), result);
    const uuv_mask unity =
        uuv_mask_eq(x, one) | uuv_mask_eq(y, zero) | (uuv_mask_eq(a, one) & y_infinite);
    return uuv_select(unity, one, result);
}

/* CasADi's name for pow with an exponent that is constant. */
static inline V uuv_constpow(V x, V y) { return uuv_pow(x, y); }

/* sqrt(x^2 + y^2); infinite if one of them is, even beside a NaN. */
static inline V uuv_hypot(V x, V y) {
    const V ax = uuv_fabs(x), ay = uuv_fabs(y), one = uuv_const(1.0);
    const V largest = uuv_fmax(ax, ay);
    /* A square must neither overflow nor, where it counts, be subnormal. */
    const uuv_mask huge = uuv_mask_gt(largest, uuv_const(0x1p500));
    const uuv_mask tiny = uuv_mask_lt(largest, uuv_const(0x1p-400));
    const V down = uuv_select(huge, uuv_const(0x1p-600), one);
    const V scale = uuv_select(tiny, uuv_const(0x1p600), down);
    const V up = uuv_select(huge, uuv_const(0x1p600), one);
    const V unscale = uuv_select(tiny, uuv_const(0x1p-600), up);
    const V a = ax * scale, b = ay * scale;
    const V result = uuv_sqrt(a * a + b * b) * unscale;
    const uuv_mask infinite = uuv_mask_eq(largest, uuv_const(UUV_INFINITY));
    return uuv_select(infinite, largest, result);
}

#endif
