/* SPDX-License-Identifier: Apache-2.0 */
/* An instance in memory that the caller gives: no heap, as on a microcontroller.
 *
 * Compile the component and uuv_runtime.c with -DUUV_NO_HEAP -ffp-contract=off -fno-math-errno,
 * without the FMI shells; all that they need of libc are memcpy and memset.
 *
 *     static double memory[4096]; // at least uuv_memory(&uuv_the_component) bytes
 *     uuv_instance *s = uuv_place(&uuv_the_component, memory, sizeof memory);
 *     uuv_enter_initialization(s, 0.0);   // parameters and inputs: s->b[their value reference]
 *     uuv_exit_initialization(s);
 *     for (double t = 0.0;; t += h) {
 *         s->b[reference_of_an_input] = ...;
 *         uuv_do_step(s, t, h);           // 0, or 1 + the reference of what is not finite
 *         uuv_update_outputs(s);
 *         ... = s->b[reference_of_an_output];
 *     }
 */
#ifndef UUV_STATIC_H
#define UUV_STATIC_H

#include <string.h>

#include "uuv_component.h"

static inline size_t uuv_scratch_of_(const uuv_component *c) {
    uint32_t draws = 0;
    for (uint32_t i = 0; i < c->n_clocks; i++)
        if (c->clocks[i].n_draws > draws) draws = c->clocks[i].n_draws;
    return (size_t)c->n_held + draws + 1;
}

/* The bytes that an instance takes. */
static inline size_t uuv_memory(const uuv_component *c) {
    const size_t values = (size_t)c->n_block + c->n_x + uuv_scratch_of_(c);
    return values * sizeof(V) + (c->n_clocks + 1) * (sizeof(uint64_t) + sizeof(uuv_instant)) + sizeof(uuv_instance);
}

/* Makes an instance in `memory`, aligned as a V is; NULL if it is too small. */
static inline uuv_instance *uuv_place(const uuv_component *c, void *memory, size_t size) {
    if (size < uuv_memory(c)) return NULL;
    V *values = memory;
    const size_t n_block = (size_t)c->n_block + c->n_x, n_scratch = uuv_scratch_of_(c);
    for (size_t i = 0; i < n_block + n_scratch; i++) values[i] = uuv_const(0.0);
    uint64_t *k = (uint64_t *)(void *)(values + n_block + n_scratch);
    uuv_instant *next = (uuv_instant *)(void *)(k + c->n_clocks + 1);
    uuv_instance *s = (uuv_instance *)(void *)(next + c->n_clocks + 1);
    s->component = c;
    s->b = values;
    s->scratch = values + n_block;
    s->k = k;
    s->next = memset(next, 0, c->n_clocks * sizeof *next);
    uuv_reset(s);
    return s;
}

#endif
