/* SPDX-License-Identifier: Apache-2.0 */
/* A fused system as one component: the life of an instance, over the kernel of one lane.
 *
 * Included at the end of a generated file that has the driver of the plan (step, initialize,
 * derive), and the tables free_inputs, parameters, shown_outputs, cell_names, cell_start. The
 * importer sees the block b of the instance; the kernel's cells m are filled from it, and its
 * outputs are copied back.
 */
#ifndef UUV_SYSTEM_H
#define UUV_SYSTEM_H

#include <stdio.h>
#include <stdlib.h>

#include "uuv_whole_steps.h"

typedef struct {
    uuv_instance head; /* what the shells know */
    V *m;              /* the kernel's cells */
    double start_time;
    char failure[256], refused[256];
} whole;

UUV_EXPORT const uuv_component *uuv_get_component(void) { return &uuv_the_component; }

UUV_EXPORT void uuv_reset(uuv_instance *s) {
    whole *w = (whole *)s;
    memcpy(s->b, s->component->start, s->component->n_block * sizeof(V));
    memset(w->m, 0, N_CELLS * sizeof(V));
    w->start_time = 0.0;
    w->failure[0] = '\0';
    s->dirty = s->outputs_stale = 1;
    s->initialized = 0;
}

UUV_EXPORT void uuv_free(uuv_instance *s) {
    if (!s) return;
    free(s->b);
    free(((whole *)s)->m);
    free(s);
}

UUV_EXPORT uuv_instance *uuv_instantiate(const uuv_component *c) {
    whole *w = calloc(1, sizeof *w);
    if (!w) return NULL;
    w->head.component = c;
    w->head.b = calloc(c->n_block, sizeof(V));
    w->m = calloc(N_CELLS, sizeof(V));
    if (!w->head.b || !w->m) {
        uuv_free(&w->head);
        return NULL;
    }
    uuv_reset(&w->head);
    return &w->head;
}

/* ---- values between the block and the cells --------------------------------------------- */

static void copy_outputs(whole *w) {
    for (uint32_t i = 0; i < N_SHOWN; i++)
        memcpy(w->head.b + shown_outputs[i].b, w->m + shown_outputs[i].cell,
               shown_outputs[i].size * sizeof(V));
}

static void copy_tunables(whole *w) {
    for (uint32_t i = 0; i < N_PARAMETERS; i++) {
        const V *given = w->head.b + parameters[i].b;
        V *held = w->m + parameters[i].cell;
        if (!parameters[i].tunable || !memcmp(held, given, parameters[i].size * sizeof(V)))
            continue;
        memcpy(held, given, parameters[i].size * sizeof(V));
        uuv_kernel_derive(w->m, parameters[i].member, 0, 1);
    }
}

/* Says which value is not finite, as the kernel noted it. */
static void note_failure(whole *w) {
    const uint64_t noted = *lane_words(w->m, WORD_FAILED);
    if (!noted) return;
    const uint32_t cell = (uint32_t)(noted - 1);
    const double time = w->start_time + (double)(*lane_words(w->m, WORD_FAILED_TICK) * tick_num) /
                                            (double)tick_den;
    uint32_t i = N_NAMES - 1;
    while (i && cell_names[i].cell > cell) i--;
    if (cell_names[i].array)
        snprintf(w->failure, sizeof w->failure, "%s[%u] is not finite at t = %.9g s",
                 cell_names[i].name, (unsigned)(cell - cell_names[i].cell + 1), time);
    else
        snprintf(w->failure, sizeof w->failure, "%s is not finite at t = %.9g s",
                 cell_names[i].name, time);
}

/* Start values, seeds and what follows from them, at the communication point 0. */
static int begin(whole *w) {
    V *start = malloc(N_START * sizeof(V));
    if (!start) {
        snprintf(w->failure, sizeof w->failure, "out of memory");
        return 0;
    }
    const uint64_t seed = (uint64_t)(int64_t)w->head.b[SEED];
    memcpy(start, cell_start, N_START * sizeof(V));
    uuv_kernel_seed(start, &seed, NULL, 0, 1);
    for (uint32_t i = 0; i < N_FREE; i++)
        start[free_inputs[i].start] = w->head.b[free_inputs[i].b];
    for (uint32_t i = 0; i < N_PARAMETERS; i++)
        memcpy(start + parameters[i].start, w->head.b + parameters[i].b,
               parameters[i].size * sizeof(V));
    uuv_kernel_reset(w->m, start, NULL, NULL, 0, 1);
    free(start);
    copy_outputs(w);
    return 1;
}

/* ---- life ------------------------------------------------------------------------------ */

UUV_EXPORT void uuv_refresh(uuv_instance *s) { (void)s; } /* it shows no locals */

UUV_EXPORT void uuv_update_outputs(uuv_instance *s) {
    if (!s->outputs_stale || s->initialized) return;
    if (begin((whole *)s)) s->outputs_stale = s->dirty = 0;
}

UUV_EXPORT void uuv_enter_initialization(uuv_instance *s, double start_time) {
    ((whole *)s)->start_time = start_time;
    s->b[0] = start_time;
}

UUV_EXPORT void uuv_exit_initialization(uuv_instance *s) {
    uuv_update_outputs(s);
    note_failure((whole *)s);
    s->initialized = 1;
}

void uuv_terminate(uuv_instance *s) { (void)s; }

const char *uuv_failure(const uuv_instance *s) {
    const whole *w = (const whole *)s;
    return w->failure[0] ? w->failure : NULL;
}

/* Which communication point of the system a time is; -1: none. */
static int64_t point_of(const whole *w, double time) {
    return whole_point(time - w->start_time, (double)tick_num, (double)tick_den);
}

const char *uuv_step_refused(uuv_instance *s, double t, double h) {
    whole *w = (whole *)s;
    return whole_refused(w->refused, sizeof w->refused, (int64_t)*lane_words(w->m, WORD_TICK),
                         point_of(w, t + h), t, h, (double)tick_num / (double)tick_den);
}

UUV_EXPORT int32_t uuv_do_step(uuv_instance *s, double t, double h) {
    whole *w = (whole *)s;
    const int64_t n = point_of(w, t + h) - (int64_t)*lane_words(w->m, WORD_TICK);
    for (uint32_t i = 0; i < N_FREE; i++) w->m[free_inputs[i].cell] = s->b[free_inputs[i].b];
    if (s->dirty) copy_tunables(w);
    s->dirty = 0;
    if (n > 0 && uuv_kernel_step(w->m, 0, 0, 1, (uint64_t)n)) note_failure(w);
    copy_outputs(w);
    s->b[0] = t + h;
    return 0;
}

/* ---- states ---------------------------------------------------------------------------- */

UUV_EXPORT size_t uuv_state_size(const uuv_instance *s) {
    return (s->component->n_block + N_CELLS + 1) * sizeof(V) + sizeof(uint64_t);
}

UUV_EXPORT void uuv_get_state(const uuv_instance *s, void *out) {
    const whole *w = (const whole *)s;
    const size_t n = s->component->n_block;
    const uint64_t flags = (uint64_t)(s->dirty | s->outputs_stale << 1 | s->initialized << 2 |
                                      (w->failure[0] != '\0') << 3);
    char *p = out;
    memcpy(p, s->b, n * sizeof(V));
    memcpy(p += n * sizeof(V), w->m, N_CELLS * sizeof(V));
    memcpy(p += N_CELLS * sizeof(V), &w->start_time, sizeof(double));
    memcpy(p + sizeof(V), &flags, sizeof flags);
}

UUV_EXPORT void uuv_set_state(uuv_instance *s, const void *in) {
    whole *w = (whole *)s;
    const size_t n = s->component->n_block;
    uint64_t flags;
    const char *p = in;
    memcpy(s->b, p, n * sizeof(V));
    memcpy(w->m, p += n * sizeof(V), N_CELLS * sizeof(V));
    memcpy(&w->start_time, p += N_CELLS * sizeof(V), sizeof(double));
    memcpy(&flags, p + sizeof(V), sizeof flags);
    s->dirty = (int)(flags & 1);
    s->outputs_stale = (int)(flags >> 1 & 1);
    s->initialized = (int)(flags >> 2 & 1);
    w->failure[0] = '\0';
    if (flags >> 3 & 1) note_failure(w);
}

/* ---- texts: it has none ------------------------------------------------------------------ */

const char *uuv_text(const uuv_instance *s, uint32_t vr) { return (void)s, (void)vr, NULL; }

int uuv_set_text(uuv_instance *s, uint32_t vr, const char *value) {
    return (void)s, (void)vr, (void)value, 0;
}

#endif
