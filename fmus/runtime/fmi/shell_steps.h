/* The end of initialization, steps, and the work space of derivatives. */
#ifndef SHELL_STEPS_H
#define SHELL_STEPS_H

#include "shell_variables.h"

/* Gives 1, or refuses and names the first output or state that is not finite. */
static int all_finite(shell *s, const char *function, double time, int32_t bad) {
    const uuv_component *c = s->block->component;
    for (uint32_t i = c->off_x; i < c->n_block && !bad; i++)
        if (!uuv_all_finite(s->block->b[i])) bad = (int32_t)(1 + i);
    if (!bad) return 1;
    uint32_t element;
    char name[96];
    const uint32_t at = (uint32_t)(bad - 1);
    const uuv_variable *v = owner(c, at, &element);
    return refuse(s, "%s: \"%s\" became %g at t = %.9g s", function,
                  v ? element_name(name, v, element) : "an internal value",
                  uuv_lane(s->block->b[at], 0), time);
}

static int shell_exit_initialization(shell *s, const char *function) {
    uuv_exit_initialization(s->block);
    uuv_update_outputs(s->block);
    if (uuv_failure(s->block)) {
        s->mode = FAILED;
        return refuse(s, "%s: %s", function, uuv_failure(s->block));
    }
    if (!all_finite(s, function, s->time, 0)) {
        s->mode = FAILED;
        return 0;
    }
    s->mode = s->exchange ? EVENT_MODE : STEP_MODE;
    int result = DONE;
    for (uint32_t i = 0; i < s->block->component->n_variables; i++) {
        const uuv_variable *v = &s->block->component->variables[i];
        for (uint32_t j = 0; v->soft_min && j < v->size; j++)
            if (below_minimum(s, v, j) == DONE_WITH_WARNING) result = DONE_WITH_WARNING;
    }
    return result;
}

/* Gives 1 if a step from t by h lies where the instance is, or refuses. */
__attribute__((noinline, cold)) static int fits(shell *s, const char *function, double t, double h) {
    if (!__builtin_isfinite(t))
        return refuse(s, "%s: currentCommunicationPoint is %g; expected a finite number",
                      function, t);
    if (!__builtin_isfinite(h) || h < 0.0)
        return refuse(s, "%s: communicationStepSize is %g; expected a finite number, at least 0",
                      function, h);
    /* Masters that accumulate time may be off by a few units in the last place. */
    const double slack = 1e-6 * h + 1e-9 * (__builtin_fabs(t) + 1.0);
    if (__builtin_fabs(t - s->time) > slack)
        return refuse(s, "%s: currentCommunicationPoint is %.17g; expected %.17g, where the "
                         "last step ended", function, t, s->time);
    if (t + h > s->stop_time + slack)
        return refuse(s, "%s: the step ends at %.17g; expected not after stopTime %.17g",
                      function, t + h, s->stop_time);
    return 1;
}

/* Gives 1 if a step from t by h can be made now, or refuses. */
static inline int can_step(shell *s, const char *function, double t, double h) {
    const int plain = __builtin_fabs(t - s->time) <= 1e-9 && h >= 0.0 && t + h <= s->stop_time &&
                      t + h < UUV_INFINITY; /* nearly always: within the slack of the complete checks */
    if (!plain && !fits(s, function, t, h)) return 0;
    const char *words = uuv_step_refused(s->block, t, h);
    return !words || refuse(s, "%s: %s", function, words);
}

/* Ends a step at `time`; `bad` is what uuv_do_step returned. */
static int end_step(shell *s, const char *function, double time, int32_t bad) {
    s->time = time;
    if (uuv_failure(s->block)) {
        s->mode = FAILED;
        return refuse(s, "%s: %s", function, uuv_failure(s->block));
    }
    if (!bad) return 1;
    s->mode = FAILED;
    return all_finite(s, function, s->time, bad);
}

static int shell_do_step(shell *s, const char *function, double t, double h) {
    return can_step(s, function, t, h) && end_step(s, function, t + h, uuv_do_step(s->block, t, h));
}

#ifndef UUV_WHOLE

/* For the stepping loop of this package: a step of n instances of one FMU. Returns the number of
 * those before the first that fails. */
static uint32_t shell_do_steps(void *const *components, const char *function, uint32_t n, double t,
                               double h) {
    uuv_instance *blocks[UUV_TOGETHER];
    for (uint32_t made, i = 0; i < n; i += made) {
        shell *const *s = (shell *const *)(components + i);
        uint32_t m = 0;
        int32_t bad = 0;
        for (; m < UUV_TOGETHER && m < n - i; m++) {
            if (!in_mode(s[m], function, STEP_MODE) || !can_step(s[m], function, t, h)) break;
            blocks[m] = s[m]->block;
        }
        made = m ? uuv_do_steps(blocks, m, t, h, &bad) : 0;
        for (uint32_t j = 0; j < made; j++) s[j]->time = t + h;
        if (made < m) end_step(s[made], function, t + h, bad);
        if (made < UUV_TOGETHER && made < n - i) return i + made;
    }
    return n;
}

#endif

/* ---- derivatives ----------------------------------------------------------------------- */
/* Place of an input or state in [u, x], or of an output or derivative in [y, dx]; -1 if the reference is refused. */
static int64_t differentiable(shell *s, const char *function, uint32_t vr, int known, int whole,
                              uint32_t *size) {
    const uuv_component *c = s->block->component;
    uint32_t element;
    const uuv_variable *v = reference(s, function, vr, UUV_FLOAT64, whole, &element, size);
    if (!v) return -1;
    const int64_t x = (int64_t)vr - c->off_x;
    if (known && v->kind == UUV_INPUT) return (int64_t)vr - c->off_u;
    if (known && v->kind == UUV_LOCAL && x < c->n_x) return c->n_u + x;
    if (!known && v->kind == UUV_OUTPUT) return (int64_t)vr - c->off_y;
    if (!known && v->kind == UUV_DERIVATIVE) return c->n_y + ((int64_t)vr - c->n_block);
    refuse(s, "%s: \"%s\" is not %s", function, v->name,
           known ? "a known; expected an input or a continuous state"
                 : "an unknown; expected an output or a state's derivative");
    return -1;
}

/* Work space [seed of u and x | sensitivity of y and dx], zeroed; NULL if there is no memory. */
static V *derivative_space(shell *s, V **sensitivity) {
    const uuv_component *c = s->block->component;
    if (!c->forward) {
        refuse(s, "derivatives are not provided");
        return NULL;
    }
    const size_t n = (size_t)c->n_u + c->n_x, m = (size_t)c->n_y + c->n_x;
    V *seed = calloc(n + m + 1, sizeof(V));
    if (!seed) {
        refuse(s, "out of memory");
        return NULL;
    }
    *sensitivity = seed + n;
    uuv_update_outputs(s->block);
    return seed;
}

#endif
