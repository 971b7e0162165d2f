/* SPDX-License-Identifier: Apache-2.0 */
/* The draws of float32 kernels: those of float64, rounded. Compiled apart, in float64. */
#include "uuv_lane_component.h"
#include "uuv_random.h"

UUV_KERNEL_API uuv_lane_draws uuv_float_draws;

void uuv_float_draws(const uint32_t *seed0, const uint32_t *seed1, uint32_t variable,
                     const uint64_t *sample, uint32_t n, uint32_t width, float *out) {
    for (uint32_t first = 0; first < width; first += UUV_W) {
        const uint32_t some = width - first < UUV_W ? width - first : UUV_W;
        union {
            uint64_t lane[UUV_W];
            uuv_bits all;
        } key0 = {{0}}, key1 = {{0}}, index = {{0}};
        for (uint32_t i = 0; i < some; i++) {
            key0.lane[i] = seed0[first + i];
            key1.lane[i] = seed1[first + i];
            index.lane[i] = sample[first + i];
        }
        for (uint32_t j = 0; j < n; j += 2) {
            V pair[2];
            pair[0] = uuv_normal_pair_(key0.all, key1.all, variable, index.all,
                                       uuv_const_bits(j / 2), &pair[1]);
            for (uint32_t k = 0; k < 2 && j + k < n; k++)
                for (uint32_t i = 0; i < some; i++)
                    out[(j + k) * width + first + i] = (float)uuv_lane(pair[k], (int)i);
        }
    }
}
