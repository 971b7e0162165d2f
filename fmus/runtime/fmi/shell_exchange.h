/* Model Exchange: the importer integrates the continuous states between the events it is told of.
 *
 * The events are the sample instants of the component's clocks, all known in advance; there are
 * no event indicators. A sample changes discrete states alone, so that a continuous state never
 * jumps. What FMI 2.0 and 3.0 ask is the same; the shells only spell it.
 */
#ifndef SHELL_EXCHANGE_H
#define SHELL_EXCHANGE_H

#include "shell_steps.h"

enum { EXCHANGE_MODE = EVENT_MODE | CONTINUOUS_TIME_MODE };

static int shell_enter_mode(shell *s, const char *function, unsigned from, unsigned to) {
    if (!in_mode(s, function, from)) return 0;
    s->mode = to;
    return 1;
}

/* Takes the samples that are due. *next is the time of the next one, inf if there is none. */
static int shell_new_discrete_states(shell *s, const char *function, double *next) {
    if (!in_mode(s, function, EVENT_MODE)) return 0;
    uuv_take_samples(s->block, s->time);
    uuv_update_outputs(s->block);
    if (!all_finite(s, function, s->time, 0)) {
        s->mode = FAILED;
        return 0;
    }
    *next = uuv_next_sample(s->block);
    return 1;
}

static int shell_set_time(shell *s, const char *function, double time) {
    if (!in_mode(s, function, EXCHANGE_MODE)) return 0;
    if (!__builtin_isfinite(time))
        return refuse(s, "%s: time is %g; expected a finite number", function, time);
    s->time = time;
    s->block->b[0] = uuv_const(time);
    s->block->outputs_stale = 1;
    return 1;
}

static int states_match(shell *s, const char *function, const void *values, size_t n) {
    const uint32_t n_x = s->block->component->n_x;
    if (n == n_x && (values || !n)) return 1;
    return refuse(s, "%s: %llu values; expected %u, one for each continuous state", function,
                  (unsigned long long)(values ? n : 0), (unsigned)n_x);
}

static int shell_set_states(shell *s, const char *function, const double *x, size_t n) {
    if (!in_mode(s, function, CONTINUOUS_TIME_MODE)) return 0;
    if (!states_match(s, function, x, n)) return 0;
    for (size_t i = 0; i < n; i++) s->block->b[s->block->component->off_x + i] = uuv_const(x[i]);
    s->block->outputs_stale = 1;
    return 1;
}

static int shell_get_states(shell *s, const char *function, double *x, size_t n) {
    if (!in_mode(s, function, INITIALIZATION_MODE | EXCHANGE_MODE | TERMINATED)) return 0;
    if (!states_match(s, function, x, n)) return 0;
    uuv_refresh(s->block);
    for (size_t i = 0; i < n; i++) x[i] = uuv_lane(s->block->b[s->block->component->off_x + i], 0);
    return 1;
}

/* Gives 1, 0 if refused, or -1 where a derivative is not finite: a shorter step may help. */
static int shell_get_derivatives(shell *s, const char *function, double *dx, size_t n) {
    if (!in_mode(s, function, INITIALIZATION_MODE | EXCHANGE_MODE | TERMINATED)) return 0;
    if (!states_match(s, function, dx, n)) return 0;
    const uuv_component *c = s->block->component;
    int finite = 1;
    uuv_update_derivatives(s->block);
    for (size_t i = 0; i < n; i++) {
        dx[i] = uuv_lane(s->block->b[c->n_block + i], 0);
        if (!__builtin_isfinite(dx[i])) finite = 0;
    }
    if (finite) return 1;
    refuse(s, "%s: a derivative is not finite at t = %.9g s", function, s->time);
    return -1;
}

static int shell_get_nominals(shell *s, const char *function, double *nominals, size_t n) {
    if (!in_mode(s, function, ANY_MODE)) return 0;
    if (!states_match(s, function, nominals, n)) return 0;
    for (size_t i = 0; i < n; i++) nominals[i] = 1.0;
    return 1;
}

#endif
