/* SPDX-License-Identifier: Apache-2.0 */
/* What a driver of derivatives offers: ranges of blocks, each with a work space of N_TAPE cells.
 *
 * Included at the end of the generated driver, which has N_CELLS, N_START, N_TAPE, and functions
 * for tangents or for adjoints; the other ones are told apart by which it has defined.
 */
#ifndef UUV_LANE_DERIVATIVE_BLOCKS_H
#define UUV_LANE_DERIVATIVE_BLOCKS_H

#if defined(UUV_TANGENT)

/* The perturbation d of the initialized blocks, from that of the start values. */
UUV_KERNEL_API void uuv_derivative_reset(const V *start, V *d_start, V *d, V *tape,
                                         uint64_t first, uint64_t last) {
    for (uint64_t i = first; i < last; i++)
        initialize_tangent(tape, start + i * N_START, d + i * N_CELLS, d_start + i * N_START);
}

/* The perturbation d makes the step that begins at `memory`, which stays. */
UUV_KERNEL_API void uuv_derivative_step(const V *memory, V *d, V *tape, uint64_t first,
                                        uint64_t last) {
    for (uint64_t i = first; i < last; i++) {
        memcpy(tape, memory + i * N_CELLS, N_CELLS * sizeof(V));
        step_tangent(tape, d + i * N_CELLS);
    }
}

#else

/* The gradient a of the initialized blocks is added to that of the start values. */
UUV_KERNEL_API void uuv_derivative_reset(const V *start, V *a_start, V *a, V *tape,
                                         uint64_t first, uint64_t last) {
    for (uint64_t i = first; i < last; i++)
        initialize_adjoint(tape, start + i * N_START, a + i * N_CELLS, a_start + i * N_START,
                           tape + N_CELLS);
}

/* The gradient a goes back over the step that begins at `memory`, which stays. */
UUV_KERNEL_API void uuv_derivative_step(const V *memory, V *a, V *tape, uint64_t first,
                                        uint64_t last) {
    for (uint64_t i = first; i < last; i++) {
        memcpy(tape, memory + i * N_CELLS, N_CELLS * sizeof(V));
        step_adjoint(tape, tape + N_CELLS, a + i * N_CELLS);
    }
}

#endif
#endif
