/* uuv_random.h for the tests. */
#include "uuv_random.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* n must be a multiple of UUV_W: each lane has a counter and a key of its own. */
EXPORT void philox(uint32_t n, const uint32_t (*counter)[4], const uint32_t (*key)[2],
                   uint32_t (*out)[4]) {
    for (uint32_t at = 0; at < n; at += UUV_W) {
        union {
            uuv_bits lanes[6];
            uint64_t word[6][UUV_W];
        } u;
        for (int i = 0; i < UUV_W; i++) {
            for (int j = 0; j < 4; j++) u.word[j][i] = counter[at + (uint32_t)i][j];
            for (int j = 0; j < 2; j++) u.word[4 + j][i] = key[at + (uint32_t)i][j];
        }
        uuv_philox_(u.lanes, u.lanes[4], u.lanes[5]);
        for (int i = 0; i < UUV_W; i++)
            for (int j = 0; j < 4; j++) out[at + (uint32_t)i][j] = (uint32_t)u.word[j][i];
    }
}

EXPORT void normal(uint32_t seed0, uint32_t seed1, uint32_t variable, uint64_t sample, uint32_t n,
                   double *out) {
    uuv_normal(seed0, seed1, variable, sample, n, out);
}

EXPORT void uniform(uint32_t seed0, uint32_t seed1, uint32_t variable, uint64_t sample, uint32_t n,
                    double *out) {
    uuv_uniform(seed0, seed1, variable, sample, n, out);
}

/* out[n][UUV_W]; the seeds and sample indices of UUV_W components. */
EXPORT void normal_lanes(const uint64_t *seed0, const uint64_t *seed1, uint32_t variable,
                         const uint64_t *sample, uint32_t n, double *out) {
    union {
        uint64_t word[3][UUV_W];
        uuv_bits lanes[3];
    } u;
    V draws[64];
    for (int i = 0; i < UUV_W; i++) {
        u.word[0][i] = seed0[i];
        u.word[1][i] = seed1[i];
        u.word[2][i] = sample[i];
    }
    uuv_normal_lanes(u.lanes[0], u.lanes[1], variable, u.lanes[2], n, draws);
    for (uint32_t j = 0; j < n; j++) uuv_store(out + j * UUV_W, draws[j]);
}

EXPORT void open_interval(uint32_t high, uint32_t low, double *out) {
    *out = uuv_lane(uuv_open_interval_(uuv_const_bits(high), uuv_const_bits(low)), 0);
}

EXPORT uint32_t lanes(void) { return UUV_W; }
