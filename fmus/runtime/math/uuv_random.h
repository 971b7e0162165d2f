/* SPDX-License-Identifier: Apache-2.0 */
/* Random draws that depend on nothing but their own name: (seeds, variable, sample index, number).
 *
 * Philox4x32-10 turns a counter and a key into 128 random bits: J. K. Salmon, M. A. Moraes,
 * R. O. Dror, D. E. Shaw, Parallel random numbers: as easy as 1, 2, 3, SC '11. Key: the two seeds.
 * Counter: variable, sample (low and high word), block. Draws 2 b and 2 b + 1 come from block b,
 * so that a draw depends neither on how many are asked for, nor on order, thread, lane or W.
 * One variable serves normals or uniforms, not both: they are made of the same bits.
 */
#ifndef UUV_RANDOM_H
#define UUV_RANDOM_H

#include "uuv_math.h"

/* Each lane of counter and key holds one 32-bit word; the counter becomes the random words. */
static inline void uuv_philox_(uuv_bits counter[4], uuv_bits key0, uuv_bits key1) {
    const uint64_t word = 0xffffffffu;
    for (int round = 0; round < 10; round++) {
        const uuv_bits a = counter[0] * (uint64_t)0xd2511f53u;
        const uuv_bits b = counter[2] * (uint64_t)0xcd9e8d57u;
        counter[0] = (b >> 32) ^ counter[1] ^ key0;
        counter[1] = b & word;
        counter[2] = (a >> 32) ^ counter[3] ^ key1;
        counter[3] = a & word;
        key0 = (key0 + (uint64_t)0x9e3779b9u) & word;
        key1 = (key1 + (uint64_t)0xbb67ae85u) & word;
    }
}

/* (m + 1/2) 2^-52 for the upper 52 bits m of two words: exact, and never 0 or 1. */
static inline V uuv_open_interval_(uuv_bits high, uuv_bits low) {
    const uuv_bits one_and_m = (high << 20) | (low >> 12) | (uint64_t)0x3ff0000000000000u;
    return uuv_from_bits(one_and_m) - (1.0 - 0x1p-53);
}

/* Two uniform draws in (0, 1) a lane. */
static inline V uuv_uniform_pair_(uuv_bits seed0, uuv_bits seed1, uint32_t variable,
                                  uuv_bits sample, uuv_bits block, V *second) {
    uuv_bits words[4] = {uuv_const_bits(variable), sample & (uint64_t)0xffffffffu, sample >> 32,
                         block};
    uuv_philox_(words, seed0, seed1);
    *second = uuv_open_interval_(words[2], words[3]);
    return uuv_open_interval_(words[0], words[1]);
}

/* Two standard normal draws a lane: G. E. P. Box, M. E. Muller, A note on the generation of random
 * normal deviates, Ann. Math. Statist. 29 (1958). None is beyond 8.58. */
static inline V uuv_normal_pair_(uuv_bits seed0, uuv_bits seed1, uint32_t variable,
                                 uuv_bits sample, uuv_bits block, V *second) {
    V turn, s, c;
    const V u = uuv_uniform_pair_(seed0, seed1, variable, sample, block, &turn);
    const V radius = uuv_sqrt(-2.0 * uuv_log(u));
    uuv_sincos(0x1.921fb54442d18p2 * turn, &s, &c);
    *second = radius * s;
    return radius * c;
}

static inline uuv_bits uuv_lane_numbers_(void) {
    union {
        uint64_t i[UUV_W];
        uuv_bits lanes;
    } u;
    for (int i = 0; i < UUV_W; i++) u.i[i] = (uint64_t)i;
    return u.lanes;
}

/* n uniform draws in (0, 1) of one component; the lanes are blocks. */
static inline void uuv_uniform(uint32_t seed0, uint32_t seed1, uint32_t variable, uint64_t sample,
                               uint32_t n, uuv_real *out) {
    for (uint32_t base = 0; base < n; base += 2 * UUV_W) {
        V second;
        const V first = uuv_uniform_pair_(uuv_const_bits(seed0), uuv_const_bits(seed1), variable,
                                          uuv_const_bits(sample),
                                          base / 2 + uuv_lane_numbers_(), &second);
        for (uint32_t i = 0; i < 2 * UUV_W && base + i < n; i++)
            out[base + i] = uuv_lane(i & 1 ? second : first, (int)(i / 2));
    }
}

/* n standard normal draws of one component; the lanes are blocks. */
static inline void uuv_normal(uint32_t seed0, uint32_t seed1, uint32_t variable, uint64_t sample,
                              uint32_t n, uuv_real *out) {
    for (uint32_t base = 0; base < n; base += 2 * UUV_W) {
        V second;
        const V first = uuv_normal_pair_(uuv_const_bits(seed0), uuv_const_bits(seed1), variable,
                                         uuv_const_bits(sample),
                                         base / 2 + uuv_lane_numbers_(), &second);
        for (uint32_t i = 0; i < 2 * UUV_W && base + i < n; i++)
            out[base + i] = uuv_lane(i & 1 ? second : first, (int)(i / 2));
    }
}

/* The same n draws for W components at once, each with its own seeds (32 bits a lane) and sample
 * index: out[j] holds draw j of each. */
static inline void uuv_normal_lanes(uuv_bits seed0, uuv_bits seed1, uint32_t variable,
                                    uuv_bits sample, uint32_t n, V *out) {
    for (uint32_t j = 0; j < n; j += 2) {
        V second;
        out[j] = uuv_normal_pair_(seed0, seed1, variable, sample, uuv_const_bits(j / 2), &second);
        if (j + 1 < n) out[j + 1] = second;
    }
}

#endif
