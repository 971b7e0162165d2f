/* SPDX-License-Identifier: Apache-2.0 */
/* Linear tables of one row or two on lanes, read without a search: by lines, by breakpoints. */
#ifndef UUV_LANE_LINES_H
#define UUV_LANE_LINES_H

#include "uuv_lane_rows.h"

/* A table of one row or two by its breakpoints: see models/intrinsics/breakpoints.py. A bucket's record holds of each row
 * a knot, the value there and the slopes on both sides. */
typedef struct {
    uuv_real first, last, scale, low, high;
    const uuv_real *records;
} uuv_lane_breakpoints;

/* x within the grid, and the records of its buckets; the first knot and its bucket for NaN. */
UUV_RECORD_INLINE V uuv_lane_breakpoints_(V x, const uuv_lane_breakpoints *t, V field[8]) {
    const V first = uuv_const(t->first), last = uuv_const(t->last);
    const V above = uuv_select(uuv_mask_lt(first, x), x, first);
    const V in = uuv_select(uuv_mask_lt(above, last), above, last);
    const uuv_lane_places at = uuv_lane_whole((in - first) * uuv_const(t->scale));
    uuv_lane_fields(t->records, &at, field);
    return in;
}

UUV_RECORD_INLINE V uuv_lane_bend_(V in, const V row[4]) {
    const V beyond = in - row[0];
    return row[1] + beyond * uuv_select(uuv_mask_lt(beyond, uuv_const(0)), row[2], row[3]);
}

UUV_RECORD_INLINE V uuv_lane_buckets1(V x, const uuv_lane_breakpoints *t) {
    V r[8];
    const V in = uuv_lane_breakpoints_(x, t, r);
    return uuv_select(uuv_mask_nan(x), x, uuv_lane_bend_(in, r));
}

/* Between rows p at y = low and q at y = high, and held beyond. */
UUV_RECORD_INLINE V uuv_lane_between_(V x, V y, V p, V q, uuv_real from, uuv_real to) {
    const V low = uuv_const(from), high = uuv_const(to);
    const V up = uuv_select(uuv_mask_lt(y, low), uuv_const(0), y - low);
#if defined(UUV_FLOAT32)
    const V slope = (q - p) * uuv_const(1.0f / (to - from));
#else
    const V slope = (q - p) / (high - low);
#endif
    const V value = uuv_select(uuv_mask_le(high, y), q, p + up * slope);
    return uuv_select(uuv_mask_nan(x), x, value);
}

UUV_RECORD_INLINE V uuv_lane_buckets2(V x, V y, const uuv_lane_breakpoints *t) {
    V r[8];
    const V in = uuv_lane_breakpoints_(x, t, r);
    const V p = uuv_lane_bend_(in, r), q = uuv_lane_bend_(in, r + 4);
    return uuv_lane_between_(x, y, p, q, t->low, t->high);
}

/* Lines of equal length: see models/intrinsics/uniform_grids.py. A record holds value and slope of one row or two, of
 * one table or two over the same grid. */
typedef struct {
    uuv_real first, last, scale, start, per_unit, low, high;
    const uuv_real *records;
} uuv_lane_lines;

typedef struct {
    V first, second;
} uuv_lane_pair;

/* How far x within the grid is beyond its line's begin, and the records. */
UUV_RECORD_INLINE V uuv_lane_line_(V x, const uuv_lane_lines *t, V field[8]) {
    const V first = uuv_const(t->first), last = uuv_const(t->last);
    const V above = uuv_select(uuv_mask_lt(first, x), x, first);
    const V in = uuv_select(uuv_mask_lt(above, last), above, last);
    const V place = (in - first) * uuv_const(t->scale);
    const uuv_lane_places at = uuv_lane_whole(place);
    uuv_lane_fields(t->records, &at, field);
    const V k = uuv_truncated(place);
#if defined(UUV_FLOAT32)
    return in - (k + uuv_const(t->start)) * uuv_const(1.0f / t->per_unit);
#else
    return in - (k + uuv_const(t->start)) / uuv_const(t->per_unit);
#endif
}

UUV_RECORD_INLINE V uuv_lane_uniform1(V x, const uuv_lane_lines *t) {
    V r[8];
    const V beyond = uuv_lane_line_(x, t, r);
    return uuv_select(uuv_mask_nan(x), x, r[0] + beyond * r[1]);
}

UUV_RECORD_INLINE V uuv_lane_uniform2(V x, V y, const uuv_lane_lines *t) {
    V r[8];
    const V beyond = uuv_lane_line_(x, t, r);
    return uuv_lane_between_(x, y, r[0] + beyond * r[1], r[2] + beyond * r[3], t->low, t->high);
}

UUV_RECORD_INLINE uuv_lane_pair uuv_lane_uniform2_pair(V x, V y, const uuv_lane_lines *t) {
    V r[8];
    uuv_lane_pair two;
    const V beyond = uuv_lane_line_(x, t, r);
    two.first =
        uuv_lane_between_(x, y, r[0] + beyond * r[1], r[2] + beyond * r[3], t->low, t->high);
    two.second =
        uuv_lane_between_(x, y, r[4] + beyond * r[5], r[6] + beyond * r[7], t->low, t->high);
    return two;
}

#endif
