/* SPDX-License-Identifier: Apache-2.0 */
/* The number type of a kernel, V, and beside it 64-bit integers and doubles of as many lanes.
 *
 * V is float64 with the runtime's arithmetic, or with -DUUV_FLOAT32 float32 with its own.
 */
#ifndef UUV_LANE_WORDS_H
#define UUV_LANE_WORDS_H

#include <stdint.h>
#include <string.h>

#if defined(UUV_FLOAT32)
#include "uuv_float_math.h"
#else
#include "uuv_math.h"
#endif

#if UUV_W == 1
typedef uint64_t uuv_words __attribute__((may_alias));
typedef double uuv_doubles;
static inline uuv_words uuv_const_words(uint64_t n) { return n; }
static inline uuv_words uuv_words_equal(uuv_words a, uint64_t b) { return -(uint64_t)(a == b); }
static inline uuv_doubles uuv_words_to_doubles(uuv_words n) { return (double)n; }
#else
typedef uint64_t uuv_words __attribute__((vector_size(8 * UUV_W), may_alias));
typedef double uuv_doubles __attribute__((vector_size(8 * UUV_W)));
static inline uuv_words uuv_const_words(uint64_t n) { return n | (uuv_words){0}; }
static inline uuv_words uuv_words_equal(uuv_words a, uint64_t b) {
    return (uuv_words)(a == uuv_const_words(b));
}
static inline uuv_doubles uuv_words_to_doubles(uuv_words n) {
    return __builtin_convertvector(n, uuv_doubles);
}
#endif

#if defined(UUV_FLOAT32)
static inline V uuv_rounded(uuv_doubles x) { return __builtin_convertvector(x, V); }
static inline uuv_mask uuv_mask_of_words(uuv_words m) {
    return __builtin_convertvector(m, uuv_mask);
}
#else
static inline V uuv_rounded(uuv_doubles x) { return x; }
static inline uuv_mask uuv_mask_of_words(uuv_words m) { return (uuv_mask)m; }
#endif

#endif
