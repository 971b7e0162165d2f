/* SPDX-License-Identifier: Apache-2.0 */
/* Fields on a grid of four axes: linear between nodes along each of them, lane by lane in double.
 *
 * Nodes lie [axis 0][axis 1][axis 2][axis 3][value]. Axis 3 is reduced first, then 2, 1 and 0:
 * a + share (b - a). A held axis keeps the value of its end beyond it; beyond any other is NaN.
 */
#ifndef UUV_FIELD_H
#define UUV_FIELD_H

#if defined(UUV_FLOAT32)
#include "uuv_float_math.h"
#else
#include "uuv_math.h"
#endif

#define UUV_FIELD_AXES 4
#define UUV_FIELD_VALUES 4 /* at most */

typedef struct {
    const double *grid[UUV_FIELD_AXES];
    int n[UUV_FIELD_AXES], held[UUV_FIELD_AXES];
    int n_values;
    const float *nodes;
} uuv_field;

static inline V uuv_field_set_(V x, int lane, double value) {
#if defined(UUV_FLOAT32)
    x[lane] = (float)value;
    return x;
#else
    return uuv_with_lane(x, lane, value);
#endif
}

/* The node below and above, the share of that above, their distance; `varies` where not held. */
typedef struct {
    int low, high, varies;
    double share, width;
} uuv_field_place_;

static inline uuv_field_place_ uuv_field_find_(const double *grid, int n, int held, double at) {
    uuv_field_place_ r = {0, n > 1 ? 1 : 0, 0, 0.0, 1.0};
    const int outside = !(grid[0] <= at && at <= grid[n - 1]);
    if (outside && (at != at || !held)) {
        r.share = __builtin_nan("");
        r.varies = 1;
        return r;
    }
    if (n == 1) return r;
    if (at < grid[0]) at = grid[0];
    if (at > grid[n - 1]) at = grid[n - 1];
    int lower = 0;
    for (int count = n - 1; count > 1;) {
        const int half = count / 2;
        lower += grid[lower + half] <= at ? half : 0;
        count -= half;
    }
    r.low = lower;
    r.high = lower + 1;
    r.varies = !outside;
    r.width = grid[lower + 1] - grid[lower];
    r.share = (at - grid[lower]) / r.width;
    return r;
}

/* Between the 16 nodes around; along axis `slope` the difference of both ends instead. */
static inline void uuv_field_reduce_(const uuv_field *f, const uuv_field_place_ *p, int slope,
                                     double *out) {
    double block[1 << UUV_FIELD_AXES][UUV_FIELD_VALUES];
    for (int corner = 0; corner < 1 << UUV_FIELD_AXES; corner++) {
        int64_t node = 0;
        for (int i = 0; i < UUV_FIELD_AXES; i++) {
            const int above = corner >> (UUV_FIELD_AXES - 1 - i) & 1;
            node = node * f->n[i] + (above ? p[i].high : p[i].low);
        }
        for (int j = 0; j < f->n_values; j++)
            block[corner][j] = (double)f->nodes[node * f->n_values + j];
    }
    for (int i = UUV_FIELD_AXES - 1, count = 1 << (UUV_FIELD_AXES - 1); i >= 0; i--, count /= 2)
        for (int k = 0; k < count; k++)
            for (int j = 0; j < f->n_values; j++) {
                const double a = block[2 * k][j], rise = block[2 * k + 1][j] - a;
                block[k][j] = i == slope ? rise + 0.0 * p[i].share : a + p[i].share * rise;
            }
    for (int j = 0; j < f->n_values; j++) out[j] = block[0][j];
}

static inline void uuv_field_find_all_(const uuv_field *f, const V *x, int lane,
                                       uuv_field_place_ *p) {
    for (int i = 0; i < UUV_FIELD_AXES; i++)
        p[i] = uuv_field_find_(f->grid[i], f->n[i], f->held[i], (double)uuv_lane(x[i], lane));
}

/* out[n_values] at x[4] */
static inline void uuv_field_at(const uuv_field *f, const V *x, V *out) {
    for (int j = 0; j < f->n_values; j++) out[j] = uuv_const(0.0);
    for (int lane = 0; lane < UUV_W; lane++) {
        uuv_field_place_ p[UUV_FIELD_AXES];
        double value[UUV_FIELD_VALUES];
        uuv_field_find_all_(f, x, lane, p);
        uuv_field_reduce_(f, p, -1, value);
        for (int j = 0; j < f->n_values; j++) out[j] = uuv_field_set_(out[j], lane, value[j]);
    }
}

/* out = d field / d x  seed */
static inline void uuv_field_at_forward(const uuv_field *f, const V *x, const V *seed, V *out) {
    for (int j = 0; j < f->n_values; j++) out[j] = uuv_const(0.0);
    for (int lane = 0; lane < UUV_W; lane++) {
        uuv_field_place_ p[UUV_FIELD_AXES];
        double slope[UUV_FIELD_VALUES], total[UUV_FIELD_VALUES] = {0.0};
        uuv_field_find_all_(f, x, lane, p);
        for (int i = 0; i < UUV_FIELD_AXES; i++) {
            if (!p[i].varies) continue;
            uuv_field_reduce_(f, p, i, slope);
            for (int j = 0; j < f->n_values; j++)
                total[j] += slope[j] / p[i].width * (double)uuv_lane(seed[i], lane);
        }
        for (int j = 0; j < f->n_values; j++) out[j] = uuv_field_set_(out[j], lane, total[j]);
    }
}

#endif
