/* SPDX-License-Identifier: Apache-2.0 */
/* The remainder of an angle by pi/2, for every finite double, and its quadrant.
 *
 * Up to UUV_TRIG_NEAR: Cody and Waite, with pi/2 in three parts of 33 bits and a fourth of 53.
 * Beyond: Payne and Hanek (SIGNUM Newsletter 18, 1983), with only those digits of 2/pi that
 * matter, in integers, lane by lane. It is the one branch in the runtime's arithmetic: taken if
 * any lane needs it, used by those lanes alone, so that results do not depend on neighbours.
 */
#ifndef UUV_TRIG_REDUCTION_H
#define UUV_TRIG_REDUCTION_H

#include "uuv_double_double.h"

/* 2^20 pi/2: up to here, a quadrant number times a part of 33 bits is exact. */
#define UUV_TRIG_NEAR 1647099.0

#define UUV_PI_2_HI 0x1.921fb54442d18p0
#define UUV_PI_2_LO 0x1.1a62633145c07p-54

/* One lane: |x| = quadrant pi/2 + *hi + *lo, for finite |x| > 1. */
__attribute__((noinline, cold, unused)) static uint32_t uuv_reduce_far_lane_(uint64_t bits,
                                                                             double *hi,
                                                                             double *lo) {
    static const uint32_t two_over_pi[38] = {
        0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab,
        0xdebbc561, 0xb7246e3a, 0x424dd2e0, 0x06492eea, 0x09d1921c, 0xfe1deb1c, 0xb129a73e,
        0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41, 0x3991d639, 0x835339f4, 0x9c845f8b,
        0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf, 0x27cb09b7,
        0x4f463f66, 0x9e5fea2d, 0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1,
        0x1f8d5d08, 0x56033046, 0xfc7b6bab,
    };
    /* |x| = m 2^e. Digits before `first` only add multiples of 4 quadrants, four turns of pi/2. */
    const uint64_t m = (bits & 0xfffffffffffffu) | 0x10000000000000u;
    const int e = (int)(bits >> 52 & 0x7ff) - 1075;
    const int first = e < 34 ? 0 : (e - 2) / 32;
    const int shift = e - 32 * first + 32; /* 0 ... 65 */

    /* m 2^shift in four digits, the lowest first. */
    uint32_t factor[4];
    for (int i = 0; i < 4; i++) {
        const int at = 32 * i - shift;
        factor[i] = (uint32_t)(at >= 64 ? 0 : at >= 0 ? m >> at : at > -32 ? m << -at : 0);
    }
    /* Times eight digits of 2/pi: 288 bits after the point, so that quadrants begin digit 9. */
    uint32_t product[12] = {0};
    for (int i = 0; i < 4; i++) {
        uint64_t carry = 0;
        for (int j = 0; j < 8; j++) {
            carry += (uint64_t)factor[i] * two_over_pi[first + 7 - j] + product[i + j];
            product[i + j] = (uint32_t)carry;
            carry >>= 32;
        }
        product[i + 8] = (uint32_t)carry;
    }
    /* To the nearest quadrant: what is left is at most one half, of either sign. */
    const uint32_t upper = product[8] >> 31;
    const uint32_t quadrant = product[9] + upper;
    double sum = 0.0, error = 0.0, weight = 0x1p-32;
    for (int i = 8; i > 2; i--) {
        const double digit = weight * (double)(upper ? ~product[i] : product[i]);
        const double next = sum + digit;
        error += (sum - next) + digit;
        sum = next;
        weight *= 0x1p-32;
    }
    if (upper) {
        sum = -sum;
        error = -error;
    }
    /* Times pi/2, in pairs; the upper halves make the product exact. */
    const double f = sum + error, f_lo = (sum - f) + error;
    const double pi_2_upper = 0x1.921fb54p0, pi_2_lower = UUV_PI_2_HI - 0x1.921fb54p0;
    union {
        double x;
        uint64_t bits;
    } u = {f};
    u.bits &= ~(uint64_t)0x7ffffff;
    const double f_upper = u.x, f_lower = f - u.x;
    const double p = f * UUV_PI_2_HI;
    const double p_error = ((f_upper * pi_2_upper - p) + f_upper * pi_2_lower +
                            f_lower * pi_2_upper) +
                           f_lower * pi_2_lower;
    const double p_lo = p_error + (f * UUV_PI_2_LO + f_lo * UUV_PI_2_HI);
    *hi = p + p_lo;
    *lo = (p - *hi) + p_lo;
    return quadrant & 3;
}

__attribute__((noinline, cold, unused)) static void uuv_reduce_far_(const V *x, V *r, V *r_lo,
                                                                    uuv_bits *quadrant) {
    union {
        V v;
        double x[UUV_W];
        uint64_t bits[UUV_W];
    } from = {*x}, hi = {*r}, lo = {*r_lo}, q;
    *(uuv_bits *)q.bits = *quadrant;
    for (int i = 0; i < UUV_W; i++) {
        const uint64_t magnitude = from.bits[i] & ~UUV_SIGN_BIT;
        double h, l;
        if (!(from.x[i] > UUV_TRIG_NEAR || from.x[i] < -UUV_TRIG_NEAR)) continue;
        if (magnitude >= 0x7ff0000000000000u) {
            hi.x[i] = UUV_NAN;
            continue;
        }
        const uint32_t turns = uuv_reduce_far_lane_(magnitude, &h, &l);
        const int negative = from.bits[i] != magnitude;
        hi.x[i] = negative ? -h : h;
        lo.x[i] = negative ? -l : l;
        q.bits[i] = negative ? 0u - (uint64_t)turns : turns;
    }
    *r = hi.v;
    *r_lo = lo.v;
    *quadrant = *(uuv_bits *)q.bits;
}

/* x = quadrant pi/2 + r + *r_lo, |r| <= pi/4; of the quadrant, the last two bits count. */
static inline V uuv_reduce_(V x, V *r_lo, uuv_bits *quadrant) {
    V b_lo, c_lo;
    const V shifted = x * 0x1.45f306dc9c883p-1 + 0x1.8p52;
    const V k = shifted - 0x1.8p52;
    *quadrant = uuv_to_bits(shifted);
    const V a = x - k * 0x1.921fb544p0; /* exact */
    const V b = uuv_two_sum_(a, uuv_neg(k * 0x1.0b4611a6p-34), &b_lo);
    const V c = uuv_two_sum_(b, uuv_neg(k * 0x1.3198a2ep-69), &c_lo);
    const V rest = (b_lo + c_lo) - k * 0x1.b839a252049c1p-104;
    V r = uuv_fast_two_sum_(c, rest, r_lo);
    const uuv_mask far = uuv_mask_gt(uuv_fabs(x), uuv_const(UUV_TRIG_NEAR));
    if (__builtin_expect(uuv_any(far), 0)) uuv_reduce_far_(&x, &r, r_lo, quadrant);
    return r;
}

#endif
