/* The life of an instance: start values, refresh of derived values, and do_step, which is
 * RK4 in sub-steps (uuv_step.h), cut at the sample instants of the component's clocks. */
#include "uuv_component.h"

#if !defined(UUV_NO_HEAP) /* without: uuv_static.h */
#include <stdlib.h>
#endif
#include <string.h>

#include "uuv_random.h"

static V broadcast(double value) { return uuv_const(value); }

UUV_EXPORT const uuv_component *uuv_get_component(void) { return &uuv_the_component; }

#if !defined(UUV_NO_HEAP)
static uint32_t max_draws(const uuv_component *c) {
    uint32_t n = 0;
    for (uint32_t i = 0; i < c->n_clocks; i++)
        if (c->clocks[i].n_draws > n) n = c->clocks[i].n_draws;
    return n;
}

UUV_EXPORT uuv_instance *uuv_instantiate(const uuv_component *c) {
    uuv_instance *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    size_t scratch = (size_t)c->n_held + max_draws(c) + 1;
    s->component = c;
    s->b = calloc((size_t)c->n_block + c->n_x, sizeof(V));
    s->k = calloc(c->n_clocks + 1, sizeof *s->k);
    s->next = calloc(c->n_clocks + 1, sizeof *s->next);
    s->scratch = calloc(scratch, sizeof(V));
    if (!s->b || !s->k || !s->next || !s->scratch) {
        uuv_free(s);
        return NULL;
    }
    uuv_reset(s);
    return s;
}

UUV_EXPORT void uuv_free(uuv_instance *s) {
    if (!s) return;
    free(s->b);
    free(s->k);
    free(s->next);
    free(s->scratch);
    free(s);
}
#endif

UUV_EXPORT void uuv_reset(uuv_instance *s) {
    for (uint32_t i = 0; i < s->component->n_block; i++)
        s->b[i] = broadcast(s->component->start[i]);
    memset(s->k, 0, s->component->n_clocks * sizeof *s->k);
    s->dirty = 1;
    s->outputs_stale = 1;
    s->initialized = 0;
}

UUV_EXPORT void uuv_refresh(uuv_instance *s) {
    if (!s->dirty) return;
    s->component->derived(s->b);
    if (!s->initialized) s->component->initial(s->b);
    s->dirty = 0;
    s->outputs_stale = 1;
}

UUV_EXPORT void uuv_enter_initialization(uuv_instance *s, double start_time) {
    for (uint32_t i = 0; i < s->component->n_clocks; i++) {
        const uuv_clock *clock = &s->component->clocks[i];
        const double k = start_time * (double)clock->period_den / (double)clock->period_num;
        uint64_t first = k > 0.0 ? (uint64_t)k : 0; /* ticks before the start are skipped */
        if (k - (double)first > 1e-6) first++;
        s->k[i] = first;
    }
    s->b[0] = broadcast(start_time);
    s->outputs_stale = 1;
}

UUV_EXPORT void uuv_exit_initialization(uuv_instance *s) {
    uuv_refresh(s);
    s->initialized = 1;
}

UUV_EXPORT void uuv_update_outputs(uuv_instance *s) {
    uuv_refresh(s);
    if (!s->outputs_stale) return;
    s->component->outputs(s->b);
    s->outputs_stale = 0;
}

UUV_EXPORT void uuv_forward(const uuv_instance *s, const V *seed, V *sensitivity) {
    s->component->forward(s->b, seed, sensitivity);
}

UUV_EXPORT void uuv_update_derivatives(uuv_instance *s) {
    uuv_refresh(s);
    s->component->derivatives(s->b, s->scratch, s->b + s->component->n_block);
}

/* Integrates m instances from t to end; gives 1 if there is something to integrate: the values that
 * are held are in `scratch` then. */
static int integrate(uuv_instance *const *s, uint32_t m, double t, double end) {
    const uuv_component *c = s[0]->component;
    const double length = end - t;
    V *b[UUV_TOGETHER], *w[UUV_TOGETHER];
    if (c->n_x == 0 || length <= 0.0) return 0;
    uint32_t n = 1;
    if (length > c->h_max) {
        const double pieces = length / c->h_max;
        n = (uint32_t)pieces;
        if ((double)n < pieces - 1e-6) n++; /* a hair over a whole number is that number */
    }
    for (uint32_t j = 0; j < m; j++) {
        b[j] = s[j]->b;
        w[j] = s[j]->scratch;
    }
    c->integrate(b, w, m, t, n == 1 ? length : length / (double)n, n);
    return 1;
}

/* The sign bit is set if x is not finite: then one more in the exponent's last place carries into it. */
static inline uuv_bits exponent_carry(V x) {
    return (uuv_to_bits(x) & ~UUV_SIGN_BIT) + UINT64_C(0x0010000000000000);
}

/* Ends a step: outputs, and 0 or 1 + the offset of the first value that is not finite. */
static int32_t finish(uuv_instance *s, double end, int held) {
    const uuv_component *c = s->component;
    s->b[0] = broadcast(end);
    if (held)
        c->outputs_of_step(s->b, s->scratch);
    else
        c->outputs(s->b);
    s->outputs_stale = 0;
    uuv_bits bad = uuv_const_bits(0);
    for (uint32_t i = c->off_x; i < c->off_y; i++) bad |= exponent_carry(s->b[i]);
    /* One by one: a load of two outputs would wait until both of their stores have left the queue. */
#if defined(__clang__)
#pragma clang loop vectorize(disable) unroll(disable)
#endif
    for (uint32_t i = c->off_y; i < c->n_block; i++) bad |= exponent_carry(s->b[i]);
    if (!uuv_any(bad & UUV_SIGN_BIT)) return 0;
    uint32_t i = c->off_x;
    while (uuv_all_finite(s->b[i])) i++;
    return (int32_t)(1 + i);
}

/* The next sample of a clock, in seconds; correctly rounded, as the master's own label of time is. */
static double instant(const uuv_instance *s, uint32_t i) {
    const uuv_clock *clock = &s->component->clocks[i];
    uuv_instant *next = &s->next[i];
    if (next->k != s->k[i]) /* a division, which most steps spare */
        *next = (uuv_instant){s->k[i], (double)(s->k[i] * clock->period_num) / (double)clock->period_den};
    return next->t;
}

static void tick(uuv_instance *s, uint32_t i) {
    const uuv_component *c = s->component;
    const uuv_clock *clock = &c->clocks[i];
    V *draws = s->scratch + c->n_held;
    if (clock->n_draws) {
        const uint32_t seed0 = (uint32_t)(int32_t)uuv_lane(s->b[c->off_seed], 0);
        const uint32_t seed1 = (uint32_t)(int32_t)uuv_lane(s->b[c->off_seed + 1], 0);
        uuv_normal(seed0, seed1, clock->index, s->k[i], clock->n_draws, (double *)draws);
    }
    s->b[0] = broadcast(instant(s, i));
    clock->update(s->b, draws, ~(uuv_mask)0);
    s->k[i]++;
}

/* The clock that is due first, before *at, which becomes its instant; n_clocks if none is. */
static uint32_t first_due(const uuv_instance *s, double *at) {
    const uuv_component *c = s->component;
    uint32_t next = c->n_clocks;
    for (uint32_t i = 0; i < c->n_clocks; i++) {
        const double due = instant(s, i);
        if (due < *at) {
            *at = due;
            next = i;
        }
    }
    return next;
}

UUV_EXPORT void uuv_take_samples(uuv_instance *s, double t) {
    uuv_refresh(s);
    for (;;) { /* an importer's time may be off by a few units in the last place */
        double at = t + 1e-12 + 1e-14 * __builtin_fabs(t);
        const uint32_t next = first_due(s, &at);
        if (next == s->component->n_clocks) break;
        tick(s, next);
    }
    s->b[0] = broadcast(t);
    s->outputs_stale = 1;
}

UUV_EXPORT double uuv_next_sample(const uuv_instance *s) {
    double at = __builtin_inf();
    first_due(s, &at);
    return at;
}

UUV_EXPORT int32_t uuv_do_step(uuv_instance *s, double t, double h) {
    const uuv_component *c = s->component;
    const double end = t + h;
    const double tolerance = 1e-6 * h; /* for masters that accumulate time */
    double now = t;
    uuv_refresh(s);
    for (;;) {
        double at = end - tolerance;
        const uint32_t next = first_due(s, &at);
        if (next == c->n_clocks) break;
        if (at > now + tolerance) {
            integrate(&s, 1, now, at);
            now = at;
        }
        tick(s, next);
    }
    return finish(s, end, integrate(&s, 1, now, end));
}

UUV_EXPORT uint32_t uuv_do_steps(uuv_instance *const *s, uint32_t n, double t, double h, int32_t *bad) {
    const uuv_component *c = s[0]->component;
    uint32_t i = 0;
    if (n == 1 || c->n_clocks || c->n_x > UUV_SMALL) {
        for (; i < n; i++)
            if ((*bad = uuv_do_step(s[i], t, h))) return i;
        return n;
    }
    for (uint32_t m; i < n; i += m) {
        m = n - i < UUV_TOGETHER ? n - i : UUV_TOGETHER;
        for (uint32_t j = 0; j < m; j++) uuv_refresh(s[i + j]);
        const int held = integrate(s + i, m, t, t + h);
        for (uint32_t j = 0; j < m; j++)
            if ((*bad = finish(s[i + j], t + h, held))) return i + j;
    }
    return n;
}

UUV_EXPORT size_t uuv_state_size(const uuv_instance *s) {
    return s->component->n_block * sizeof(V) + (s->component->n_clocks + 1) * sizeof(uint64_t);
}

UUV_EXPORT void uuv_get_state(const uuv_instance *s, void *out) {
    const size_t n = s->component->n_block * sizeof(V);
    const uint64_t flags = (uint64_t)(s->dirty | s->outputs_stale << 1 | s->initialized << 2);
    char *p = out;
    memcpy(p, s->b, n);
    memcpy(p + n, s->k, s->component->n_clocks * sizeof *s->k);
    memcpy(p + n + s->component->n_clocks * sizeof *s->k, &flags, sizeof flags);
}

UUV_EXPORT void uuv_set_state(uuv_instance *s, const void *in) {
    const size_t n = s->component->n_block * sizeof(V);
    uint64_t flags;
    const char *p = in;
    memcpy(s->b, p, n);
    memcpy(s->k, p + n, s->component->n_clocks * sizeof *s->k);
    memcpy(&flags, p + n + s->component->n_clocks * sizeof *s->k, sizeof flags);
    s->dirty = (int)(flags & 1);
    s->outputs_stale = (int)(flags >> 1 & 1);
    s->initialized = (int)(flags >> 2 & 1);
}

UUV_EXPORT const uuv_variable *uuv_find(const uuv_component *c, uint32_t offset) {
    uint32_t low = 0, high = c->n_variables;
    while (low < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (c->variables[middle].offset < offset)
            low = middle + 1;
        else
            high = middle;
    }
    return low < c->n_variables && c->variables[low].offset == offset ? &c->variables[low] : NULL;
}
