/* SPDX-License-Identifier: Apache-2.0 */
/* Linear tables on lanes whose intervals are found by buckets; see kernels/table_text.py.
 *
 * A record holds what an interval needs: its first knot, then for one row of the table, or two
 * neighbouring ones, the value there and the slope. The last record is that of the last knot.
 */
#ifndef UUV_LANE_RECORD_H
#define UUV_LANE_RECORD_H

#include "uuv_lane_words.h"

#define UUV_RECORD_INLINE static inline __attribute__((always_inline))

/* A bucket: the last knot before it, and the one knot inside it, or NaN. */
typedef struct {
    uuv_real begin, inside;
} uuv_lane_bucket;

typedef struct {
    uuv_real first, last, scale; /* scale: buckets a unit */
    int n, n_buckets, corrections; /* more than one: buckets may hold several knots */
    const uuv_lane_bucket *buckets;
    const uuv_real *next, *knots; /* next[i]: knot i + 1; NaN after the last */
} uuv_lane_grid;

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

/* Rows of memory become lanes in registers: groups of 8 rows are transposed. */
#if UUV_W % 8 == 0 && (defined(__clang__) || __GNUC__ >= 12)
#if defined(UUV_FLOAT32) && UUV_W % 16 == 0
#define UUV_UNIT 16
#define UUV_IN_(i) ((i) < 8 ? (i) : (i) + 8)
#define UUV_PICK_(a, b, i, j, k, l, m, n, o, p)                                             \
    __builtin_shufflevector(a, b, UUV_IN_(i), UUV_IN_(j), UUV_IN_(k), UUV_IN_(l), UUV_IN_(m), \
                            UUV_IN_(n), UUV_IN_(o), UUV_IN_(p), UUV_IN_(i) + 8,               \
                            UUV_IN_(j) + 8, UUV_IN_(k) + 8, UUV_IN_(l) + 8, UUV_IN_(m) + 8,   \
                            UUV_IN_(n) + 8, UUV_IN_(o) + 8, UUV_IN_(p) + 8)
#else
#define UUV_UNIT 8
#define UUV_PICK_(a, b, i, j, k, l, m, n, o, p) \
    __builtin_shufflevector(a, b, i, j, k, l, m, n, o, p)
#endif
typedef uuv_real uuv_row_ __attribute__((vector_size(8 * sizeof(uuv_real))));
typedef uuv_real uuv_unit_ __attribute__((vector_size(UUV_UNIT * sizeof(uuv_real))));

UUV_RECORD_INLINE uuv_unit_ uuv_rows_(const uuv_real *records, const int32_t *at, int row) {
    const uuv_row_ first = *(const uuv_row_ *)(const void *)(records + 8 * (int64_t)at[row]);
#if UUV_UNIT == 16
    const uuv_row_ second = *(const uuv_row_ *)(const void *)(records + 8 * (int64_t)at[row + 8]);
    return __builtin_shufflevector(first, second, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13,
                                   14, 15);
#else
    return first;
#endif
}

/* field[f]: number f of the records `at` */
UUV_RECORD_INLINE void uuv_lane_fields(const uuv_real *records, const uuv_lane_places *at,
                                       V field[8]) {
    for (int unit = 0; unit < UUV_W / UUV_UNIT; unit++) {
        uuv_unit_ a[8], b[8], f[8];
        for (int i = 0; i < 8; i += 2) {
            const uuv_unit_ p = uuv_rows_(records, at->lane + UUV_UNIT * unit, i);
            const uuv_unit_ q = uuv_rows_(records, at->lane + UUV_UNIT * unit, i + 1);
            a[i] = UUV_PICK_(p, q, 0, 8, 2, 10, 4, 12, 6, 14);
            a[i + 1] = UUV_PICK_(p, q, 1, 9, 3, 11, 5, 13, 7, 15);
        }
        for (int i = 0; i < 8; i += 4) {
            b[i] = UUV_PICK_(a[i], a[i + 2], 0, 1, 8, 9, 4, 5, 12, 13);
            b[i + 1] = UUV_PICK_(a[i + 1], a[i + 3], 0, 1, 8, 9, 4, 5, 12, 13);
            b[i + 2] = UUV_PICK_(a[i], a[i + 2], 2, 3, 10, 11, 6, 7, 14, 15);
            b[i + 3] = UUV_PICK_(a[i + 1], a[i + 3], 2, 3, 10, 11, 6, 7, 14, 15);
        }
        for (int i = 0; i < 4; i++) {
            f[i] = UUV_PICK_(b[i], b[i + 4], 0, 1, 2, 3, 8, 9, 10, 11);
            f[i + 4] = UUV_PICK_(b[i], b[i + 4], 4, 5, 6, 7, 12, 13, 14, 15);
        }
        for (int i = 0; i < 8; i++) memcpy((uuv_unit_ *)(void *)&field[i] + unit, &f[i], sizeof f[i]);
    }
}

#if defined(UUV_FLOAT32) /* two floats are moved as one */
typedef uint64_t uuv_pairs_ __attribute__((vector_size(UUV_UNIT * sizeof(uuv_real))));
#endif

/* What the buckets `at` hold. */
UUV_RECORD_INLINE void uuv_lane_buckets(const uuv_lane_bucket *buckets, const uuv_lane_places *at,
                                        V *begin, V *inside) {
    for (int unit = 0; unit < UUV_W / UUV_UNIT; unit++) {
        const int32_t *place = at->lane + UUV_UNIT * unit;
        uuv_unit_ half[2], field[2];
        for (int h = 0; h < 2; h++) {
#if defined(UUV_FLOAT32)
            uuv_pairs_ pairs = {0};
            for (int i = 0; i < UUV_UNIT / 2; i++) {
                uint64_t pair;
                memcpy(&pair, buckets + place[h * UUV_UNIT / 2 + i], sizeof pair);
                pairs[i] = pair;
            }
            half[h] = (uuv_unit_)pairs;
#else
            typedef uuv_real two __attribute__((vector_size(2 * sizeof(uuv_real))));
            two p[4];
            for (int i = 0; i < 4; i++)
                memcpy(&p[i], buckets + place[4 * h + i], sizeof p[i]);
            half[h] = __builtin_shufflevector(
                __builtin_shufflevector(p[0], p[1], 0, 1, 2, 3),
                __builtin_shufflevector(p[2], p[3], 0, 1, 2, 3), 0, 1, 2, 3, 4, 5, 6, 7);
#endif
        }
#if UUV_UNIT == 16
        field[0] = __builtin_shufflevector(half[0], half[1], 0, 2, 4, 6, 8, 10, 12, 14, 16, 18, 20,
                                           22, 24, 26, 28, 30);
        field[1] = __builtin_shufflevector(half[0], half[1], 1, 3, 5, 7, 9, 11, 13, 15, 17, 19, 21,
                                           23, 25, 27, 29, 31);
#else
        field[0] = __builtin_shufflevector(half[0], half[1], 0, 2, 4, 6, 8, 10, 12, 14);
        field[1] = __builtin_shufflevector(half[0], half[1], 1, 3, 5, 7, 9, 11, 13, 15);
#endif
        memcpy((uuv_unit_ *)(void *)begin + unit, &field[0], sizeof field[0]);
        memcpy((uuv_unit_ *)(void *)inside + unit, &field[1], sizeof field[1]);
    }
}

#else

UUV_RECORD_INLINE void uuv_lane_buckets(const uuv_lane_bucket *buckets, const uuv_lane_places *at,
                                        V *begin, V *inside) {
    union {
        V all;
        uuv_real lane[UUV_W];
    } b, i;
    for (int lane = 0; lane < UUV_W; lane++) {
        b.lane[lane] = buckets[at->lane[lane]].begin;
        i.lane[lane] = buckets[at->lane[lane]].inside;
    }
    *begin = b.all;
    *inside = i.all;
}

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

/* Of each lane the last knot not above x; the first one where there is none or x is NaN. */
UUV_RECORD_INLINE uuv_lane_places uuv_lane_place_(V x, const uuv_lane_grid *g) {
    V begin, inside;
    const V bucket = (x - uuv_const(g->first)) * uuv_const(g->scale);
    const V most = uuv_const((uuv_real)(g->n_buckets - 1));
    const V low = uuv_keep(uuv_mask_gt(bucket, uuv_const(0)), bucket);
    const uuv_lane_places in = uuv_lane_whole(uuv_select(uuv_mask_lt(low, most), low, most));
    uuv_lane_buckets(g->buckets, &in, &begin, &inside);
    const V more = uuv_keep(uuv_mask_le(inside, x), uuv_const(1));
    const uuv_mask at_end = uuv_mask_le(uuv_const(g->last), x);
    const V k = uuv_select(at_end, uuv_const((uuv_real)(g->n - 1)), begin + more);
    uuv_lane_places at = uuv_lane_whole(k);
    if (g->corrections > 1)
        for (int i = 0; i < UUV_W; i++)
            for (int j = 1; j < g->corrections; j++)
                at.lane[i] += g->next[at.lane[i]] <= uuv_lane(x, i);
    return at;
}

/* x within the grid less the knot below it; 0 outside. */
UUV_RECORD_INLINE V uuv_lane_beyond_(V x, V from, const uuv_lane_grid *g) {
    const uuv_mask out = uuv_mask_lt(x, uuv_const(g->first)) | uuv_mask_le(uuv_const(g->last), x);
    return uuv_select(out, uuv_const(0), x - from);
}

/* The slope within the grid, 0 outside; NaN where x is. */
UUV_RECORD_INLINE V uuv_lane_inside_(V x, V slope, const uuv_lane_grid *g) {
    const uuv_mask in =
        uuv_mask_le(uuv_const(g->first), x) & uuv_mask_lt(x, uuv_const(g->last));
    return uuv_select(uuv_mask_nan(x), x, uuv_keep(in, slope));
}

enum { UUV_VALUE, UUV_BY_X, UUV_BY_Y };

UUV_RECORD_INLINE V uuv_lane_record1(V x, const uuv_lane_grid *gx, const uuv_real *records,
                                     int what) {
    V r[8]; /* knot, value, slope */
    const uuv_lane_places at = uuv_lane_place_(x, gx);
    uuv_lane_fields(records, &at, r);
    if (what == UUV_BY_X) return uuv_lane_inside_(x, r[2], gx);
    return r[1] + uuv_lane_beyond_(x, r[0], gx) * r[2];
}

UUV_RECORD_INLINE V uuv_lane_record2(V x, V y, const uuv_lane_grid *gx, const uuv_lane_grid *gy,
                                     const uuv_real *records, int what) {
    V r[8]; /* knot, value and slope of a row, of the next row */
    V from = uuv_const(gy->first), to = uuv_const(gy->last);
    uuv_lane_places at = uuv_lane_place_(x, gx);
    if (gy->n > 2) {
        union {
            V all;
            uuv_real lane[UUV_W];
        } knot, next;
        const uuv_lane_places row = uuv_lane_place_(y, gy);
        for (int i = 0; i < UUV_W; i++) {
            const int32_t j = row.lane[i] < gy->n - 1 ? row.lane[i] : gy->n - 2;
            at.lane[i] += j * gx->n;
            knot.lane[i] = gy->knots[j], next.lane[i] = gy->knots[j + 1];
        }
        from = knot.all, to = next.all;
    }
    uuv_lane_fields(records, &at, r);
    const V beyond = uuv_lane_beyond_(x, r[0], gx);
    const int by_x = what == UUV_BY_X;
    const V p = by_x ? uuv_lane_inside_(x, r[2], gx) : r[1] + beyond * r[2];
    const V q = by_x ? uuv_lane_inside_(x, r[4], gx) : r[3] + beyond * r[4];
    const V slope = (q - p) / (to - from);
    if (what == UUV_BY_Y) return uuv_lane_inside_(y, slope, gy);
    const V up = uuv_select(uuv_mask_lt(y, uuv_const(gy->first)), uuv_const(0), y - from);
    return uuv_select(uuv_mask_le(uuv_const(gy->last), y), q, p + up * slope);
}

#if defined(UUV_FLOAT32)

/* float32: a bucket is a record itself: the knot inside, and for each of two rows the value there
 * and the slopes on both sides. Bends are exact; only the rounding differs from uuv_lane_record. */
UUV_RECORD_INLINE V uuv_lane_bend_(V beyond, V value, V below, V above) {
    const uuv_mask left = uuv_mask_lt(beyond, uuv_const(0));
    return value + beyond * uuv_select(left, below, above);
}

UUV_RECORD_INLINE V uuv_lane_bent(V x, V y, const uuv_lane_grid *gx, const uuv_lane_grid *gy,
                                  const uuv_real *records) {
    V r[8];
    const V first = uuv_const(gx->first), last = uuv_const(gx->last);
    const V most = uuv_const((uuv_real)(gx->n_buckets - 1));
    const V above = uuv_select(uuv_mask_gt(x, first), x, first);
    const V in = uuv_select(uuv_mask_lt(above, last), above, last);
    const V bucket = (in - first) * uuv_const(gx->scale);
    const uuv_lane_places at = uuv_lane_whole(uuv_select(uuv_mask_lt(bucket, most), bucket, most));
    uuv_lane_fields(records, &at, r);
    const V beyond = uuv_select(uuv_mask_nan(x), x, in - r[0]);
    const V p = uuv_lane_bend_(beyond, r[1], r[2], r[3]);
    if (!gy) return p;
    const V q = uuv_lane_bend_(beyond, r[4], r[5], r[6]);
    const V low = uuv_const(gy->first), high = uuv_const(gy->last);
    const V up = uuv_select(uuv_mask_lt(y, low), uuv_const(0),
                            uuv_select(uuv_mask_lt(high, y), high - low, y - low));
    return p + up * ((q - p) * uuv_const(1.0f / (gy->last - gy->first)));
}

#endif

#endif
