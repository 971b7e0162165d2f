/* SPDX-License-Identifier: Apache-2.0 */
/* The type V of UUV_W lanes of float32, its masks and exact operations: what fmus/runtime's
 * uuv_lanes.h, uuv_arithmetic.h are for float64. Signs, NaN and infinities follow the same rules;
 * contraction to fused multiply-add is allowed here. W is 4, 8, 16 or 32.
 */
#ifndef UUV_FLOAT_LANES_H
#define UUV_FLOAT_LANES_H

#include <stdint.h>

#if defined(__FAST_MATH__)
#error "kernels need NaN and infinities: compile without -ffast-math and -Ofast"
#endif

typedef float uuv_real;
typedef float V __attribute__((vector_size(4 * UUV_W)));
typedef uint32_t uuv_bits __attribute__((vector_size(4 * UUV_W)));
typedef uuv_bits uuv_mask;

#define UUV_SIGN_BIT 0x80000000u
#define UUV_INFINITY (__builtin_inff())
#define UUV_NAN (__builtin_nanf(""))

static inline V uuv_const(uuv_real c) { return c - (V){0}; }
static inline uuv_bits uuv_const_bits(uint32_t c) { return c | (uuv_bits){0}; }
static inline uuv_real uuv_lane(V x, int i) { return x[i]; }
static inline uuv_bits uuv_to_bits(V x) { return (uuv_bits)x; }
static inline V uuv_from_bits(uuv_bits b) { return (V)b; }
static inline uuv_mask uuv_mask_lt(V a, V b) { return (uuv_mask)(a < b); }
static inline uuv_mask uuv_mask_le(V a, V b) { return (uuv_mask)(a <= b); }
static inline uuv_mask uuv_mask_eq(V a, V b) { return (uuv_mask)(a == b); }
static inline uuv_mask uuv_mask_ne(V a, V b) { return (uuv_mask)(a != b); }
static inline uuv_mask uuv_mask_gt(V a, V b) { return uuv_mask_lt(b, a); }
static inline uuv_mask uuv_mask_ge(V a, V b) { return uuv_mask_le(b, a); }
static inline uuv_mask uuv_mask_nan(V x) { return uuv_mask_ne(x, x); }
static inline int uuv_any(uuv_mask m) {
#if defined(__clang__)
    return __builtin_reduce_or(m) != 0;
#else
    uint32_t any = 0;
    for (int i = 0; i < UUV_W; i++) any |= m[i];
    return any != 0;
#endif
}
static inline V uuv_select(uuv_mask mask, V a, V b) {
    return uuv_from_bits((mask & uuv_to_bits(a)) | (~mask & uuv_to_bits(b)));
}
static inline V uuv_keep(uuv_mask mask, V x) { return uuv_from_bits(mask & uuv_to_bits(x)); }
static inline V uuv_fabs(V x) { return uuv_from_bits(uuv_to_bits(x) & ~UUV_SIGN_BIT); }
static inline V uuv_neg(V x) { return uuv_from_bits(uuv_to_bits(x) ^ UUV_SIGN_BIT); }
static inline V uuv_copysign(V x, V sign) {
    return uuv_from_bits((uuv_to_bits(x) & ~UUV_SIGN_BIT) | (uuv_to_bits(sign) & UUV_SIGN_BIT));
}
/* x, or 0 if products of it would be subnormal; see uuv_lanes.h. */
static inline V uuv_settled(V x) {
    return uuv_keep(~uuv_mask_lt(uuv_fabs(x), uuv_const(0x1p-100f)), x);
}
static inline V uuv_sqrt(V x) {
#if defined(__clang__)
    return __builtin_elementwise_sqrt(x);
#else
    for (int i = 0; i < UUV_W; i++) x[i] = __builtin_sqrtf(x[i]);
    return x;
#endif
}

static inline V uuv_sq(V x) { return x * x; }
static inline V uuv_twice(V x) { return x + x; }
static inline V uuv_inv(V x) { return 1.0f / x; }

static inline V uuv_truth(uuv_mask m) { return uuv_keep(m, uuv_const(1)); }
static inline uuv_mask uuv_mask_true(V x) { return uuv_mask_ne(x, uuv_const(0)); }
static inline V uuv_lt(V a, V b) { return uuv_truth(uuv_mask_lt(a, b)); }
static inline V uuv_le(V a, V b) { return uuv_truth(uuv_mask_le(a, b)); }
static inline V uuv_eq(V a, V b) { return uuv_truth(uuv_mask_eq(a, b)); }
static inline V uuv_ne(V a, V b) { return uuv_truth(uuv_mask_ne(a, b)); }
static inline V uuv_not(V x) { return uuv_truth(~uuv_mask_true(x)); }
static inline V uuv_and(V a, V b) { return uuv_truth(uuv_mask_true(a) & uuv_mask_true(b)); }
static inline V uuv_or(V a, V b) { return uuv_truth(uuv_mask_true(a) | uuv_mask_true(b)); }
static inline V uuv_if_else_zero(V condition, V x) { return uuv_keep(uuv_mask_true(condition), x); }
static inline V uuv_if_else(V condition, V a, V b) {
    return uuv_select(uuv_mask_true(condition), a, b);
}
static inline V uuv_sign(V x) {
    return uuv_select(uuv_mask_lt(uuv_const(0), uuv_fabs(x)), uuv_copysign(uuv_const(1), x), x);
}
static inline V uuv_fmin(V a, V b) { return uuv_select(uuv_mask_lt(a, b) | uuv_mask_nan(b), a, b); }
static inline V uuv_fmax(V a, V b) { return uuv_select(uuv_mask_lt(b, a) | uuv_mask_nan(b), a, b); }

/* From 2^23 on every float is a whole number; below, adding 2^23 rounds at the units. */
static inline V uuv_rint_(V x) {
    const V a = uuv_fabs(x), whole = uuv_const(0x1p23f);
    return uuv_select(uuv_mask_lt(a, whole), uuv_copysign((a + whole) - whole, x), x);
}
static inline V uuv_floor(V x) {
    const V r = uuv_rint_(x);
    return r - uuv_truth(uuv_mask_gt(r, x));
}
static inline V uuv_ceil(V x) { return uuv_neg(uuv_floor(uuv_neg(x))); }

#endif
