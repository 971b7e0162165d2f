/* Many rays, many heights, for arrays that the caller owns: uuvsim_cosim/scene/shared/ray_casting.py. */
#include "uuv_cast.h"

#if defined(_WIN32)
#define CAST_API __declspec(dllexport)
#else
#define CAST_API __attribute__((visibility("default")))
#endif

/* Ray k begins at origins + 3 k, or all at `origins` where `common`. */
CAST_API void uuv_cast_batch(const uuv_scene *s, const double *origins, int common,
                             const double *directions, double far, int64_t n, double *range,
                             int32_t *kind) {
    for (int64_t k = 0; k < n; k++) {
        uuv_hit hit;
        kind[k] = uuv_cast(s, 0, 0, origins + (common ? 0 : 3 * k), directions + 3 * k, far, &hit);
        range[k] = kind[k] ? hit.t : __builtin_inf();
    }
}

CAST_API void uuv_height_batch(const uuv_scene *s, const double *north, const double *east,
                               int64_t n, double *z) {
    for (int64_t k = 0; k < n; k++) z[k] = uuv_height(&s->terrain, north[k], east[k]);
}
