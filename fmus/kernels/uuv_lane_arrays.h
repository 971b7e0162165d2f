/* SPDX-License-Identifier: Apache-2.0 */
/* A generated function on arrays: argument k of environment e is at in[k] + e * stride[k] bytes.
 *
 * Included at the end of a generated `evaluate(const V *b, V *out)`, which has N_IN and N_OUT.
 * Every environment sees the same operations, so that its bits do not depend on the others.
 */
#ifndef UUV_LANE_ARRAYS_H
#define UUV_LANE_ARRAYS_H

#include "uuv_lane_component.h"

/* Result k of environment e goes to out[k * n + e]. */
UUV_KERNEL_API void uuv_evaluate(const char *const *in, const int64_t *stride, double *out,
                                 int64_t n) {
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
    }
}

#endif
