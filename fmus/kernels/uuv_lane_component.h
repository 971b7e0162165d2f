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
    /* in place, in the lanes that are due; p as below */
    void (*update)(V *b, const V *p, const V *draws, uuv_mask due);
} uuv_lane_clock;

/* The beginning and the end of a step, in each lane. */
typedef struct {
    V t, end, length;
} uuv_lane_time;

/* Memory of the next block, which is asked for in pieces while this block is stepped. */
typedef struct {
    const char *next, *end; /* that were not asked for yet */
    uint64_t rate;          /* lines of 64 bytes for each operation of a step, times 2^32 */
} uuv_lane_fetch;

/* Where the parameters of a block are in this step, and the memory that is needed next.
 *
 * If the parameters of a component have equal values in all lanes, every block reads those of the
 * first block. They stay in the processor's cache, whereas a block's own ones come from memory. */
typedef struct {
    const uint8_t *is_own; /* by first cell of a component: whether each block reads its own; or 0 */
    int64_t to_first;      /* cells from this block to the first one */
    uuv_lane_fetch *fetch; /* or 0 */
} uuv_lane_sources;

typedef struct {
    uint32_t n_block, off_parameters, off_derived, off_x, n_x, n_z, off_y, n_clocks;
    uint32_t n_held; /* values that a step holds */
    int32_t off_seed; /* or -1 */
    int32_t is_seeded; /* derived values depend on the seed, so they are never shared */
    const uuv_lane_clock *clocks;
    void (*derived)(const V *b, V *out);
    void (*initial)(const V *b, V *out);
    /* p: the block that has the parameters and derived values, at their places in b */
    void (*held)(const V *b, const V *p, V *w); /* what does not change within a step */
    void (*rhs)(const V *b, const V *p, const V *w, V *dx);
    void (*outputs)(const V *b, const V *p, V *out);
    void (*outputs_of_step)(const V *b, const V *p, const V *w, V *out); /* after `held` */
} uuv_lane_component;

/* The steps of one declaration, compiled with it (uuv_lane_steps.h). */
typedef struct {
    const uuv_lane_component *component;
    /* A communication step of one tick; clock i has period periods[i] of the system's. */
    void (*do_step)(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods, uint32_t n_periods,
                    const uuv_lane_time *now, const uuv_lane_sources *at, V *scratch);
    /* The same for `count` equal components without clocks whose blocks follow each other, side by
     * side, so that a processor always has something independent to do. */
    void (*do_step_together)(V *cells, V *b, uint32_t count, uint32_t n_pieces,
                             const uuv_lane_time *now, const uuv_lane_sources *at, V *scratch);
    /* The parts of a longer one. */
    void (*sample)(V *b, const V *p, uint32_t clock, uuv_mask due, uuv_words sample, V t,
                   V *scratch);
    void (*integrate)(V *b, const V *p, V t, V length, uint32_t n_pieces, V *scratch);
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
