/* SPDX-License-Identifier: Apache-2.0 */
/* Every operation that CasADi's expressions are made of, on W lanes of float32.
 *
 * As in fmus/runtime/math/uuv_math.h all functions are total and keep the edge cases of C99, Annex F.
 * Largest errors found, in ulp of float32: tests/kernels/test_float_math.py.
 */
#ifndef UUV_FLOAT_MATH_H
#define UUV_FLOAT_MATH_H

#include "uuv_float_doubles.h"

/* ---- angles ---- */

#define UUV_FLOAT_NEAR 1e6f

/* |x| > UUV_FLOAT_NEAR, finite: 2/pi to 256 bits times a whole number of 24 bits. */
__attribute__((noinline, cold, unused)) static uint64_t uuv_reduce_far_lane_(float x, double *r) {
    static const uint32_t two_over_pi[8] = {0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0,
                                            0xdb629599, 0x3c439041, 0xfe5163ab, 0xdebbc561};
    union {
        float x;
        uint32_t bits;
    } u = {x};
    const int shift = (int)(u.bits >> 23 & 0xff) - 150; /* |x| = m 2^shift, shift > -8 */
    const uint64_t m = (u.bits & 0x7fffffu) | 0x800000u;
    /* Bits of 2/pi from the one worth 2^-(shift - 2): the rest adds whole turns. */
    const int first = shift > 2 ? shift - 2 : 0, word = first / 32, bit = first % 32;
    const uint64_t a = (uint64_t)two_over_pi[word] << 32 | two_over_pi[word + 1];
    const uint64_t b = (uint64_t)two_over_pi[word + 2] << 32 | two_over_pi[word + 3];
    const uint64_t window = bit ? a << bit | b >> (64 - bit) : a;
    const uint64_t below = bit ? b << bit : b; /* its upper bits are right */
    /* m 2^shift 2/pi = m (window 2^-64 + below 2^-128) 2^(shift - first), of 2^2 quadrants */
    const unsigned __int128 product =
        (unsigned __int128)m * window + (uint64_t)(((unsigned __int128)m * below) >> 64);
    const int point = 64 - (shift - first); /* bits after the point */
    const uint64_t quadrants = (uint64_t)(product >> point);
    uint64_t fraction = (uint64_t)(product << (128 - point) >> 64);
    const uint64_t upper = fraction >> 63;
    const double part = upper ? -(double)(~fraction) : (double)fraction;
    const double value = part * 0x1p-64 * 0x1.921fb54442d18p0;
    const uint64_t quadrant = quadrants + upper;
    *r = x < 0 ? -value : value;
    return x < 0 ? 0 - quadrant : quadrant;
}

/* x = quadrant pi/2 + r, |r| <= pi/4; of the quadrant, the last two bits count. */
static inline V uuv_reduce_(V x, uuv_bits *quadrant) {
    const uuv_wide wide = uuv_wide_of(x);
    const uuv_wide shifted = wide * 0x1.45f306dc9c883p-1 + 0x1.8p52;
    const uuv_wide k = shifted - 0x1.8p52;
    uuv_wide r = (wide - k * 0x1.921fb544p0) - k * 0x1.0b4611a626331p-34;
    uuv_wide_bits q = (uuv_wide_bits)shifted;
    const uuv_mask far = ~uuv_mask_le(uuv_fabs(x), uuv_const(UUV_FLOAT_NEAR));
    if (__builtin_expect(uuv_any(far), 0))
        for (int i = 0; i < UUV_W; i++) {
            double one = __builtin_nan("");
            if (!far[i]) continue;
            if (x[i] - x[i] == 0.0f) q[i] = uuv_reduce_far_lane_(x[i], &one);
            r[i] = one;
        }
    *quadrant = __builtin_convertvector(q, uuv_bits);
    return uuv_of_wide(r);
}

static inline void uuv_sincos(V x, V *sine, V *cosine) {
    uuv_bits quadrant;
    const V r = uuv_reduce_(x, &quadrant), z = r * r;
    V p = uuv_const(2.7175681225344306e-06f), q = uuv_const(2.4431239580735564e-05f);
    p = p * z + -0.0001983925758395344f;
    p = p * z + 0.008333329111337662f;
    p = p * z + -0.1666666716337204f;
    const V s = r + r * (z * p);
    q = q * z + -0.0013887305976822972f;
    q = q * z + 0.04166664555668831f;
    const V c = 1.0f + (z * -0.5f + z * z * q);
    const uuv_mask odd = -(quadrant & 1u);
    const V s_turned = uuv_from_bits(uuv_to_bits(uuv_select(odd, c, s)) ^ (quadrant & 2u) << 30);
    *sine = uuv_select(uuv_mask_eq(x, uuv_const(0)), x, s_turned);
    *cosine =
        uuv_from_bits(uuv_to_bits(uuv_select(odd, s, c)) ^ ((quadrant + 1u) & 2u) << 30);
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
    V s, c;
    uuv_sincos(x, &s, &c);
    return s / c;
}

/* atan(t) for 0 <= t <= 1 */
static inline V uuv_atan_core_(V t) {
    const V z = t * t;
    V p = uuv_const(-0.001793593866750598f);
    p = p * z + 0.010914481244981289f;
    p = p * z + -0.031177612021565437f;
    p = p * z + 0.05795735865831375f;
    p = p * z + -0.08403436839580536f;
    p = p * z + 0.10952181369066238f;
    p = p * z + -0.14264240860939026f;
    p = p * z + 0.19998548924922943f;
    p = p * z + -0.33333298563957214f;
    return t + t * (z * p);
}
/* pi/2 - a, or pi - a, with pi in two parts */
static inline V uuv_right_less_(V a) { return 0x1.921fb6p0f - (a + 0x1.777a5cp-25f); }
static inline V uuv_straight_less_(V a) { return 0x1.921fb6p1f - (a + 0x1.777a5cp-24f); }

static inline V uuv_atan(V x) {
    const V a = uuv_fabs(x);
    const uuv_mask steep = uuv_mask_gt(a, uuv_const(1));
    const V core = uuv_atan_core_(uuv_select(steep, 1.0f / a, a));
    return uuv_copysign(uuv_select(steep, uuv_right_less_(core), core), x);
}
static inline V uuv_atan2(V y, V x) {
    const V ax = uuv_fabs(x), ay = uuv_fabs(y), one = uuv_const(1);
    const uuv_mask steep = uuv_mask_gt(ay, ax);
    V a = uuv_select(steep, ax, ay), b = uuv_select(steep, ay, ax);
    const uuv_mask infinite = uuv_mask_eq(a, uuv_const(UUV_INFINITY));
    a = uuv_select(infinite, one, a);
    b = uuv_select(infinite | uuv_mask_eq(b, uuv_const(0)), one, b);
    const V core = uuv_atan_core_(a / b);
    const V first = uuv_select(steep, uuv_right_less_(core), core);
    const uuv_mask back = -(uuv_to_bits(x) >> 31);
    const V result = uuv_copysign(uuv_select(back, uuv_straight_less_(first), first), y);
    return uuv_select(uuv_mask_nan(x) | uuv_mask_nan(y), uuv_const(UUV_NAN), result);
}
/* asin(b) for 0 <= b <= 1/2, z = b^2 */
static inline V uuv_asin_core_(V b, V z) {
    V p = uuv_const(0.04221854731440544f);
    p = p * z + 0.02414761111140251f;
    p = p * z + 0.04547709599137306f;
    p = p * z + 0.07495241612195969f;
    p = p * z + 0.16666753590106964f;
    return b + b * (z * p);
}
static inline V uuv_asin(V x) {
    const V a = uuv_fabs(x), half = 0.5f * (1.0f - a);
    const uuv_mask beyond = uuv_mask_gt(a, uuv_const(0.5f));
    const V core = uuv_asin_core_(uuv_select(beyond, uuv_sqrt(half), a), uuv_select(beyond, half, a * a));
    return uuv_copysign(uuv_select(beyond, uuv_right_less_(2.0f * core), core), x);
}
static inline V uuv_acos(V x) {
    const V a = uuv_fabs(x), half = 0.5f * (1.0f - a);
    const uuv_mask beyond = uuv_mask_gt(a, uuv_const(0.5f)), back = uuv_mask_lt(x, uuv_const(0));
    const V core = uuv_asin_core_(uuv_select(beyond, uuv_sqrt(half), a), uuv_select(beyond, half, a * a));
    const V acute = 2.0f * core, near = uuv_right_less_(uuv_copysign(core, x));
    return uuv_select(beyond, uuv_select(back, uuv_straight_less_(acute), acute), near);
}

/* ---- exponentials and logarithms ---- */

static inline V uuv_exp(V x) {
    const uuv_mask high = uuv_mask_gt(x, uuv_const(120)), low = uuv_mask_lt(x, uuv_const(-120));
    const V in = uuv_select(high, uuv_const(120), uuv_select(low, uuv_const(-120), x));
    const V k = (in * 0x1.715476p0f + 0x1.8p23f) - 0x1.8p23f;
    const V r = (in - k * 0x1.62e4p-1f) - k * 0x1.7f7d1cp-20f;
    V p = uuv_const(0.00019919360056519508f);
    p = p * r + 0.0013947212137281895f;
    p = p * r + 0.008333262987434864f;
    p = p * r + 0.04166625440120697f;
    p = p * r + 0.1666666716337204f;
    p = p * r + 0.5f;
    const V half = (0.5f * k + 0x1.8p23f) - 0x1.8p23f;
    const V one = uuv_from_bits((uuv_to_bits(half + 0x1.8p23f) << 23) + 0x3f800000u);
    const V two = uuv_from_bits((uuv_to_bits((k - half) + 0x1.8p23f) << 23) + 0x3f800000u);
    return (1.0f + (r + r * r * p)) * one * two;
}

/* Outside of finite x > 0: infinity stays, 0 gives -infinity, the rest NaN. */
static inline V uuv_log_edges_(V x, V result) {
    const V zero = uuv_const(0), infinity = uuv_const(UUV_INFINITY);
    const V outside = uuv_select(uuv_mask_eq(x, zero), uuv_neg(infinity),
                                 uuv_select(uuv_mask_gt(x, zero), x, uuv_const(UUV_NAN)));
    return uuv_select(uuv_mask_gt(x, zero) & uuv_mask_lt(x, infinity), result, outside);
}
static inline V uuv_log(V x) {
    const uuv_mask tiny = uuv_mask_lt(x, uuv_const(0x1p-126f));
    const uuv_bits bits = uuv_to_bits(uuv_select(tiny, x * 0x1p24f, x));
    const uuv_bits biased = (bits + (0x3f800000u - 0x3f3504f3u)) >> 23;
    const V f = uuv_from_bits(bits - (biased << 23) + 0x3f800000u) - 1.0f;
    const V k = (uuv_from_bits(biased | 0x4b000000u) - (0x1p23f + 127.0f)) -
                uuv_keep(tiny, uuv_const(24));
    const V s = f / (2.0f + f), z = s * s, half = 0.5f * f * f;
    V p = uuv_const(0.2358999252319336f);
    p = p * z + 0.2853691875934601f;
    p = p * z + 0.4000034034252167f;
    p = p * z + 0.6666666269302368f;
    const V small = half - (s * (half + z * p) + k * 0x1.7f7d1cp-20f);
    return uuv_log_edges_(x, k * 0x1.62e4p-1f + (f - small));
}
static inline V uuv_expm1(V x) {
    const uuv_wide w = uuv_wide_of(x);
    const uuv_wide near = w + w * w * (0.5 + w * 0x1.5555555555555p-3);
    const uuv_wide small = (uuv_wide)((uuv_wide_bits)(w > -1e-3) & (uuv_wide_bits)(w < 1e-3));
    const V r = uuv_of_wide(uuv_wide_select((uuv_wide_bits)small, near, uuv_wide_exp(w) - 1.0));
    return uuv_select(uuv_mask_eq(x, uuv_const(0)), x, r);
}
static inline V uuv_log1p(V x) {
    const uuv_wide w = uuv_wide_of(x);
    const uuv_wide near = w - w * w * (0.5 - w * 0x1.5555555555555p-2);
    const uuv_wide_bits small = (uuv_wide_bits)(w > -1e-4) & (uuv_wide_bits)(w < 1e-4);
    const V r = uuv_of_wide(uuv_wide_select(small, near, uuv_wide_log(1.0 + w)));
    const V edges = uuv_log_edges_(uuv_select(uuv_mask_nan(x), x, 1.0f + x), r);
    const V result = uuv_select(uuv_mask_lt(uuv_fabs(x), uuv_const(0.5f)), r, edges);
    return uuv_select(uuv_mask_eq(x, uuv_const(0)), x, result);
}
static inline V uuv_pow(V x, V y) {
    const V zero = uuv_const(0), one = uuv_const(1), infinity = uuv_const(UUV_INFINITY);
    const V a = uuv_fabs(x);
    const uuv_wide log = uuv_wide_log(uuv_wide_of(a));
    V result = uuv_of_wide(uuv_wide_exp(uuv_wide_of(y) * log));
    const uuv_mask y_infinite = uuv_mask_eq(uuv_fabs(y), infinity);
    const uuv_mask a_extreme = uuv_mask_eq(a, zero) | uuv_mask_eq(a, infinity);
    const uuv_mask grows = ~(uuv_mask_gt(a, one) ^ uuv_mask_gt(y, zero));
    result = uuv_select(y_infinite | a_extreme, uuv_keep(grows, infinity), result);
    const uuv_mask whole = uuv_mask_eq(uuv_floor(y), y);
    const uuv_mask odd = whole & uuv_mask_ne(uuv_floor(0.5f * y), 0.5f * y);
    result = uuv_from_bits(uuv_to_bits(result) ^ (uuv_to_bits(x) & odd & UUV_SIGN_BIT));
    const uuv_mask no_root =
        uuv_mask_lt(x, zero) & uuv_mask_lt(a, infinity) & ~(whole | y_infinite);
    const uuv_mask nan = uuv_mask_nan(x) | uuv_mask_nan(y) | no_root;
    result = uuv_select(nan, uuv_const(UUV_NAN), result);
    const uuv_mask unity =
        uuv_mask_eq(x, one) | uuv_mask_eq(y, zero) | (uuv_mask_eq(a, one) & y_infinite);
    return uuv_select(unity, one, result);
}
static inline V uuv_constpow(V x, V y) { return uuv_pow(x, y); }
static inline V uuv_hypot(V x, V y) {
    const V infinity = uuv_const(UUV_INFINITY);
    const uuv_wide a = uuv_wide_of(x), b = uuv_wide_of(y);
    const uuv_mask infinite =
        uuv_mask_eq(uuv_fabs(x), infinity) | uuv_mask_eq(uuv_fabs(y), infinity);
    return uuv_select(infinite, infinity, uuv_of_wide(uuv_wide_sqrt(a * a + b * b)));
}

/* ---- hyperbolic functions ---- */

static inline V uuv_tanh(V x) {
    const V a = uuv_fabs(x), z = x * x;
    V p = uuv_const(-0.005660780239850283f);
    p = p * z + 0.020601999014616013f;
    p = p * z + -0.05372922867536545f;
    p = p * z + 0.13331328332424164f;
    p = p * z + -0.33333277702331543f;
    const V large = 1.0f - 2.0f / (uuv_exp(2.0f * a) + 1.0f);
    return uuv_copysign(uuv_select(uuv_mask_lt(a, uuv_const(0.6f)), a + a * (z * p), large), x);
}
/* `near` below a = limit, else the lanes of `far`; with x's sign. */
static inline V uuv_odd_(V x, float limit, uuv_wide near, uuv_wide far) {
    const V a = uuv_fabs(x);
    const uuv_mask small = uuv_mask_lt(a, uuv_const(limit));
    return uuv_copysign(uuv_select(small, uuv_of_wide(near), uuv_of_wide(far)), x);
}
static inline V uuv_sinh(V x) {
    const uuv_wide w = uuv_wide_of(uuv_fabs(x)), e = uuv_wide_exp(w);
    return uuv_odd_(x, 1e-3f, w + w * w * w * 0x1.5555555555555p-3, 0.5 * (e - 1.0 / e));
}
static inline V uuv_cosh(V x) {
    const uuv_wide e = uuv_wide_exp(uuv_wide_of(uuv_fabs(x)));
    return uuv_of_wide(0.5 * (e + 1.0 / e));
}
static inline V uuv_asinh(V x) {
    const uuv_wide w = uuv_wide_of(uuv_fabs(x));
    const uuv_wide far = uuv_wide_log(w + uuv_wide_sqrt(w * w + 1.0));
    const V edge = uuv_odd_(x, 1e-3f, w - w * w * w * 0x1.5555555555555p-3, far);
    return uuv_select(uuv_mask_lt(uuv_fabs(x), uuv_const(UUV_INFINITY)), edge, x);
}
static inline V uuv_acosh(V x) {
    const uuv_wide t = uuv_wide_of(x) - 1.0;
    const V result = uuv_of_wide(uuv_wide_log(1.0 + (t + uuv_wide_sqrt(t * (t + 2.0)))));
    return uuv_select(uuv_mask_lt(x, uuv_const(1)), uuv_const(UUV_NAN), uuv_log_edges_(x, result));
}
static inline V uuv_atanh(V x) {
    const V a = uuv_fabs(x), one = uuv_const(1);
    const uuv_wide w = uuv_wide_of(a);
    const uuv_wide far = 0.5 * uuv_wide_log((1.0 + w) / (1.0 - w));
    const V inside = uuv_odd_(x, 1e-3f, w + w * w * w * 0x1.5555555555555p-2, far);
    const V edge = uuv_select(uuv_mask_eq(a, one), uuv_copysign(uuv_const(UUV_INFINITY), x),
                              uuv_const(UUV_NAN));
    return uuv_select(uuv_mask_lt(a, one), inside, edge);
}

/* ---- remainders: exact ---- */

static inline V uuv_modulo_edges_(V x, V y, V result) {
    const V infinity = uuv_const(UUV_INFINITY);
    const uuv_mask none = uuv_mask_nan(y) | uuv_mask_eq(y, uuv_const(0)) |
                          ~uuv_mask_lt(uuv_fabs(x), infinity);
    const V kept = uuv_select(uuv_mask_eq(uuv_fabs(y), infinity), x, result);
    return uuv_select(none, uuv_const(UUV_NAN), kept);
}
/* |x| and |y| where a remainder is computed; 0 and 1 elsewhere */
static inline uuv_wide uuv_modulo_of_(V x, V y, float turns, uuv_wide *step) {
    const V a = uuv_fabs(x), b = uuv_fabs(y), infinity = uuv_const(UUV_INFINITY);
    const uuv_mask inside = uuv_mask_lt(a, infinity) & uuv_mask_lt(b, infinity) &
                            uuv_mask_gt(b, uuv_const(0));
    *step = uuv_wide_of(uuv_select(inside, b, uuv_const(1)));
    return uuv_wide_modulo(uuv_wide_of(uuv_keep(inside, a)), *step * (double)turns);
}
static inline V uuv_fmod(V x, V y) {
    uuv_wide b;
    const uuv_wide r = uuv_modulo_of_(x, y, 1.0f, &b);
    return uuv_modulo_edges_(x, y, uuv_copysign(uuv_of_wide(r), x));
}
static inline V uuv_remainder(V x, V y) {
    uuv_wide b;
    const uuv_wide r = uuv_modulo_of_(x, y, 2.0f, &b);
    const uuv_wide once = uuv_wide_select((uuv_wide_bits)(r > 0.5 * b), r - b, r);
    const uuv_wide twice = uuv_wide_select((uuv_wide_bits)(r >= 1.5 * b), r - 2.0 * b, once);
    const V near = uuv_of_wide(twice);
    const V turned = uuv_from_bits(uuv_to_bits(near) ^ (uuv_to_bits(x) & UUV_SIGN_BIT));
    const V zero = uuv_copysign(near, x);
    return uuv_modulo_edges_(x, y, uuv_select(uuv_mask_eq(near, uuv_const(0)), zero, turned));
}

#endif
