/* SPDX-License-Identifier: Apache-2.0 */
/* What a kernel's driver offers: whole ranges of blocks stepped, reset, or derived anew.
 *
 * Included at the end of the generated driver, which has N_CELLS, N_START, step, initialize, derive.
 */
#ifndef UUV_LANE_BLOCKS_H
#define UUV_LANE_BLOCKS_H

/* Makes n communication steps in the blocks first ... last - 1; says whether a lane has failed. */
UUV_KERNEL_API int32_t uuv_kernel_step(V *memory, uint64_t first, uint64_t last, uint64_t n) {
    int32_t failed = 0;
    for (uint64_t i = first; i < last; i++) {
        V *m = memory + i * N_CELLS;
        for (uint64_t k = 0; k < n; k++) step(m);
        failed |= uuv_any(uuv_to_bits(m[CELL_FAILED]));
    }
    return failed;
}

/* Initializes the lanes whose mask is not 0; `scratch` has room for one block. */
UUV_KERNEL_API void uuv_kernel_reset(V *memory, const V *start, const uint8_t *masks, V *scratch,
                                     uint64_t first, uint64_t last) {
    for (uint64_t i = first; i < last; i++) {
        V *m = memory + i * N_CELLS;
        union {
            uint64_t lanes[UUV_W];
            uuv_mask all;
        } chosen;
        for (int lane = 0; lane < UUV_W; lane++)
            chosen.lanes[lane] = -(uint64_t)(masks[i * UUV_W + (uint64_t)lane] != 0);
        if (!uuv_any(chosen.all)) continue;
        initialize(scratch, start + i * N_START);
        for (uint32_t k = 0; k < N_CELLS; k++) m[k] = uuv_select(chosen.all, scratch[k], m[k]);
    }
}

/* What follows from the parameters of a component, after they were set. */
UUV_KERNEL_API void uuv_kernel_derive(V *memory, uint32_t member, uint64_t first, uint64_t last) {
    for (uint64_t i = first; i < last; i++) derive(memory + i * N_CELLS, member);
}

#endif
