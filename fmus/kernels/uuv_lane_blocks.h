/* SPDX-License-Identifier: Apache-2.0 */
/* What a kernel's driver offers: whole ranges of blocks stepped, seeded, reset, or derived anew.
 *
 * Included at the end of the generated driver, which has N_CELLS, N_START, N_SEEDED, seeded,
 * N_MEMBERS, N_OPERATIONS, members, declared, step, initial_outputs.
 */
#ifndef UUV_LANE_BLOCKS_H
#define UUV_LANE_BLOCKS_H

/* A block of lanes from its start values, at time 0. */
static void initialize(V *m, const V *start) {
    memset(m, 0, N_WORD_CELLS * sizeof(V));
    for (uint32_t i = 0; i < N_MEMBERS; i++) {
        const uuv_lane_component *c = declared[members[i].declaration];
        V *b = m + members[i].cell;
        memcpy(b, start + members[i].start, c->off_derived * sizeof(V));
        lane_initialize(c, b);
    }
    initial_outputs(m);
    for (uint32_t i = 0; i < N_MEMBERS; i++) {
        const uuv_lane_component *c = declared[members[i].declaration];
        V *b = m + members[i].cell;
        lane_check(m, b, c->off_x, c->n_block);
        if (members[i].is_slower) /* its pending outputs follow its block */
            memcpy(b + c->n_block, b + c->off_y, (c->n_block - c->off_y) * sizeof(V));
    }
}

/* Makes n communication steps in the blocks first ... last - 1; says whether a lane has failed.
 * `is_own` says by first cell whether a block reads its own parameters of a component; all do if
 * it is 0. */
UUV_KERNEL_API int32_t uuv_kernel_step(V *memory, const uint8_t *is_own, uint64_t first,
                                       uint64_t last, uint64_t n) {
    int32_t failed = 0;
    for (uint64_t i = first; i < last; i++) {
        V *m = memory + i * N_CELLS;
        const uuv_lane_sources at = {is_own, -(int64_t)(i * N_CELLS), 0};
        for (uint64_t k = 0; k < n; k++) step(m, &at);
        failed |= uuv_any(~uuv_mask_of_words(uuv_words_equal(*lane_words(m, WORD_FAILED), 0)));
    }
    return failed;
}

/* Initializes the lanes whose mask is not 0, or all; `scratch` has room for one block. Says
 * whether a lane has failed. */
UUV_KERNEL_API int32_t uuv_kernel_reset(V *memory, const V *start, const uint8_t *masks,
                                        V *scratch, uint64_t first, uint64_t last) {
    int32_t failed = 0;
    for (uint64_t i = first; i < last; i++) {
        V *m = memory + i * N_CELLS;
        uuv_words chosen;
        int all = 1, any = 0;
        for (int lane = 0; masks && lane < UUV_W; lane++) {
            const uint64_t yes = masks[i * UUV_W + (uint64_t)lane] != 0, bits = -yes;
            memcpy((char *)&chosen + 8 * lane, &bits, sizeof bits);
            all &= (int)yes;
            any |= (int)yes;
        }
        if (all) {
            initialize(m, start + i * N_START);
        } else if (any) {
            initialize(scratch, start + i * N_START);
            for (uint32_t k = 0; k < N_WORDS; k++) {
                const uuv_words fresh = *lane_words(scratch, k) & chosen;
                *lane_words(m, k) = fresh | (*lane_words(m, k) & ~chosen);
            }
            const uuv_mask mask = uuv_mask_of_words(chosen);
            for (uint32_t k = N_WORD_CELLS; k < N_CELLS; k++)
                m[k] = uuv_select(mask, scratch[k], m[k]);
        }
        failed |= uuv_any(~uuv_mask_of_words(uuv_words_equal(*lane_words(m, WORD_FAILED), 0)));
    }
    return failed;
}

/* The key of a component's draws: Philox of the system's seed and of the component's path, as
 * uuvsim_cosim/orchestrator/plan/seeds.py has it. */
static void component_seed(uint64_t seed, const uint32_t path[2], uint32_t key[2]) {
    uint64_t w[4] = {seed & 0xffffffffu, seed >> 32, path[0], path[1]};
    uint32_t k0 = 0x75757673u, k1 = 0x696d2e31u;
    for (int round = 0; round < 10; round++) {
        const uint64_t a = w[0] * 0xd2511f53u, b = w[2] * 0xcd9e8d57u;
        w[0] = (b >> 32) ^ w[1] ^ k0;
        w[1] = b & 0xffffffffu;
        w[2] = (a >> 32) ^ w[3] ^ k1;
        w[3] = a & 0xffffffffu;
        k0 += 0x9e3779b9u;
        k1 += 0xbb67ae85u;
    }
    key[0] = (uint32_t)w[0];
    key[1] = (uint32_t)w[1];
}

/* Writes the seeds of all components into the start values, where the mask is not 0, or in all. */
UUV_KERNEL_API void uuv_kernel_seed(V *start, const uint64_t *seeds, const uint8_t *masks,
                                    uint64_t first, uint64_t last) {
    for (uint64_t e = first * UUV_W; e < last * UUV_W; e++) {
        if (masks && !masks[e]) continue;
        for (uint32_t i = 0; i < N_SEEDED; i++) {
            uint32_t key[2];
            component_seed(seeds[e], seeded[i].path, key);
            for (uint32_t j = 0; j < 2; j++) {
                V *cell = start + e / UUV_W * N_START + seeded[i].cell + j;
#if defined(UUV_FLOAT32)
                memcpy((uint32_t *)(void *)cell + e % UUV_W, &key[j], sizeof key[j]);
#else
                const uuv_real value = (uuv_real)(int32_t)key[j];
                memcpy((uuv_real *)(void *)cell + e % UUV_W, &value, sizeof value);
#endif
            }
        }
    }
}

#include "uuv_lane_exchange.h"
#include "uuv_lane_parts.h"

/* What follows from the parameters of a component, after they were set. */
UUV_KERNEL_API void uuv_kernel_derive(V *memory, uint32_t member, uint64_t first, uint64_t last) {
    const uuv_lane_component *c = declared[members[member].declaration];
    for (uint64_t i = first; i < last; i++) {
        V *b = memory + i * N_CELLS + members[member].cell;
        c->derived(b, b + c->off_derived);
    }
}

#endif
