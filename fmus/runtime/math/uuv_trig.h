/* SPDX-License-Identifier: Apache-2.0 */
/* sin, cos, both at once, and tan, of angles in radians: every finite double. */
#ifndef UUV_TRIG_H
#define UUV_TRIG_H

#include "uuv_polynomial.h"
#include "uuv_trig_reduction.h"

/* sin(r + r_lo) = r + returned, for |r| <= pi/4 */
static inline V uuv_sin_tail_(V r, V r_lo, V z) {
    static const uuv_real c[7] = {
        /* (sin(r) - r) / r^3 of r^2, within 2^-57 of sin(r) */
        -0.16666666666666666,    0.008333333333333331,   -0.00019841269841265063,
        2.7557319219337312e-06,  -2.5052106231802837e-08, 1.6058531516797758e-10,
        -7.586691094197958e-13,
    };
    return r_lo + z * (r * uuv_poly7_(z, c) - 0.5 * r_lo);
}

/* cos(r + r_lo) = returned + *lo, for |r| <= pi/4 */
static inline V uuv_cos_pair_(V r, V r_lo, V z, V *lo) {
    static const uuv_real c[6] = {
        /* (cos(r) - 1 + r^2/2) / r^4 of r^2, within 2^-59 of cos(r) */
        0.041666666666666664, -0.0013888888888887398, 2.480158729876456e-05,
        -2.7557317271145144e-07, 2.087614614655861e-09, -1.1382623647474604e-11,
    };
    const V half = 0.5 * z;
    const V hi = 1.0 - half;
    *lo = ((1.0 - hi) - half) + (z * z * uuv_poly6_(z, c) - r * r_lo);
    return hi;
}

static inline void uuv_sincos(V x, V *sine, V *cosine) {
    V r_lo, c_lo;
    uuv_bits quadrant;
    const V r = uuv_reduce_(x, &r_lo, &quadrant);
    const V z = r * r;
    const V s = r + uuv_sin_tail_(r, r_lo, z);
    const V c_hi = uuv_cos_pair_(r, r_lo, z, &c_lo);
    const V c = c_hi + c_lo;
    const uuv_mask odd = -(quadrant & 1);
    const uuv_bits s_sign = (quadrant & 2) << 62;
    const uuv_bits c_sign = ((quadrant + 1) & 2) << 62;
    const V s_turned = uuv_from_bits(uuv_to_bits(uuv_select(odd, c, s)) ^ s_sign);
    *sine = uuv_select(uuv_mask_eq(x, uuv_const(0.0)), x, s_turned); /* keeps the sign of -0 */
    *cosine = uuv_from_bits(uuv_to_bits(uuv_select(odd, s, c)) ^ c_sign);
}

static inline V uuv_sin(V x) {
    V s, c;
    uuv_sincos(x, &s, &c);
    return s;
}

static inline V uuv_cos(V x) {
    V s, c;
    uuv_sincos(x, &s, &c);
    return c;
}

static inline V uuv_tan(V x) {
    V r_lo, s_lo, c_lo;
    uuv_bits quadrant;
    const V r = uuv_reduce_(x, &r_lo, &quadrant);
    const V z = r * r;
    const V s = uuv_fast_two_sum_(r, uuv_sin_tail_(r, r_lo, z), &s_lo);
    const V c_hi = uuv_cos_pair_(r, r_lo, z, &c_lo);
    const V c = uuv_fast_two_sum_(c_hi, c_lo, &c_lo);
    const uuv_mask odd = -(quadrant & 1);
    const V t = uuv_ratio_(uuv_select(odd, c, s), uuv_select(odd, c_lo, s_lo),
                           uuv_select(odd, s, c), uuv_select(odd, s_lo, c_lo));
    const V turned = uuv_from_bits(uuv_to_bits(t) ^ (odd & UUV_SIGN_BIT));
    return uuv_select(uuv_mask_eq(x, uuv_const(0.0)), x, turned);
}

#endif
