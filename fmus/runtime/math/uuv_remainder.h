/* SPDX-License-Identifier: Apache-2.0 */
/* fmod and remainder: exact, for every ratio of the arguments. */
#ifndef UUV_REMAINDER_H
#define UUV_REMAINDER_H

#include "uuv_double_double.h"

/* Up to here a quotient is a whole number known within one; beyond, lanes divide bit by bit. */
#define UUV_QUOTIENT_NEAR 0x1p50

/* One lane: the remainder of x / y, both finite and > 0, x > y; *odd: the quotient is odd. */
static inline uint64_t uuv_divide_bitwise_(uint64_t x, uint64_t y, uint64_t *odd) {
    const uint64_t hidden = 0x10000000000000u;
    int x_exponent = (int)(x >> 52), y_exponent = (int)(y >> 52);
    uint64_t r = x & (hidden - 1), d = y & (hidden - 1);
    if (x_exponent) r |= hidden;
    else x_exponent = 1;
    if (y_exponent) d |= hidden;
    else y_exponent = 1;
    /* Subnormal y: bring its leading bit up, so that one step yields one bit of the quotient. */
    while (!(d & hidden)) {
        d <<= 1;
        y_exponent--;
    }
    for (int i = x_exponent - y_exponent;; i--) {
        *odd = r >= d;
        if (*odd) r -= d;
        if (i == 0) break;
        r <<= 1;
    }
    if (r == 0) return 0;
    while (!(r & hidden) && y_exponent > 1) {
        r <<= 1;
        y_exponent--;
    }
    while (y_exponent < 1) { /* exact: the remainder is a multiple of y's last bit */
        r >>= 1;
        y_exponent++;
    }
    return r & hidden ? (r & (hidden - 1)) | (uint64_t)y_exponent << 52 : r;
}

/* The same for the lanes of a mask, by pointers: a call with vectors by value is not portable. */
__attribute__((noinline, cold, unused)) static void uuv_divide_far_(const V *x, const V *y,
                                                                    const uuv_mask *far, V *r,
                                                                    uuv_bits *odd) {
    union {
        V v;
        uuv_bits b;
        uint64_t bits[UUV_W];
    } from = {*x}, by = {*y}, select = {.b = *far}, rest = {*r}, parity = {.b = *odd};
    for (int i = 0; i < UUV_W; i++)
        if (select.bits[i])
            rest.bits[i] = uuv_divide_bitwise_(from.bits[i], by.bits[i], &parity.bits[i]);
    *r = rest.v;
    *odd = parity.b;
}

/* r = |x| - n |y| for a whole number n: the quotient rounded down or to nearest, or one off.
 * r and |y| = *divisor are scaled by 1 / *unscale, so that neither n |y| nor 2 r overflows. */
static inline V uuv_remainder_core_(V x, V y, V quotient, V n, V *divisor, V *unscale,
                                    uuv_bits *odd) {
    V error;
    const V one = uuv_const(1.0), largest = uuv_const(0x1.fffffffffffffp1023);
    const V a = uuv_fabs(x), b = uuv_fabs(y);
    const uuv_mask far = uuv_mask_gt(quotient, uuv_const(UUV_QUOTIENT_NEAR)) &
                         uuv_mask_le(a, largest) & uuv_mask_gt(b, uuv_const(0.0));
    const uuv_mask huge = uuv_mask_gt(a, uuv_const(0x1p1000)) & ~far;
    const V scale = uuv_select(huge, uuv_const(0x1p-100), one);
    *unscale = uuv_select(huge, uuv_const(0x1p100), one);
    *divisor = b * scale;
    /* Both differences are exact: the first by Sterbenz' lemma, the second is the remainder, a
     * multiple of b's last bit below b. Where n = 0, b may be too large for a product, or inf. */
    const V product = uuv_two_product_(n, *divisor, &error);
    V r = uuv_select(uuv_mask_eq(n, uuv_const(0.0)), a * scale, (a * scale - product) - error);
    *odd = uuv_to_bits(n + UUV_ALL_WHOLE) & 1;
    if (__builtin_expect(uuv_any(far), 0)) uuv_divide_far_(&a, &b, &far, &r, odd);
    return r;
}

/* x - n y, n = x / y rounded towards zero; the sign is x's. */
static inline V uuv_fmod(V x, V y) {
    V divisor, unscale;
    uuv_bits odd;
    const V quotient = uuv_fabs(x) / uuv_fabs(y);
    V r = uuv_remainder_core_(x, y, quotient, uuv_floor(quotient), &divisor, &unscale, &odd);
    r = r + uuv_keep(uuv_mask_lt(r, uuv_const(0.0)), divisor);
    return uuv_copysign(r * unscale, x);
}

/* x - n y, n = x / y rounded to nearest, ties to even. */
static inline V uuv_remainder(V x, V y) {
    V divisor, unscale;
    uuv_bits odd;
    const V quotient = uuv_fabs(x) / uuv_fabs(y);
    V r = uuv_remainder_core_(x, y, quotient, uuv_rint_(quotient), &divisor, &unscale, &odd);
    const V twice = uuv_fabs(r + r);
    const uuv_mask tie = uuv_mask_eq(twice, divisor) & -odd;
    const uuv_mask next = uuv_mask_gt(twice, divisor) | tie;
    r = r - uuv_keep(next, uuv_copysign(divisor, r));
    return uuv_from_bits(uuv_to_bits(r * unscale) ^ (uuv_to_bits(x) & UUV_SIGN_BIT));
}

#endif
