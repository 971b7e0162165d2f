/* SPDX-License-Identifier: Apache-2.0 */
/* The tables of fmus/runtime/uuv_table.h on many lanes: the same values from the same operations,
 * but the interval is found in all lanes at once, by counting the knots that are not above x.
 */
#ifndef UUV_LANE_TABLE_H
#define UUV_LANE_TABLE_H

#include "uuv_math.h"

#if UUV_W == 1
#include "uuv_table.h"
#else

#define UUV_LANE_INLINE static inline __attribute__((always_inline))

enum { UUV_LANE_COUNTED = 96 }; /* more knots than this are bisected, lane by lane */

typedef union {
    uuv_bits all;
    uint64_t lane[UUV_W];
} uuv_lane_index_;

typedef struct {
    uuv_lane_index_ lower; /* of the last knot not above x, the last but one at most */
    V offset, width;
    uuv_mask at_end, inside;
} uuv_lane_interval_;

UUV_LANE_INLINE V uuv_lane_gather_(const uuv_real *values, uuv_lane_index_ index) {
    union {
        V all;
        uuv_real lane[UUV_W];
    } r;
    for (int i = 0; i < UUV_W; i++) r.lane[i] = values[index.lane[i]];
    return r.all;
}

UUV_LANE_INLINE uuv_lane_index_ uuv_lane_lower_(V x, const uuv_real *knots, int n) {
    uuv_lane_index_ r = {uuv_const_bits(0)};
    if (n <= UUV_LANE_COUNTED) {
        for (int i = 1; i < n - 1; i++) r.all -= uuv_mask_le(uuv_const(knots[i]), x);
        return r;
    }
    for (int i = 0; i < UUV_W; i++)
        for (int count = n - 1; count > 1;) {
            const int half = count / 2;
            const int above = knots[r.lane[i] + (uint64_t)half] <= uuv_lane(x, i);
            r.lane[i] += above ? (uint64_t)half : 0;
            count -= half;
        }
    return r;
}

UUV_LANE_INLINE uuv_lane_interval_ uuv_lane_interval_of_(V x, const uuv_real *knots, int n) {
    uuv_lane_interval_ r;
    const V first = uuv_const(knots[0]), last = uuv_const(knots[n - 1]);
    r.lower = uuv_lane_lower_(x, knots, n);
    const V from = uuv_lane_gather_(knots, r.lower);
    r.width = uuv_lane_gather_(knots + 1, r.lower) - from;
    r.at_end = uuv_mask_le(last, x);
    r.inside = uuv_mask_le(first, x) & ~r.at_end & ~uuv_mask_nan(x);
    r.offset = uuv_select(uuv_mask_lt(x, first), uuv_const(0.0), x - from);
    return r;
}

UUV_LANE_INLINE V uuv_lane_slope_(uuv_lane_interval_ at, V a, V b) {
    const V slope = uuv_keep(at.inside, (b - a) / at.width);
    return uuv_select(uuv_mask_nan(at.offset), at.offset, slope);
}

UUV_LANE_INLINE V uuv_lane_between_(uuv_lane_interval_ at, V a, V b) {
    return uuv_select(at.at_end, b, a + at.offset * ((b - a) / at.width));
}

UUV_LANE_INLINE V uuv_table1(V x, const uuv_real *xs, const uuv_real *ys, int n) {
    const uuv_lane_interval_ at = uuv_lane_interval_of_(x, xs, n);
    return uuv_lane_between_(at, uuv_lane_gather_(ys, at.lower), uuv_lane_gather_(ys + 1, at.lower));
}

UUV_LANE_INLINE V uuv_table1_d(V x, const uuv_real *xs, const uuv_real *ys, int n) {
    const uuv_lane_interval_ at = uuv_lane_interval_of_(x, xs, n);
    return uuv_lane_slope_(at, uuv_lane_gather_(ys, at.lower), uuv_lane_gather_(ys + 1, at.lower));
}

/* The corners of a cell: z[row][column], rows along y. */
typedef struct {
    uuv_lane_interval_ x, y;
    V z[2][2];
} uuv_lane_cell_;

UUV_LANE_INLINE uuv_lane_cell_ uuv_lane_cell_of_(V x, V y, const uuv_real *xs, int nx,
                                                 const uuv_real *ys, int ny, const uuv_real *zs) {
    uuv_lane_cell_ r;
    r.x = uuv_lane_interval_of_(x, xs, nx);
    r.y = uuv_lane_interval_of_(y, ys, ny);
    uuv_lane_index_ at;
    for (int i = 0; i < UUV_W; i++)
        at.lane[i] = r.y.lower.lane[i] * (uint64_t)nx + r.x.lower.lane[i];
    r.z[0][0] = uuv_lane_gather_(zs, at);
    r.z[0][1] = uuv_lane_gather_(zs + 1, at);
    r.z[1][0] = uuv_lane_gather_(zs + nx, at);
    r.z[1][1] = uuv_lane_gather_(zs + nx + 1, at);
    return r;
}

UUV_LANE_INLINE V uuv_table2(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                             const uuv_real *zs) {
    const uuv_lane_cell_ c = uuv_lane_cell_of_(x, y, xs, nx, ys, ny, zs);
    return uuv_lane_between_(c.y, uuv_lane_between_(c.x, c.z[0][0], c.z[0][1]),
                             uuv_lane_between_(c.x, c.z[1][0], c.z[1][1]));
}

UUV_LANE_INLINE V uuv_table2_dx(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                                const uuv_real *zs) {
    const uuv_lane_cell_ c = uuv_lane_cell_of_(x, y, xs, nx, ys, ny, zs);
    return uuv_lane_between_(c.y, uuv_lane_slope_(c.x, c.z[0][0], c.z[0][1]),
                             uuv_lane_slope_(c.x, c.z[1][0], c.z[1][1]));
}

UUV_LANE_INLINE V uuv_table2_dy(V x, V y, const uuv_real *xs, int nx, const uuv_real *ys, int ny,
                                const uuv_real *zs) {
    const uuv_lane_cell_ c = uuv_lane_cell_of_(x, y, xs, nx, ys, ny, zs);
    return uuv_lane_slope_(c.y, uuv_lane_between_(c.x, c.z[0][0], c.z[0][1]),
                           uuv_lane_between_(c.x, c.z[1][0], c.z[1][1]));
}

#endif
#endif
