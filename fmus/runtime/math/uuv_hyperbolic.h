/* SPDX-License-Identifier: Apache-2.0 */
/* sinh, cosh, tanh and their inverses. */
#ifndef UUV_HYPERBOLIC_H
#define UUV_HYPERBOLIC_H

#include "uuv_exp_log.h"

/* exp(a) = 2^k (hi + *lo) and exp(-a) = 2^k *inverse, for 0 <= a <= 800. */
static inline V uuv_exp_both_(V a, V *k, V *lo, V *inverse) {
    V r, t, error;
    uuv_exp_core_(a, uuv_const(0.0), k, &r, &t);
    const V one_r = uuv_fast_two_sum_(uuv_const(1.0), r, &error);
    const V hi = uuv_fast_two_sum_(one_r, error + t, lo);
    /* Beyond 2^-100 of exp(a), exp(-a) is lost beside it, and 2^-2k would leave the range. */
    const V bounded = uuv_select(uuv_mask_gt(*k, uuv_const(50.0)), uuv_const(50.0), *k);
    *inverse = uuv_power_of_two_(-2.0 * bounded) / hi;
    return hi;
}

static inline V uuv_cosh(V x) {
    V k, lo, inverse;
    const V hi = uuv_exp_both_(uuv_limit_(uuv_fabs(x), 800.0), &k, &lo, &inverse);
    return uuv_scale_(hi + (lo + inverse), k - 1.0);
}

static inline V uuv_sinh(V x) {
    static const uuv_real c[8] = {
        /* (sinh(x) - x) / x^3 of x^2, within 2^-56 of sinh(x) */
        0.16666666666666666,    0.008333333333333333,   0.00019841269841269773,
        2.755731922404034e-06,  2.505210836405804e-08,  1.6059048396350562e-10,
        7.646625361656657e-13,  2.8445264169895285e-15,
    };
    V k, lo, inverse;
    const V a = uuv_fabs(x), z = x * x;
    const V hi = uuv_exp_both_(uuv_limit_(a, 800.0), &k, &lo, &inverse);
    const V large = uuv_copysign(uuv_scale_(hi + (lo - inverse), k - 1.0), x);
    const V small = x + x * (z * uuv_poly8_(z, c));
    return uuv_select(uuv_mask_lt(a, uuv_const(1.0)), small, large);
}

/* tanh(a) = -E / (2 + E) with E = exp(-2 a) - 1, which is 1 long before exp underflows. */
static inline V uuv_tanh(V x) {
    V hi, lo, d_lo;
    const V a = uuv_limit_(uuv_fabs(x), 40.0);
    const V k = uuv_expm1_core_(-2.0 * a, &hi, &lo);
    hi = uuv_fast_two_sum_(hi, lo, &lo);
    const V power = uuv_neg(uuv_power_of_two_(k));
    const V E = power * hi, E_lo = power * lo; /* of the opposite sign */
    const V d = uuv_fast_two_sum_(uuv_const(2.0), uuv_neg(E), &d_lo);
    return uuv_copysign(uuv_ratio_(E, E_lo, d, d_lo - E_lo), x);
}

static inline V uuv_asinh(V x) {
    static const uuv_real c[12] = {
        /* (asinh(x) - x) / x^3 of x^2, within 2^-58 of asinh(x) */
        -0.16666666666666666,  0.0749999999999864,    -0.044642857140252436, 0.030381944248546365,
        -0.022372151449922602, 0.01735258771519257,   -0.013962235682232349, 0.011526210169675569,
        -0.009591452221673173, 0.007622309427481728,  -0.004992717198142511, 0.0018854117655039003,
    };
    V square_lo, radicand_lo, root_lo, u_lo;
    const V a = uuv_fabs(x), one = uuv_const(1.0);
    /* log(a + sqrt(a^2 + 1)), which is log(2 a) from 2^30 on. */
    const uuv_mask large = uuv_mask_gt(a, uuv_const(0x1p30));
    const V square = uuv_two_product_(a, a, &square_lo);
    const V radicand = uuv_two_sum_(square, one, &radicand_lo);
    const V root = uuv_two_sqrt_(radicand, radicand_lo + square_lo, &root_lo);
    const V u = uuv_fast_two_sum_(root, a, &u_lo);
    const V correction = uuv_select(large, uuv_const(0.0), uuv_neg((u_lo + root_lo) / u));
    const V argument = uuv_select(large, a, u);
    const V core = uuv_log_core_(argument, uuv_truth(large), correction);
    const V beyond = uuv_log_edges_(argument, core);
    const V z = a * a;
    const V near = a + a * (z * uuv_poly12_(z, c));
    return uuv_copysign(uuv_select(uuv_mask_lt(a, uuv_const(0.5)), near, beyond), x);
}

static inline V uuv_acosh(V x) {
    V v_lo, sum_lo, radicand_lo, root_lo, u_lo;
    const V one = uuv_const(1.0);
    /* log(x + sqrt(x^2 - 1)) = log(1 + t + sqrt(t (2 + t))) with t = x - 1, which is exact up to
     * 2^53; and log(2 x) from 2^30 on. */
    const uuv_mask large = uuv_mask_gt(x, uuv_const(0x1p30));
    const V t = x - one;
    const V sum = uuv_two_sum_(x, one, &sum_lo);
    const V radicand = uuv_two_product_(t, sum, &radicand_lo);
    const V root = uuv_two_sqrt_(radicand, radicand_lo + t * sum_lo, &root_lo);
    const V v = uuv_two_sum_(root, t, &v_lo);
    const V u = uuv_two_sum_(one, v, &u_lo);
    const V correction =
        uuv_select(large, uuv_const(0.0), uuv_neg((u_lo + (v_lo + root_lo)) / u));
    const V argument = uuv_select(large, x, u);
    const V core = uuv_log_core_(argument, uuv_truth(large), correction);
    const V result = uuv_log_edges_(argument, core);
    return uuv_select(uuv_mask_lt(x, one), uuv_const(UUV_NAN), result);
}

/* atanh(a) = log((1 + a) / (1 - a)) / 2 = log1p(2 a / (1 - a)) / 2 */
static inline V uuv_atanh(V x) {
    V d_lo, product_lo;
    const V a = uuv_fabs(x);
    const V n = a + a;
    const V d = uuv_fast_two_sum_(uuv_const(1.0), uuv_neg(a), &d_lo);
    const V q = n / d;
    const V product = uuv_two_product_(q, d, &product_lo);
    const V q_lo = ((n - product) - product_lo - q * d_lo) / d;
    const V result = uuv_copysign(0.5 * uuv_log1p_core_(q, q_lo), x);
    const V edge = uuv_copysign(uuv_const(UUV_INFINITY), x);
    return uuv_select(uuv_mask_eq(a, uuv_const(1.0)), edge, result);
}

#endif
