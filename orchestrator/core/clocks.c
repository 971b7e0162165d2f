/* Clocks (clocks.h). Start reading at `carry_clocks`. */
#include "clocks.h"

#include <stdlib.h>
#include <string.h>

/* ---- building ----------------------------------------------------------------------------- */

UUV_CORE_API int uuv_core_clocks(uuv_core *core, uint32_t i, void *get, void *set, void *decimal, void *fraction) {
    struct event_mode *e = core->members[i].events;
    e->clocks = calloc(1, sizeof *e->clocks);
    if (!e->clocks) return 0;
    *e->clocks = (struct clocks){.get = get, .set = set, .decimal = decimal, .fraction = fraction};
    return 1;
}

UUV_CORE_API int uuv_core_clock(uuv_core *core, uint32_t i, uint32_t reference, int kind, int asks,
                                uint32_t n_gates, const uint32_t *gates) {
    struct clocks *all = core->members[i].events->clocks;
    struct clock *c = append((void **)&all->all, &all->n, sizeof *c);
    if (!c) return 0;
    *c = (struct clock){.reference = reference, .kind = (uint8_t)kind, .asks = (uint8_t)asks, .n_gates = n_gates};
    c->gates = malloc((n_gates + 1) * sizeof *gates);
    uint32_t *references = realloc(all->references, all->n * sizeof *references);
    if (references) all->references = references;
    if (!c->gates || !references) return 0;
    memcpy(c->gates, gates, n_gates * sizeof *gates);
    return 1;
}

UUV_CORE_API int uuv_core_clock_wire(uuv_core *core, uint32_t from, uint32_t from_clock, uint32_t to,
                                     uint32_t to_clock) {
    clock_wire *w = append((void **)&core->wires, &core->n_wires, sizeof *w);
    if (w) *w = (clock_wire){from, from_clock, to, to_clock};
    return w != NULL;
}

static int belongs(access *accesses, uint32_t n, uint32_t slot, uint32_t n_clocks, const uint32_t *clocks) {
    for (access *a = accesses; a < accesses + n; a++) {
        if (slot < a->slot || slot >= a->slot + a->n_values || a->clocks) continue;
        a->clocks = malloc((n_clocks + 1) * sizeof *clocks);
        if (!a->clocks) return 0;
        a->n_clocks = n_clocks;
        memcpy(a->clocks, clocks, n_clocks * sizeof *clocks);
    }
    return 1;
}

UUV_CORE_API int uuv_core_clocked(uuv_core *core, uint32_t i, uint32_t slot, uint32_t n_clocks,
                                  const uint32_t *clocks) {
    member *m = &core->members[i];
    return belongs(m->sets, m->n_sets, slot, n_clocks, clocks) && belongs(m->gets, m->n_gets, slot, n_clocks, clocks);
}

UUV_CORE_API void uuv_core_clock_parts(uuv_core *core, uint64_t parts) { core->parts = parts; }

UUV_CORE_API void uuv_core_clock_starts(uuv_core *core, uint32_t i, uint32_t k, uint64_t first_tick,
                                        uint64_t first_part, uint64_t whole, uint64_t part, double interval) {
    struct clock *c = core->members[i].events->clocks->all + k;
    c->active = c->ticked = 0;
    c->scheduled = 1;
    c->interval = interval;
    c->whole = whole;
    c->part = part;
    c->exact = 1;
    c->next = (instant){.tick = first_tick, .part = first_part, .exact = 1};
    c->next.offset = (double)(first_part * core->num) / (double)(core->parts * core->den);
    c->last = c->next;
}

UUV_CORE_API void uuv_core_clock_waits(uuv_core *core, uint32_t i, uint32_t k, uint64_t tick, int known,
                                       double interval) {
    struct clock *c = core->members[i].events->clocks->all + k;
    c->active = c->ticked = 0;
    c->exact = 0;
    c->interval = interval;
    c->last = (instant){.tick = tick, .exact = 1};
    c->scheduled = (uint8_t)known;
    if (known) c->next = later(core, c->last, interval);
}

void free_clocks(uuv_core *core) {
    for (uint32_t i = 0; core->members && i < core->n_members; i++) {
        struct event_mode *e = core->members[i].events;
        if (!e || !e->clocks) continue;
        for (uint32_t k = 0; k < e->clocks->n; k++) free(e->clocks->all[k].gates);
        free(e->clocks->all), free(e->clocks->references), free(e->clocks);
    }
    free(core->wires);
}

/* ---- instants ----------------------------------------------------------------------------- */

/* The number of parts that `seconds` are, if they are whole parts to the last bit; else 0 in `whole`. */
static uint64_t parts_of(const uuv_core *core, double seconds, int *whole) {
    const double all = (double)core->parts * (double)core->den, n = seconds * all / (double)core->num + 0.5;
    *whole = n < 9007199254740992.0 && (double)((uint64_t)n * core->num) / all == seconds;
    return *whole ? (uint64_t)n : 0;
}

static instant after_parts(const uuv_core *core, uint64_t tick, uint64_t parts) {
    instant to = {.tick = tick + parts / core->parts, .part = parts % core->parts, .exact = 1};
    to.offset = (double)(to.part * core->num) / ((double)core->parts * (double)core->den);
    return to;
}

instant later(const uuv_core *core, instant from, double seconds) {
    int whole = 0;
    uint64_t n = from.exact ? parts_of(core, seconds, &whole) : 0;
    if (whole) return after_parts(core, from.tick, from.part + n);
    const double s = from.offset + seconds, tick = (double)core->num / (double)core->den;
    if (!(s < 9e15 * tick)) return (instant){.tick = UINT64_MAX};
    n = parts_of(core, s, &whole);
    if (whole) return after_parts(core, from.tick, n);
    n = (uint64_t)(s / tick);
    while (n > 0 && (double)(n * core->num) / (double)core->den > s) n--;
    const double offset = s - (double)(n * core->num) / (double)core->den;
    return (instant){.tick = from.tick + n, .offset = offset};
}

double seconds_from(const uuv_core *core, uint64_t tick, const instant *to) {
    const uint64_t n = to->tick - tick;
    if (to->exact)
        return (double)((n * core->parts + to->part) * core->num) / ((double)core->parts * (double)core->den);
    return (double)(n * core->num) / (double)core->den + to->offset;
}

static int is_before(const instant *a, const instant *b) {
    return a->tick < b->tick || (a->tick == b->tick && a->offset < b->offset);
}

int next_clock(const uuv_core *core, const struct event_group *g, instant *next) {
    int any = 0;
    (void)core;
    for (uint32_t i = 0; i < g->n; i++) {
        const struct clocks *all = g->members[i]->events->clocks;
        for (uint32_t k = 0; all && k < all->n; k++) {
            if (!all->all[k].scheduled || (any && !is_before(&all->all[k].next, next))) continue;
            *next = all->all[k].next;
            any = 1;
        }
    }
    return any;
}

int is_clock_due(const uuv_core *core, const struct event_group *g, const instant *now) {
    instant next;
    return next_clock(core, g, &next) && !is_before(now, &next);
}

/* ---- intervals ---------------------------------------------------------------------------- */

static int bad_interval(uuv_core *core, uint32_t k, double interval) {
    core->why.slot = k;
    core->why.value = interval;
    return failed(&core->why, UUV_CORE_BAD_INTERVAL, 0, UUV_CORE_GET_INTERVAL_DECIMAL);
}

/* After a tick of a periodic clock: its next one. */
static void schedule_next(const uuv_core *core, struct clock *c) {
    c->scheduled = c->kind == UUV_CORE_PERIODIC;
    c->last = c->next;
    if (!c->scheduled) return;
    if (c->exact && c->next.exact)
        c->next = after_parts(core, c->next.tick + c->whole, c->next.part + c->part);
    else
        c->next = later(core, c->next, c->interval);
}

static int ask(uuv_core *core, member *m, uint32_t k, const instant *now) {
    struct clock *c = m->events->clocks->all + k;
    int qualifier = 0;
    double interval = 0.0;
    if (!fmi3_get_interval(m, c->reference, c->asks == UUV_CORE_ASK_FRACTION, &interval, &qualifier, &core->why)) return 0;
    const int ticked = c->ticked;
    c->ticked = 0;
    if (qualifier == UUV_CORE_INTERVAL_UNCHANGED && c->kind == UUV_CORE_CHANGING && ticked) interval = c->interval;
    else if (qualifier != UUV_CORE_INTERVAL_CHANGED) return 1;
    if (!(interval >= 0.0) || (c->kind == UUV_CORE_PERIODIC && interval == 0.0)) return bad_interval(core, k, interval);
    if (c->kind == UUV_CORE_PERIODIC && interval == c->interval) return 1;
    c->interval = interval;
    c->exact = 0;
    c->scheduled = 1;
    c->next = later(core, c->kind == UUV_CORE_COUNTDOWN ? *now : c->last, interval);
    if (c->kind == UUV_CORE_PERIODIC && is_before(&c->next, now)) c->next = *now;
    return 1;
}

int end_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now) {
    for (uint32_t i = 0; i < g->n; i++) {
        member *m = *at = g->members[i];
        struct clocks *all = m->events->clocks;
        for (uint32_t k = 0; all && k < all->n; k++) all->all[k].active = 0;
        for (access *a = m->sets; a < m->sets + m->n_sets; a++) a->was_set = 0;
        for (uint32_t k = 0; all && k < all->n; k++) {
            const struct clock *c = all->all + k;
            if (c->asks && (c->kind != UUV_CORE_CHANGING || c->ticked) && !ask(core, m, k, now)) return 0;
        }
    }
    return 1;
}

/* ---- ticks -------------------------------------------------------------------------------- */

static int tick(uuv_core *core, member *m, uint32_t k, const instant *now) {
    struct clock *c = m->events->clocks->all + k;
    c->active = c->ticked = 1;
    return note_event(core, m, now->tick, now->offset, UUV_CORE_CLOCK + (int)k);
}

/* Activates those of a member that `is_new` marks, in one call. */
static int set_clocks(uuv_core *core, member *m, const instant *now, const uint8_t *is_new, int *any) {
    struct clocks *all = m->events->clocks;
    uint32_t n = 0;
    for (uint32_t k = 0; k < all->n; k++) {
        if (!is_new[k]) continue;
        all->references[n++] = all->all[k].reference;
        if (!tick(core, m, k, now)) return 0;
    }
    *any |= n > 0;
    return !n || fmi3_set_clocks(m, all->references, n, &core->why);
}

int activate_due_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now, int *any) {
    for (uint32_t i = 0; i < g->n; i++) {
        member *m = *at = g->members[i];
        struct clocks *all = m->events->clocks;
        uint8_t *is_new = core->is_new;
        for (uint32_t k = 0; all && k < all->n; k++) {
            struct clock *c = all->all + k;
            is_new[k] = c->scheduled && !is_before(now, &c->next);
            if (is_new[k]) schedule_next(core, c);
        }
        if (all && !set_clocks(core, m, now, is_new, any)) return 0;
    }
    return 1;
}

static int is_open(const struct clocks *all, const uint32_t *gates, uint32_t n) {
    for (uint32_t i = 0; i < n; i++)
        if (all->all[gates[i]].active) return 1;
    return 0;
}

/* Reads the output clocks that do not tick yet: an activation is reported once. */
static int read_clocks(uuv_core *core, member *m, const instant *now, int *any) {
    struct clocks *all = m->events->clocks;
    for (uint32_t k = 0; all && k < all->n; k++) {
        struct clock *c = all->all + k;
        int active = 0;
        if (c->kind != UUV_CORE_TRIGGERED_OUTPUT || c->active) continue;
        if (c->n_gates && !is_open(all, c->gates, c->n_gates)) continue;
        if (!fmi3_get_clock(m, c->reference, &active, &core->why)) return 0;
        if (active && !tick(core, m, k, now)) return 0;
        *any |= active;
    }
    return 1;
}

static int follow_wires(uuv_core *core, member *m, const instant *now, int *any) {
    struct clocks *all = m->events->clocks;
    if (!all) return 1;
    memset(core->is_new, 0, all->n);
    for (const clock_wire *w = core->wires; w < core->wires + core->n_wires; w++)
        if (core->members + w->to == m && core->members[w->from].events->clocks->all[w->from_clock].active &&
            !all->all[w->to_clock].active)
            core->is_new[w->to_clock] = 1;
    return set_clocks(core, m, now, core->is_new, any);
}

/* ---- clocked values ----------------------------------------------------------------------- */

static int read_clocked(uuv_core *core, member *m) {
    for (access *a = m->gets; a < m->gets + m->n_gets; a++) {
        uint32_t which;
        if (!a->clocks || !is_open(m->events->clocks, a->clocks, a->n_clocks)) continue;
        if (!fmi3_get_access(m, a, m->fresh, &core->why)) return 0;
        if (a->class != CLASS_FLOAT || all_finite(m->fresh + a->slot, a->n_values, &which)) continue;
        core->why.slot = a->slot + which;
        return failed(&core->why, UUV_CORE_NOT_FINITE, 0, UUV_CORE_GET);
    }
    return 1;
}

static int set_clocked(uuv_core *core, member *m, int *changed, uint32_t *slot) {
    for (access *a = m->sets; a < m->sets + m->n_sets; a++) {
        if (!a->clocks || !is_open(m->events->clocks, a->clocks, a->n_clocks)) continue;
        int other = 0;
        for (const transfer *t = m->transfers; t < m->transfers + m->n_transfers; t++)
            if (t->target >= a->slot && t->target < a->slot + a->n_values && !carry_value(core, t, 1, &other)) return 0;
        if (a->was_set && !other) continue;
        if (other) *changed = 1, *slot = core->why.slot;
        a->was_set = 1;
        if (!fmi3_set_access(m, a, core->slots, &core->why)) return 0;
    }
    return 1;
}

int carry_clocks(uuv_core *core, const struct event_group *g, member **at, const instant *now, int *any) {
    uint32_t slot = 0;
    for (uint32_t pass = 0; pass < UUV_MOST_ROUNDS; pass++) {
        int changed = 0;
        for (uint32_t i = 0; i < g->n; i++)
            if (!read_clocks(core, *at = g->members[i], now, &changed)) return 0;
        for (uint32_t i = 0; i < g->n; i++)
            if (!follow_wires(core, *at = g->members[i], now, &changed)) return 0;
        *any |= changed;
        if (!*any) return 1;
        for (uint32_t i = 0; i < g->n; i++)
            if (!read_clocked(core, *at = g->members[i])) return 0;
        for (uint32_t i = 0; i < g->n; i++)
            if (!set_clocked(core, *at = g->members[i], &changed, &slot)) return 0;
        if (!changed) return 1;
    }
    core->why.slot = slot;
    return failed(&core->why, UUV_CORE_EVENTS_DO_NOT_END, 0, UUV_CORE_DO_STEP);
}

/* ---- snapshots ---------------------------------------------------------------------------- */

size_t clock_state_size(const uuv_core *core) {
    size_t n = 0;
    for (uint32_t i = 0; i < core->n_members; i++)
        if (core->members[i].events && core->members[i].events->clocks) n += core->members[i].events->clocks->n;
    return n ? n * sizeof(struct clock) + sizeof core->parts : 0;
}

void put_clock_state(const uuv_core *core, char *out) {
    memcpy(out, &core->parts, sizeof core->parts);
    out += sizeof core->parts;
    for (uint32_t i = 0; i < core->n_members; i++) {
        const struct clocks *all = core->members[i].events ? core->members[i].events->clocks : NULL;
        for (uint32_t k = 0; all && k < all->n; k++, out += sizeof(struct clock)) {
            struct clock kept = all->all[k];
            kept.gates = NULL; /* equal states give equal bytes */
            memcpy(out, &kept, sizeof kept);
        }
    }
}

void take_clock_state(uuv_core *core, const char *in) {
    memcpy(&core->parts, in, sizeof core->parts);
    in += sizeof core->parts;
    for (uint32_t i = 0; i < core->n_members; i++) {
        struct clocks *all = core->members[i].events ? core->members[i].events->clocks : NULL;
        for (uint32_t k = 0; all && k < all->n; k++, in += sizeof(struct clock)) {
            uint32_t *const gates = all->all[k].gates;
            memcpy(all->all + k, in, sizeof(struct clock));
            all->all[k].gates = gates;
        }
    }
}
