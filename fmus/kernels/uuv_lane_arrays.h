/* SPDX-License-Identifier: Apache-2.0 */
/* A generated function on arrays: argument k of environment e is at in[k] + e * stride[k] bytes.
 *
 * Included at the end of a generated `evaluate(const V *b, V *out)`, which has N_IN and N_OUT.
 * Every environment sees the same operations, so that its bits do not depend on the others.
 */
#ifndef UUV_LANE_ARRAYS_H
#define UUV_LANE_ARRAYS_H

#include "uuv_lane_component.h"

/* Results `first` to `first + count - 1` as rows of float32, one for each environment, clipped. */
typedef struct {
    int64_t first, count;
    const float *least, *greatest;
    float *rows;
    int64_t finite; /* whether all are */
} uuv_rows;

static void write_rows(uuv_rows *r, const double *out, int64_t n, int64_t e, int64_t here) {
    for (int64_t k = 0; k < r->count; k++)
        for (int64_t i = e; i < e + here; i++) {
            float x = (float)out[(r->first + k) * n + i];
            if (x - x != 0) r->finite = 0;
            if (x < r->least[k]) x = r->least[k];
            if (x > r->greatest[k]) x = r->greatest[k];
            r->rows[i * r->count + k] = x;
        }
}

/* Result k of environment e goes to out[k * n + e]; rows are written if they are not 0. */
UUV_KERNEL_API void uuv_evaluate(const char *const *in, const int64_t *stride, double *out,
                                 int64_t n, uuv_rows *rows) {
    for (int64_t e = 0; e < n; e += UUV_W) {
        const int64_t here = n - e < UUV_W ? n - e : UUV_W;
        V b[N_IN + 1], results[N_OUT + 1];
        double lanes[UUV_W];
        for (uint32_t k = 0; k < N_IN; k++) {
            const char *first = in[k] + e * stride[k];
            if (stride[k] == sizeof(double) && here == UUV_W) {
                b[k] = uuv_load((const double *)(const void *)first);
                continue;
            }
            for (int64_t i = 0; i < UUV_W; i++) /* lanes without an environment repeat the last */
                memcpy(&lanes[i], first + (i < here ? i : here - 1) * stride[k], sizeof(double));
            b[k] = uuv_load(lanes);
        }
        evaluate(b, results);
        for (uint32_t k = 0; k < N_OUT; k++) {
            uuv_store(lanes, results[k]);
            memcpy(out + k * n + e, lanes, (size_t)here * sizeof(double));
        }
        if (rows) write_rows(rows, out, n, e, here);
    }
}

#endif
