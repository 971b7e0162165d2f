/* SPDX-License-Identifier: Apache-2.0 */
/* Records of eight numbers, one for each lane, become eight vectors: rows are transposed. */
#ifndef UUV_LANE_ROWS_H
#define UUV_LANE_ROWS_H

#include "uuv_lane_words.h"

#define UUV_RECORD_INLINE static inline __attribute__((always_inline))

typedef struct {
    int32_t lane[UUV_W];
} uuv_lane_places;

#if UUV_W > 1
typedef int32_t uuv_lane_whole_ __attribute__((vector_size(4 * UUV_W)));
#endif

UUV_RECORD_INLINE uuv_lane_places uuv_lane_whole(V x) {
    uuv_lane_places at;
#if UUV_W == 1
    at.lane[0] = (int32_t)x;
#else
    const uuv_lane_whole_ n = __builtin_convertvector(x, uuv_lane_whole_);
    memcpy(&at, &n, sizeof at);
    __asm__("" : "+m"(at)); /* addresses come from memory: taken out of a register they cost more */
#endif
    return at;
}

/* x >= 0 without its fraction */
UUV_RECORD_INLINE V uuv_truncated(V x) {
#if UUV_W == 1
    return (V)(int32_t)x;
#else
    return __builtin_convertvector(__builtin_convertvector(x, uuv_lane_whole_), V);
#endif
}

/* Rows of memory become lanes in registers: groups of 8 rows are transposed. */
#if UUV_W % 8 == 0 && (defined(__clang__) || __GNUC__ >= 12)
#if defined(UUV_FLOAT32) && UUV_W % 16 == 0
#define UUV_UNIT 16
#else
#define UUV_UNIT 8
#endif
typedef uuv_real uuv_unit_ __attribute__((vector_size(UUV_UNIT * sizeof(uuv_real))));
#if defined(UUV_FLOAT32)
typedef uuv_real uuv_half_ __attribute__((vector_size(16))); /* of a row */
typedef uuv_real uuv_halves_ __attribute__((vector_size(32)));

UUV_RECORD_INLINE uuv_halves_ uuv_two_halves_(const uuv_real *first, const uuv_real *second) {
    return __builtin_shufflevector(*(const uuv_half_ *)(const void *)first,
                                   *(const uuv_half_ *)(const void *)second, 0, 1, 2, 3, 4, 5, 6,
                                   7);
}

#if UUV_UNIT == 16
#define UUV_EVEN_(a, b) \
    __builtin_shufflevector(a, b, 0, 2, 16, 18, 4, 6, 20, 22, 8, 10, 24, 26, 12, 14, 28, 30)
#define UUV_ODD_(a, b) \
    __builtin_shufflevector(a, b, 1, 3, 17, 19, 5, 7, 21, 23, 9, 11, 25, 27, 13, 15, 29, 31)
#else
#define UUV_EVEN_(a, b) __builtin_shufflevector(a, b, 0, 2, 8, 10, 4, 6, 12, 14)
#define UUV_ODD_(a, b) __builtin_shufflevector(a, b, 1, 3, 9, 11, 5, 7, 13, 15)
#endif

/* Half a row of every fourth lane. */
UUV_RECORD_INLINE uuv_unit_ uuv_every_fourth_(const uuv_real *half, const int32_t *at) {
    const uuv_halves_ low = uuv_two_halves_(half + 8 * (int64_t)at[0], half + 8 * (int64_t)at[4]);
#if UUV_UNIT == 16
    const uuv_halves_ high =
        uuv_two_halves_(half + 8 * (int64_t)at[8], half + 8 * (int64_t)at[12]);
    return __builtin_shufflevector(low, high, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14,
                                   15);
#else
    return low;
#endif
}

/* field[f][lane] of UUV_UNIT rows; the shuffles stay within 16 bytes. */
UUV_RECORD_INLINE void uuv_transposed_(const uuv_real *records, const int32_t *at,
                                       uuv_unit_ field[8]) {
    for (int half = 0; half < 8; half += 4) {
        uuv_unit_ r[4], *f = field + half;
        for (int i = 0; i < 4; i++) r[i] = uuv_every_fourth_(records + half, at + i);
        const uuv_unit_ even01 = UUV_EVEN_(r[0], r[1]), even23 = UUV_EVEN_(r[2], r[3]);
        const uuv_unit_ odd01 = UUV_ODD_(r[0], r[1]), odd23 = UUV_ODD_(r[2], r[3]);
        f[0] = UUV_EVEN_(even01, even23);
        f[1] = UUV_EVEN_(odd01, odd23);
        f[2] = UUV_ODD_(even01, even23);
        f[3] = UUV_ODD_(odd01, odd23);
    }
}
#else
#define UUV_PICK_(a, b, i, j, k, l, m, n, o, p) \
    __builtin_shufflevector(a, b, i, j, k, l, m, n, o, p)

UUV_RECORD_INLINE uuv_unit_ uuv_row_(const uuv_real *records, int32_t at) {
    return *(const uuv_unit_ *)(const void *)(records + 8 * (int64_t)at);
}

/* field[f][lane] of 8 rows */
UUV_RECORD_INLINE void uuv_transposed_(const uuv_real *records, const int32_t *at,
                                       uuv_unit_ field[8]) {
    uuv_unit_ a[8], b[8];
    for (int i = 0; i < 8; i += 2) {
        const uuv_unit_ p = uuv_row_(records, at[i]), q = uuv_row_(records, at[i + 1]);
        a[i] = UUV_PICK_(p, q, 0, 8, 2, 10, 4, 12, 6, 14);
        a[i + 1] = UUV_PICK_(p, q, 1, 9, 3, 11, 5, 13, 7, 15);
    }
    for (int i = 0; i < 8; i += 4)
        for (int j = i; j < i + 2; j++) {
            b[j] = UUV_PICK_(a[j], a[j + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            b[j + 2] = UUV_PICK_(a[j], a[j + 2], 2, 3, 10, 11, 6, 7, 14, 15);
        }
    for (int i = 0; i < 4; i++) {
        field[i] = UUV_PICK_(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
        field[i + 4] = UUV_PICK_(b[i], b[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
    }
}
#endif

/* field[f]: number f of the records `at` */
UUV_RECORD_INLINE void uuv_lane_fields(const uuv_real *records, const uuv_lane_places *at,
                                       V field[8]) {
    for (int unit = 0; unit < UUV_W / UUV_UNIT; unit++) {
        uuv_unit_ f[8];
        uuv_transposed_(records, at->lane + UUV_UNIT * unit, f);
        for (int i = 0; i < 8; i++) memcpy((uuv_unit_ *)(void *)&field[i] + unit, &f[i], sizeof f[i]);
    }
}

#else

UUV_RECORD_INLINE void uuv_lane_fields(const uuv_real *records, const uuv_lane_places *at,
                                       V field[8]) {
    union {
        V all[8];
        uuv_real lane[8][UUV_W];
    } r;
    for (int i = 0; i < UUV_W; i++)
        for (int f = 0; f < 8; f++) r.lane[f][i] = records[8 * (int64_t)at->lane[i] + f];
    memcpy(field, &r, sizeof r);
}
#endif

#endif
