/* SPDX-License-Identifier: Apache-2.0 */
/* Cells of all environments as rows of float64, and back.
 *
 * The cell of row k is at first[k] + i * stride[k] bytes in block i, and n numbers are in a row.
 * Included by uuv_lane_blocks.h.
 */
#ifndef UUV_LANE_EXCHANGE_H
#define UUV_LANE_EXCHANGE_H

enum { UUV_ROWS_TOGETHER = 32 }; /* blocks of which all rows are copied before those of the others */

static inline uuv_doubles doubles_of(const V *x) {
#if defined(UUV_FLOAT32) && UUV_W > 1
    return __builtin_convertvector(*x, uuv_doubles);
#else
    return *x;
#endif
}

UUV_KERNEL_API void uuv_kernel_gather(char *const *first, const int64_t *stride, uint64_t n_rows,
                                      double *rows, uint64_t n) {
    const uint64_t n_blocks = n / UUV_W;
    for (uint64_t begin = 0; begin < n_blocks; begin += UUV_ROWS_TOGETHER) {
        const uint64_t end = begin + UUV_ROWS_TOGETHER < n_blocks ? begin + UUV_ROWS_TOGETHER : n_blocks;
        for (uint64_t k = 0; k < n_rows; k++)
            for (uint64_t i = begin; i < end; i++) {
                const void *cell = first[k] + (int64_t)i * stride[k];
                const uuv_doubles x = doubles_of(cell);
                memcpy(rows + k * n + i * UUV_W, &x, sizeof x);
            }
    }
    for (uint64_t k = 0; k < n_rows && n % UUV_W; k++) { /* lanes without an environment are last */
        const void *cell = first[k] + (int64_t)n_blocks * stride[k];
        const uuv_doubles x = doubles_of(cell);
        memcpy(rows + k * n + n_blocks * UUV_W, &x, n % UUV_W * sizeof(double));
    }
}

UUV_KERNEL_API void uuv_kernel_scatter(char *const *first, const int64_t *stride, uint64_t n_rows,
                                       const double *rows, uint64_t n) {
    for (uint64_t i = 0; i * UUV_W < n; i++) {
        const uint64_t here = n - i * UUV_W < UUV_W ? n - i * UUV_W : UUV_W;
        for (uint64_t k = 0; k < n_rows; k++) {
            void *cell = first[k] + (int64_t)i * stride[k];
            uuv_doubles x = doubles_of(cell);
            memcpy(&x, rows + k * n + i * UUV_W, here * sizeof(double));
            *(V *)cell = uuv_rounded(x);
        }
    }
}

#endif
