/* SPDX-License-Identifier: Apache-2.0 */
/* Tables: linear between knots in one and two dimensions, held at the ends; and their slopes.
 *
 * Knots increase strictly; there are two or more. Outside of its knots an argument counts as the
 * nearest knot, so the slope is 0 there. At a knot the slope is that to its right. NaN gives NaN.
 * Tables of one row or two are read without a search: uuv_uniform (models/intrinsics/uniform_grids.py), uuv_buckets
 * (models/intrinsics/breakpoints.py).
 */
#ifndef UUV_TABLE_H
#define UUV_TABLE_H

#include "uuv_math.h"

/* Where x lies: `offset` beyond the knot below it, in an interval of a width. */
typedef struct {
    int lower[UUV_W], upper[UUV_W];
    V offset, width;
    uuv_mask at_end; /* at the last knot or held there */
    uuv_mask inside; /* first knot <= x < last knot: the table has a slope */
} uuv_interval_;

static inline V uuv_gather_(const uuv_real *values, const int *index) {
    V r = uuv_const(0.0);
    for (int i = 0; i < UUV_W; i++) r = uuv_with_lane(r, i, values[index[i]]);
    return r;
}

static inline uuv_interval_ uuv_find_interval_(V x, const uuv_real *knots, int n) {
    uuv_interval_ r;
    for (int i = 0; i < UUV_W; i++) {
        const uuv_real value = uuv_lane(x, i);
        int lower = 0; /* the last knot not above x, the last but one at most */
        for (int count = n - 1; count > 1;) {
            const int half = count / 2;
            lower += knots[lower + half] <= value ? half : 0;
            count -= half;
        }
        r.lower[i] = lower;
        r.upper[i] = lower + 1;
    }
    const V first = uuv_const(knots[0]), last = uuv_const(knots[n - 1]);
    r.inside = uuv_mask_le(first, x) & uuv_mask_lt(x, last);
    const V from = uuv_gather_(knots, r.lower);
    r.width = uuv_gather_(knots, r.upper) - from;
    r.at_end = uuv_mask_le(last, x);
    r.offset = uuv_select(uuv_mask_lt(x, first), uuv_const(0.0), x - from);
    return r;
}

static inline V uuv_slope_(uuv_interval_ at, V a, V b) {
    const V slope = uuv_keep(at.inside, (b - a) / at.width);
    return uuv_select(uuv_mask_nan(at.offset), at.offset, slope);
}

/* Linear from a at the knot below to b at the knot above, exactly a and b there. */
static inline V uuv_between_(uuv_interval_ at, V a, V b) {
    return uuv_select(at.at_end, b, a + at.offset * ((b - a) / at.width));
}

/* ys[i] at xs[i], i = 0 ... n - 1 */
static inline V uuv_table1(V x, const uuv_real *xs, const uuv_real *ys, int n) {
    const uuv_interval_ at = uuv_find_interval_(x, xs, n);
    return uuv_between_(at, uuv_gather_(ys, at.lower), uuv_gather_(ys, at.upper));
}

/* Derivative of uuv_table1 by x. */
static inline V uuv_table1_d(V x, const uuv_real *xs, const uuv_real *ys, int n) {
    const uuv_interval_ at = uuv_find_interval_(x, xs, n);
    return uuv_slope_(at, uuv_gather_(ys, at.lower), uuv_gather_(ys, at.upper));
}

/* The four corners of a cell: z[row][column], rows along y. */
typedef struct {
    V z[2][2];
} uuv_cell_;

static inline uuv_cell_ uuv_find_cell_(uuv_interval_ x, uuv_interval_ y, const uuv_real *zs,
                                       int nx) {
    uuv_cell_ r;
    for (int row = 0; row < 2; row++)
        for (int column = 0; column < 2; column++) {
            int index[UUV_W];
            for (int i = 0; i < UUV_W; i++)
                index[i] = (row ? y.upper[i] : y.lower[i]) * nx +
                           (column ? x.upper[i] : x.lower[i]);
            r.z[row][column] = uuv_gather_(zs, index);
        }
    return r;
}

/* Row j of zs, nx long, is a table over xs that holds at ys[j]: zs[j nx + i] at xs[i], ys[j].
 * Linear between rows, hence bilinear in each cell. */
static inline V uuv_table2(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                           const uuv_real *zs) {
    const uuv_interval_ at_x = uuv_find_interval_(x, xs, nx), at_y = uuv_find_interval_(y, ys, ny);
    const uuv_cell_ c = uuv_find_cell_(at_x, at_y, zs, nx);
    return uuv_between_(at_y, uuv_between_(at_x, c.z[0][0], c.z[0][1]),
                        uuv_between_(at_x, c.z[1][0], c.z[1][1]));
}

/* Derivative of uuv_table2 by x. */
static inline V uuv_table2_dx(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                              const uuv_real *zs) {
    const uuv_interval_ at_x = uuv_find_interval_(x, xs, nx), at_y = uuv_find_interval_(y, ys, ny);
    const uuv_cell_ c = uuv_find_cell_(at_x, at_y, zs, nx);
    return uuv_between_(at_y, uuv_slope_(at_x, c.z[0][0], c.z[0][1]),
                        uuv_slope_(at_x, c.z[1][0], c.z[1][1]));
}

/* Derivative of uuv_table2 by y. */
static inline V uuv_table2_dy(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                              const uuv_real *zs) {
    const uuv_interval_ at_x = uuv_find_interval_(x, xs, nx), at_y = uuv_find_interval_(y, ys, ny);
    const uuv_cell_ c = uuv_find_cell_(at_x, at_y, zs, nx);
    return uuv_slope_(at_y, uuv_between_(at_x, c.z[0][0], c.z[0][1]),
                      uuv_between_(at_x, c.z[1][0], c.z[1][1]));
}

/* Between rows p at y = low and q at y = high, and held beyond. */
static inline V uuv_rows_between_(V x, V y, V p, V q, uuv_real from, uuv_real to) {
    const V low = uuv_const(from), high = uuv_const(to);
    const V up = uuv_select(uuv_mask_lt(y, low), uuv_const(0.0), y - low);
    const V value = uuv_select(uuv_mask_le(high, y), q, p + up * ((q - p) / (high - low)));
    return uuv_select(uuv_mask_nan(x), x, value);
}

/* A knot of a row: the value there, and the slopes on both sides. */
typedef struct {
    uuv_real knot, value, below, above;
} uuv_breakpoint;

/* Equal buckets, `scale` a unit of x; each row's breakpoint for each of them. Two rows lie at y = low,
 * high. */
typedef struct {
    uuv_real first, last, scale, low, high;
    const unsigned short *at[2];
    const uuv_breakpoint *breakpoints[2];
} uuv_buckets;

static inline V uuv_buckets_row_(V x, V bucket, const unsigned short *at, const uuv_breakpoint *breakpoints) {
    V knot = x, value = x, below = x, above = x;
    for (int i = 0; i < UUV_W; i++) {
        const uuv_breakpoint *point = breakpoints + at[(int)uuv_lane(bucket, i)];
        knot = uuv_with_lane(knot, i, point->knot);
        value = uuv_with_lane(value, i, point->value);
        below = uuv_with_lane(below, i, point->below);
        above = uuv_with_lane(above, i, point->above);
    }
    const V beyond = x - knot;
    return value + beyond * uuv_select(uuv_mask_lt(beyond, uuv_const(0.0)), below, above);
}

/* x within the grid; the first knot for NaN. */
static inline V uuv_buckets_within_(V x, const uuv_buckets *t) {
    const V first = uuv_const(t->first), last = uuv_const(t->last);
    const V above = uuv_select(uuv_mask_lt(first, x), x, first);
    return uuv_select(uuv_mask_lt(above, last), above, last);
}

static inline V uuv_buckets1(V x, const uuv_buckets *t) {
    const V in = uuv_buckets_within_(x, t);
    const V bucket = (in - uuv_const(t->first)) * uuv_const(t->scale);
    return uuv_select(uuv_mask_nan(x), x, uuv_buckets_row_(in, bucket, t->at[0], t->breakpoints[0]));
}

static inline V uuv_buckets2(V x, V y, const uuv_buckets *t) {
    const V in = uuv_buckets_within_(x, t);
    const V bucket = (in - uuv_const(t->first)) * uuv_const(t->scale);
    const V p = uuv_buckets_row_(in, bucket, t->at[0], t->breakpoints[0]);
    const V q = uuv_buckets_row_(in, bucket, t->at[1], t->breakpoints[1]);
    return uuv_rows_between_(x, y, p, q, t->low, t->high);
}

/* Lines of equal length, `per_unit` in a unit of x; line k begins at (start + k) / per_unit. */
typedef struct {
    uuv_real value, slope;
} uuv_line;

typedef struct {
    uuv_real first, last, scale, start, per_unit, low, high;
    const uuv_line *lines[2];
} uuv_uniform;

static inline V uuv_uniform_row_(V x, V k, V beyond, const uuv_line *lines) {
    V value = x, slope = x;
    for (int i = 0; i < UUV_W; i++) {
        const uuv_line *line = lines + (int)uuv_lane(k, i);
        value = uuv_with_lane(value, i, line->value);
        slope = uuv_with_lane(slope, i, line->slope);
    }
    return value + beyond * slope;
}

/* k and x - x_k, of x within the grid; the first knot for NaN. */
static inline void uuv_uniform_line_(V x, const uuv_uniform *t, V *k, V *beyond) {
    const V first = uuv_const(t->first), last = uuv_const(t->last);
    const V above = uuv_select(uuv_mask_lt(first, x), x, first);
    const V in = uuv_select(uuv_mask_lt(above, last), above, last);
    const V place = (in - first) * uuv_const(t->scale);
    *k = place;
    for (int i = 0; i < UUV_W; i++) *k = uuv_with_lane(*k, i, (uuv_real)(int)uuv_lane(place, i));
    *beyond = in - (*k + uuv_const(t->start)) / uuv_const(t->per_unit);
}

static inline V uuv_uniform1(V x, const uuv_uniform *t) {
    V k, beyond;
    uuv_uniform_line_(x, t, &k, &beyond);
    return uuv_select(uuv_mask_nan(x), x, uuv_uniform_row_(x, k, beyond, t->lines[0]));
}

static inline V uuv_uniform2(V x, V y, const uuv_uniform *t) {
    V k, beyond;
    uuv_uniform_line_(x, t, &k, &beyond);
    return uuv_rows_between_(x, y, uuv_uniform_row_(x, k, beyond, t->lines[0]),
                             uuv_uniform_row_(x, k, beyond, t->lines[1]), t->low, t->high);
}

#endif
