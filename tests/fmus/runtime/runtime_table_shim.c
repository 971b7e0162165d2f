/* uuv_table.h over arrays, for the tests: n is a multiple of UUV_W. */
#include <stddef.h>

#include "uuv_table.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

#define ONE(name)                                                                          \
    EXPORT void name(size_t n, const double *x, const double *xs, const double *ys, int m, \
                     double *out) {                                                        \
        for (size_t i = 0; i < n; i += UUV_W)                                              \
            uuv_store(out + i, uuv_##name(uuv_load(x + i), xs, ys, m));                    \
    }
#define TWO(name)                                                                              \
    EXPORT void name(size_t n, const double *x, const double *y, const double *xs, int nx,     \
                     const double *ys, int ny, const double *zs, double *out) {                \
        for (size_t i = 0; i < n; i += UUV_W)                                                  \
            uuv_store(out + i,                                                                 \
                      uuv_##name(uuv_load(x + i), uuv_load(y + i), xs, nx, ys, ny, zs));       \
    }

ONE(table1)
ONE(table1_d)
TWO(table2)
TWO(table2_dx)
TWO(table2_dy)
