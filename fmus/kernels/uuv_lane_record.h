/* SPDX-License-Identifier: Apache-2.0 */
/* Linear tables on lanes by their intervals, found by buckets; see kernels/codegen/interval_tables.py.
 *
 * A record holds what an interval needs: its first knot, then for one row of the table, or two
 * neighbouring ones, the value there and the slope. The last record is that of the last knot.
 */
#ifndef UUV_LANE_RECORD_H
#define UUV_LANE_RECORD_H

#include "uuv_lane_rows.h"

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

#if defined(UUV_UNIT)

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

#endif
