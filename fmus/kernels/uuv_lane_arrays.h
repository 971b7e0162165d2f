/* SPDX-License-Identifier: Apache-2.0 */
/* A generated function on arrays: argument k of environment e is at in[k] + e * stride[k] bytes.
 *
 * Included at the end of a generated `evaluate(const V *b, V *out)`, which has N_IN and N_OUT.
 * Every environment sees the same operations, so that its bits do not depend on the others.
 */
#ifndef UUV_LANE_ARRAYS_H
#define UUV_LANE_ARRAYS_H

#include "uuv_lane_component.h"

/* Results from `first` on as `count` columns of float32, a row for each environment, clipped. */
typedef struct {
    int64_t first, count;
    const float *least, *greatest;
    float *rows;
    int64_t finite; /* whether all are */
} uuv_rows;

typedef float uuv_floats __attribute__((vector_size(4 * UUV_W)));
typedef int32_t uuv_float_mask __attribute__((vector_size(4 * UUV_W)));

static inline void write_rows(uuv_rows *r, const V *results, int64_t e, int64_t here) {
    float lanes[N_OUT + 1][UUV_W];
    uuv_float_mask bad = {0};
    for (int64_t k = 0; k < r->count; k++) {
        uuv_floats x = __builtin_convertvector(results[r->first + k], uuv_floats);
        const uuv_floats least = r->least[k] - (uuv_floats){0};
        const uuv_floats greatest = r->greatest[k] - (uuv_floats){0};
        bad |= x - x != 0;
        uuv_float_mask out = x < least;
        x = (uuv_floats)(((uuv_float_mask)least & out) | ((uuv_float_mask)x & ~out));
        out = x > greatest;
        x = (uuv_floats)(((uuv_float_mask)greatest & out) | ((uuv_float_mask)x & ~out));
        memcpy(lanes[k], &x, sizeof x);
    }
    for (int i = 0; i < UUV_W; i++) r->finite &= !bad[i];
    float *row = r->rows + e * r->count;
    for (int64_t i = 0; i < here; i++)
        for (int64_t k = 0; k < r->count; k++) *row++ = lanes[k][i];
}

/* Result k of environment e goes to out[k * n + e], or to `rows`, if they are not 0 and have it. */
UUV_KERNEL_API void uuv_evaluate(const char *const *in, const int64_t *stride, double *out,
                                 int64_t n, uuv_rows *rows) {
    for (int64_t e = 0; e < n; e += UUV_W) {
        const int64_t here = n - e < UUV_W ? n - e : UUV_W;
        V b[N_IN + 1], results[N_OUT + 1];
        double lanes[UUV_W];
        for (uint32_t k = 0; k < N_IN; k++) {
            const char *first = in[k] + e * stride[k];
            __builtin_prefetch(first + 2 * UUV_W * stride[k], 0, 3);
            if (stride[k] == sizeof(double) && here == UUV_W) {
                b[k] = uuv_load((const double *)(const void *)first);
                continue;
            }
            for (int64_t i = 0; i < UUV_W; i++) /* lanes without an environment repeat the last */
                memcpy(&lanes[i], first + (i < here ? i : here - 1) * stride[k], sizeof(double));
            b[k] = uuv_load(lanes);
        }
        evaluate(b, results);
        const int64_t n_columns = rows ? rows->first : N_OUT;
        for (int64_t k = 0; k < n_columns; k++) {
            uuv_store(lanes, results[k]);
            memcpy(out + k * n + e, lanes, (size_t)here * sizeof(double));
        }
        if (rows) write_rows(rows, results, e, here);
    }
}

#endif
