/* SPDX-License-Identifier: Apache-2.0 */
/* Tables: linear between knots in one and two dimensions, held at the ends; and their slopes.
 *
 * Knots increase strictly; there are two or more. Outside of its knots an argument counts as the
 * nearest knot, so the slope is 0 there. At a knot the slope is that to its right. NaN gives NaN.
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

#endif
