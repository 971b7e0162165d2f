/* SPDX-License-Identifier: Apache-2.0 */
/* What a declaration offers to a kernel: its functions on W lanes, and where its values lie.
 *
 * The functions are those of the FMU (uuv_component.h), written by the same emitter and compiled
 * at another W; derivatives, names and ranges are left out.
 */
#ifndef UUV_LANE_COMPONENT_H
#define UUV_LANE_COMPONENT_H

#include "uuv_lane_words.h"

typedef struct {
    uint32_t n_draws; /* standard normals that one tick consumes */
    uint32_t index;   /* the "variable number" in the key of its draws */
    void (*update)(V *b, const V *draws, uuv_mask due); /* in place, in the lanes that are due */
} uuv_lane_clock;

/* The beginning and the end of a step, in each lane. */
typedef struct {
    V t, end, length;
} uuv_lane_time;

typedef struct {
    uint32_t n_block, off_derived, off_x, n_x, n_z, off_y, n_clocks;
    uint32_t n_held; /* values that a step holds */
    int32_t off_seed; /* or -1 */
    const uuv_lane_clock *clocks;
    void (*derived)(const V *b, V *out);
    void (*initial)(const V *b, V *out);
    void (*held)(const V *b, V *w); /* what follows from inputs, parameters and samples alone */
    void (*rhs)(const V *b, const V *w, V *dx);
    void (*outputs)(const V *b, V *out);
    void (*outputs_of_step)(const V *b, const V *w, V *out); /* the same, after `held` */
} uuv_lane_component;

/* The steps of one declaration, compiled with it (uuv_lane_steps.h). */
typedef struct {
    const uuv_lane_component *component;
    /* A communication step of one tick; clock i has period periods[i] of the system's. */
    void (*do_step)(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods, uint32_t n_periods,
                    const uuv_lane_time *now, V *scratch);
    /* The same for `count` equal components without clocks whose blocks follow each other, side by
     * side, so that a processor always has something independent to do. */
    void (*do_step_together)(V *cells, V *b, uint32_t count, uint32_t n_pieces,
                             const uuv_lane_time *now, V *scratch);
    /* The parts of a longer one. */
    void (*sample)(V *b, uint32_t clock, uuv_mask due, uuv_words sample, V t, V *scratch);
    void (*integrate)(V *b, V t, V length, uint32_t n_pieces, V *scratch);
} uuv_lane_stepper;

/* Standard normal draws of a block of lanes: out[n][width] (fmus/kernels/float_draws.c). */
typedef void uuv_lane_draws(const uint32_t *seed0, const uint32_t *seed1, uint32_t variable,
                            const uint64_t *sample, uint32_t n, uint32_t width, float *out);

#if defined(_WIN32)
#define UUV_KERNEL_API __declspec(dllexport)
#else
#define UUV_KERNEL_API __attribute__((visibility("default")))
#endif

#endif
