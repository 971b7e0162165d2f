/* SPDX-License-Identifier: Apache-2.0 */
/* Lanes of float64 beside those of float32, for what needs a few more bits on its way: powers,
 * hyperbolic functions, reduction of angles, remainders. Coefficients: minimax fits.
 */
#ifndef UUV_FLOAT_DOUBLES_H
#define UUV_FLOAT_DOUBLES_H

#include "uuv_float_lanes.h"

typedef double uuv_wide __attribute__((vector_size(8 * UUV_W)));
typedef uint64_t uuv_wide_bits __attribute__((vector_size(8 * UUV_W)));

static inline uuv_wide uuv_wide_of(V x) { return __builtin_convertvector(x, uuv_wide); }
static inline V uuv_of_wide(uuv_wide x) { return __builtin_convertvector(x, V); }
static inline uuv_wide uuv_wide_const(double c) { return c - (uuv_wide){0}; }
static inline uuv_wide uuv_wide_select(uuv_wide_bits mask, uuv_wide a, uuv_wide b) {
    return (uuv_wide)((mask & (uuv_wide_bits)a) | (~mask & (uuv_wide_bits)b));
}
static inline uuv_wide uuv_wide_limit(uuv_wide x, double limit) {
    const uuv_wide most = uuv_wide_const(limit);
    x = uuv_wide_select((uuv_wide_bits)(x > most), most, x);
    return uuv_wide_select((uuv_wide_bits)(x < -most), -most, x);
}
static inline uuv_wide uuv_wide_sqrt(uuv_wide x) {
#if defined(__clang__)
    return __builtin_elementwise_sqrt(x);
#else
    for (int i = 0; i < UUV_W; i++) x[i] = __builtin_sqrt(x[i]);
    return x;
#endif
}

/* exp(x), within 2^-48; beyond |x| = 200 that of 200: infinite or 0 in float32. */
static inline uuv_wide uuv_wide_exp(uuv_wide x) {
    x = uuv_wide_limit(x, 200.0);
    const uuv_wide shifted = x * 0x1.71547652b82fep0 + 0x1.8p52;
    const uuv_wide k = shifted - 0x1.8p52;
    const uuv_wide r = (x - k * 0x1.62e42fefa38p-1) - k * 0x1.ef35793c7673p-45;
    uuv_wide p = uuv_wide_const(2.7639896857865143e-07);
    p = p * r + 2.763681006164185e-06;
    p = p * r + 2.480146666396157e-05;
    p = p * r + 0.0001984118116635895;
    p = p * r + 0.0013888888968099562;
    p = p * r + 0.00833333337366314;
    p = p * r + 0.04166666666644325;
    p = p * r + 0.16666666666605862;
    p = p * r + 0.5;
    const uuv_wide_bits power = ((uuv_wide_bits)shifted << 52) + 0x3ff0000000000000u;
    return (1.0 + (r + r * r * p)) * (uuv_wide)power;
}

/* log(x) of a positive normal number, within 2^-48 of it. */
static inline uuv_wide uuv_wide_log(uuv_wide x) {
    const uuv_wide_bits bits = (uuv_wide_bits)x;
    const uuv_wide_bits biased = (bits + (0x3ff0000000000000u - 0x3fe6a09e667f3bcdu)) >> 52;
    const uuv_wide f = (uuv_wide)(bits - (biased << 52) + 0x3ff0000000000000u) - 1.0;
    const uuv_wide k = (uuv_wide)(biased | 0x4330000000000000u) - (0x1p52 + 1023.0);
    const uuv_wide s = f / (2.0 + f), z = s * s;
    uuv_wide p = uuv_wide_const(0.1682715052443237);
    p = p * z + 0.18123059075730807;
    p = p * z + 0.22223388820716938;
    p = p * z + 0.28571416903622243;
    p = p * z + 0.40000000053560003;
    p = p * z + 0.6666666666658484;
    return k * 0x1.62e42fefa39efp-1 + (2.0 * s + s * z * p);
}

/* |x| modulo y, exactly, for finite x and finite y > 0: quotients of at most 24 bits at a time. */
static inline uuv_wide uuv_wide_modulo(uuv_wide r, uuv_wide y) {
    for (;;) {
        const uuv_wide_bits more = (uuv_wide_bits)(r >= y);
        uint64_t any = 0;
        for (int i = 0; i < UUV_W; i++) any |= more[i];
        if (!any) return r;
        const uuv_wide_bits q_bits = (uuv_wide_bits)(r / y);
        const uuv_wide large = (uuv_wide)(q_bits & ~(uint64_t)0x1fffffff);
        const uuv_wide small = __builtin_convertvector(
            __builtin_convertvector((uuv_wide)q_bits, uuv_wide_bits), uuv_wide);
        const uuv_wide q =
            uuv_wide_select((uuv_wide_bits)((uuv_wide)q_bits < 0x1p24), small, large);
        const uuv_wide left = r - q * y;
        const uuv_wide right = uuv_wide_select((uuv_wide_bits)(left < 0.0), left + y, left);
        r = uuv_wide_select(more, right, r);
    }
}

#endif
