/* SPDX-License-Identifier: Apache-2.0 */
/* The type V of UUV_W lanes of float64, and the few operations that depend on W.
 *
 * V is a plain double for W = 1, a GCC/Clang vector for W = 2, 4, 8, ... All else in the runtime
 * is written once, on V, with + - * / and the functions of this file, so that each lane sees the
 * same operations in the same order for every W. The results are then equal to the last bit
 * between lane counts, compilers and processors, provided that the compiler
 *   - contracts nothing (-ffp-contract=off),
 *   - keeps IEEE 754 (no -ffast-math) in round to nearest, with subnormals on.
 * NaN is NaN everywhere; its sign and payload are not defined.
 */
#ifndef UUV_LANES_H
#define UUV_LANES_H

#include <stdint.h>

#if defined(__FAST_MATH__)
#error "uuv_math.h needs IEEE 754 arithmetic: compile without -ffast-math and -Ofast"
#endif
#if !defined(__FLT_EVAL_METHOD__) || __FLT_EVAL_METHOD__ != 0
#error "uuv_math.h needs arithmetic in the type itself (on 32-bit x86: -msse2 -mfpmath=sse)"
#endif

#ifndef UUV_W
#define UUV_W 1
#endif

/* The one place that names the number type. The constants in the other headers are those of
 * binary64, so another type needs its own. */
#ifndef UUV_REAL
#define UUV_REAL double
#endif
typedef UUV_REAL uuv_real;
_Static_assert(sizeof(uuv_real) == 8, "only double is implemented as UUV_REAL");

/* uuv_bits holds the lanes' bit patterns. A mask is a uuv_bits of all ones or all zeros a lane. */
#if UUV_W == 1
typedef uuv_real V;
typedef uint64_t uuv_bits;
#else
/* V never crosses a library's border: what GCC says of its calling convention is noise, which
 * only -Wno-psabi on the command line silences. */
typedef uuv_real V __attribute__((vector_size(8 * UUV_W)));
typedef uint64_t uuv_bits __attribute__((vector_size(8 * UUV_W)));
typedef uuv_real uuv_unaligned_ __attribute__((vector_size(8 * UUV_W), aligned(8), may_alias));
#endif
typedef uuv_bits uuv_mask;

#if UUV_W == 1

static inline V uuv_const(uuv_real c) { return c; }
static inline uuv_bits uuv_const_bits(uint64_t c) { return c; }
static inline uuv_real uuv_lane(V x, int i) { return (void)i, x; }
static inline V uuv_with_lane(V x, int i, uuv_real value) { return (void)i, (void)x, value; }
static inline V uuv_load(const uuv_real *p) { return *p; }
static inline void uuv_store(uuv_real *p, V x) { *p = x; }
static inline uuv_bits uuv_to_bits(V x) {
    union {
        V x;
        uuv_bits b;
    } u = {x};
    return u.b;
}
static inline V uuv_from_bits(uuv_bits b) {
    union {
        uuv_bits b;
        V x;
    } u = {b};
    return u.x;
}
static inline uuv_mask uuv_mask_lt(V a, V b) { return -(uint64_t)(a < b); }
static inline uuv_mask uuv_mask_le(V a, V b) { return -(uint64_t)(a <= b); }
static inline uuv_mask uuv_mask_eq(V a, V b) { return -(uint64_t)(a == b); }
static inline uuv_mask uuv_mask_ne(V a, V b) { return -(uint64_t)(a != b); }
static inline int uuv_any(uuv_mask m) { return m != 0; }

#else

/* c - 0 is c for every c, -0 included, so that compilers make one broadcast of it. */
static inline V uuv_const(uuv_real c) { return c - (V){0}; }
static inline uuv_bits uuv_const_bits(uint64_t c) { return c | (uuv_bits){0}; }
static inline uuv_real uuv_lane(V x, int i) { return x[i]; }
static inline V uuv_with_lane(V x, int i, uuv_real value) {
    x[i] = value;
    return x;
}
static inline V uuv_load(const uuv_real *p) { return (V) * (const uuv_unaligned_ *)p; }
static inline void uuv_store(uuv_real *p, V x) { *(uuv_unaligned_ *)p = (uuv_unaligned_)x; }
static inline uuv_bits uuv_to_bits(V x) { return (uuv_bits)x; }
static inline V uuv_from_bits(uuv_bits b) { return (V)b; }
static inline uuv_mask uuv_mask_lt(V a, V b) { return (uuv_mask)(a < b); }
static inline uuv_mask uuv_mask_le(V a, V b) { return (uuv_mask)(a <= b); }
static inline uuv_mask uuv_mask_eq(V a, V b) { return (uuv_mask)(a == b); }
static inline uuv_mask uuv_mask_ne(V a, V b) { return (uuv_mask)(a != b); }
static inline int uuv_any(uuv_mask m) {
#if defined(__clang__)
    return __builtin_reduce_or(m) != 0;
#else
    uint64_t any = 0;
    for (int i = 0; i < UUV_W; i++) any |= m[i];
    return any != 0;
#endif
}

#endif

static inline uuv_mask uuv_mask_gt(V a, V b) { return uuv_mask_lt(b, a); }
static inline uuv_mask uuv_mask_ge(V a, V b) { return uuv_mask_le(b, a); }
static inline uuv_mask uuv_mask_nan(V x) { return uuv_mask_ne(x, x); }

/* mask ? a : b, by bits: what stands in the branch not taken, NaN or inf, has no effect. */
static inline V uuv_select(uuv_mask mask, V a, V b) {
    return uuv_from_bits((mask & uuv_to_bits(a)) | (~mask & uuv_to_bits(b)));
}
/* mask ? x : 0 */
static inline V uuv_keep(uuv_mask mask, V x) { return uuv_from_bits(mask & uuv_to_bits(x)); }

#define UUV_SIGN_BIT 0x8000000000000000u
#define UUV_INFINITY (__builtin_inf())
#define UUV_NAN (__builtin_nan(""))

static inline V uuv_fabs(V x) { return uuv_from_bits(uuv_to_bits(x) & ~UUV_SIGN_BIT); }
static inline V uuv_neg(V x) { return uuv_from_bits(uuv_to_bits(x) ^ UUV_SIGN_BIT); }
static inline V uuv_copysign(V x, V sign) {
    return uuv_from_bits((uuv_to_bits(x) & ~UUV_SIGN_BIT) | (uuv_to_bits(sign) & UUV_SIGN_BIT));
}
/* x, or 0 if x is so small that products of it would be subnormal, which takes processors a hundred
 * cycles each: a state that decays to 0 arrives there. */
static inline V uuv_settled(V x) {
    return uuv_keep(~uuv_mask_lt(uuv_fabs(x), uuv_const(0x1p-960)), x);
}
static inline int uuv_all_finite(V x) {
    return !uuv_any(~uuv_mask_lt(uuv_fabs(x), uuv_const(UUV_INFINITY)));
}

/* The processor's square root, correctly rounded. Written out because __builtin_sqrt calls libm
 * for negative arguments (for errno) unless -fno-math-errno is given; GCC has no vector form. */
#if defined(__clang__)
static inline V uuv_sqrt(V x) { return __builtin_elementwise_sqrt(x); }
#else
#if defined(__x86_64__)
typedef double uuv_pair_ __attribute__((vector_size(16)));
static inline uuv_real uuv_sqrt1_(uuv_real x) {
    return __builtin_ia32_sqrtsd((uuv_pair_){x, x})[0];
}
#elif defined(__aarch64__)
static inline uuv_real uuv_sqrt1_(uuv_real x) {
    uuv_real r;
    __asm__("fsqrt %d0, %d1" : "=w"(r) : "w"(x));
    return r;
}
#elif defined(__NO_MATH_ERRNO__)
static inline uuv_real uuv_sqrt1_(uuv_real x) { return __builtin_sqrt(x); }
#else
#error "compile with -fno-math-errno, so that a square root is one instruction"
#endif
static inline V uuv_sqrt(V x) {
#if UUV_W == 1
    return uuv_sqrt1_(x);
#elif defined(__x86_64__)
    union {
        V x;
        uuv_pair_ pair[UUV_W / 2];
    } u = {x};
    for (int i = 0; i < UUV_W / 2; i++) u.pair[i] = __builtin_ia32_sqrtpd(u.pair[i]);
    return u.x;
#else
    for (int i = 0; i < UUV_W; i++) x[i] = uuv_sqrt1_(x[i]);
    return x;
#endif
}
#endif

#endif
