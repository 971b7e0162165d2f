/* SPDX-License-Identifier: Apache-2.0 */
/* What a declaration offers to a kernel's derivatives: its functions, and their tangents and
 * adjoints, on W lanes.
 *
 * A tangent takes a perturbation of the block; an adjoint adds to the block's gradient what the
 * gradient `seed` of its function's results makes. Time, draws and whole numbers are constants.
 */
#ifndef UUV_LANE_DERIVATIVE_H
#define UUV_LANE_DERIVATIVE_H

#include "uuv_lane_words.h"

#include "uuv_lane_steps.h"

typedef void uuv_lane_function(const V *b, V *out);
typedef void uuv_lane_tangent(const V *b, const V *d, V *out);
typedef void uuv_lane_adjoint(const V *b, const V *seed, V *a);

typedef struct {
    uint32_t n_draws, index;
    void (*update)(const V *b, const V *draws, V *z_new);
    void (*tangent)(const V *b, const V *draws, const V *d, V *z_new);
    void (*adjoint)(const V *b, const V *draws, const V *seed, V *a);
} uuv_lane_derivative_clock;

/* The derivatives of one declaration's steps, compiled with it; those that are not are NULL. */
typedef struct {
    uint32_t off_derived, n_derived, off_x, n_x, off_z, n_z, off_y, n_y;
    uuv_lane_function *derived, *initial, *outputs;
    uuv_lane_tangent *derived_tangent, *initial_tangent, *outputs_tangent;
    uuv_lane_adjoint *derived_adjoint, *initial_adjoint, *outputs_adjoint;
    /* A communication step of one tick of the block b; of its perturbation d as well. */
    void (*step)(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods, uint32_t n_periods,
                 const uuv_lane_time *now);
    void (*step_tangent)(V *cells, V *b, V *d, uint32_t n_pieces, const uint8_t *periods,
                         uint32_t n_periods, const uuv_lane_time *now);
    /* From the block before the step, which is overwritten: the gradient a of what follows the
     * step becomes that of what precedes it. */
    void (*step_adjoint)(V *cells, V *b, V *a, uint32_t n_pieces, const uint8_t *periods,
                         uint32_t n_periods, const uuv_lane_time *now);
} uuv_lane_derivative;

/* ---- initialization -------------------------------------------------------------------------- */

static inline void derivative_clear(V *a, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) a[i] = uuv_const(0);
}

/* b, and d if there is one: derived values and states from parameters. */
static inline void derivative_initialize(const uuv_lane_derivative *c, V *b, V *d) {
    b[0] = uuv_const(0);
    c->derived(b, b + c->off_derived);
    if (d) c->derived_tangent(b, d, d + c->off_derived);
    c->initial(b, b + c->off_x);
    if (d) c->initial_tangent(b, d, d + c->off_x);
}

static inline void derivative_outputs(const uuv_lane_derivative *c, V *b, V *d) {
    c->outputs(b, b + c->off_y);
    if (d) c->outputs_tangent(b, d, d + c->off_y);
}

#endif
