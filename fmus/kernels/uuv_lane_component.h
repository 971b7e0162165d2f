/* SPDX-License-Identifier: Apache-2.0 */
/* What a declaration offers to a kernel: its functions on W lanes, and where its values lie.
 *
 * The functions are those of the FMU (uuv_component.h), written by the same emitter and compiled
 * at another W; derivatives, names and ranges are left out.
 */
#ifndef UUV_LANE_COMPONENT_H
#define UUV_LANE_COMPONENT_H

#include <stdint.h>

#include "uuv_math.h"

typedef struct {
    uint32_t n_draws; /* standard normals that one tick consumes */
    uint32_t index;   /* the "variable number" in the key of its draws */
    void (*update)(const V *b, const V *draws, V *z_new); /* writes all n_z values */
} uuv_lane_clock;

typedef struct {
    uint32_t n_block, off_derived, off_x, n_x, n_z, off_y, n_clocks;
    uint32_t n_held; /* values of the right-hand side that a step holds */
    int32_t off_seed; /* or -1 */
    const uuv_lane_clock *clocks;
    void (*derived)(const V *b, V *out);
    void (*initial)(const V *b, V *out);
    void (*held)(const V *b, V *w); /* what follows from inputs, parameters and samples alone */
    void (*rhs)(const V *b, const V *w, V *dx);
    void (*outputs)(const V *b, V *out);
} uuv_lane_component;

#if defined(_WIN32)
#define UUV_KERNEL_API __declspec(dllexport)
#else
#define UUV_KERNEL_API __attribute__((visibility("default")))
#endif

#endif
