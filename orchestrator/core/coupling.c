/* The table of delayed connections, and what was measured of them (coupling.h). */
#include "coupling.h"

#include <stdlib.h>
#include <string.h>

/* Those that see a new value in the same step are not delayed. */
static int delays(const transfer *t) {
    return (!t->early || t->early == IN_EVENTS) && !t->pairs && t->source_class == CLASS_FLOAT && t->target_class == CLASS_FLOAT;
}

/* A span whose slots continue those of the one before it, with the same times, becomes part of it. */
static int continues(const span *last, const span *next) {
    return last->to == next->to && last->delay == next->delay && last->factor == next->factor &&
           last->offset == next->offset && last->source + last->count == next->source &&
           last->target + last->count == next->target;
}

static void list(uuv_core *core, int plain, uint32_t *n_values) {
    const uint32_t begin = core->n_spans;
    for (uint32_t i = 0; i < core->n_members; i++)
        for (uint32_t k = 0; k < core->members[i].n_transfers; k++) {
            const transfer *t = &core->members[i].transfers[k];
            if (!delays(t) || t->copy != plain) continue;
            const span next = {.source = t->source, .target = t->target, .count = t->count, .first = *n_values,
                               .to = core->members[i].step_ticks == 1 ? UINT32_MAX : i,
                               .delay = core->members[t->from].step_ticks + core->members[i].step_ticks,
                               .factor = t->factor, .offset = t->offset};
            for (uint32_t v = 0; v < t->count; v++) core->coupling_of[*n_values + v] = core->n_couplings;
            core->couplings[core->n_couplings++] = (coupling){t->source, t->target, t->count, *n_values};
            *n_values += t->count;
            span *last = core->spans + core->n_spans - 1;
            if (core->n_spans > begin && continues(last, &next))
                last->count += t->count;
            else
                core->spans[core->n_spans++] = next;
        }
}

static int is_short(const span *s) { return s->to == UINT32_MAX && s->delay == 2 && s->count < 8; }

/* Puts the short ones behind the others, and lists their values. */
static void list_singles(uuv_core *core, span *place) {
    memcpy(place, core->spans, core->n_spans * sizeof *place);
    uint32_t n = 0;
    for (uint32_t i = 0; i < core->n_spans; i++)
        if (!is_short(&place[i])) core->spans[n++] = place[i];
    core->n_long = n;
    for (uint32_t i = 0; i < core->n_spans; i++)
        if (is_short(&place[i])) core->spans[n++] = place[i];
    for (const span *s = core->spans + core->n_long; s < core->spans + n; s++) {
        uint32_t k = 0;
        for (; k + 2 <= s->count; k += 2)
            core->twins[core->n_twins++] = (single){s->source + k, s->target + k, s->first + k};
        if (k < s->count)
            core->singles[core->n_singles++] = (single){s->source + k, s->target + k, s->first + k};
    }
}

int find_couplings(uuv_core *core) {
    size_t n = 1, n_values = 1;
    uint32_t listed = 0;
    if (core->couplings) return 1;
    for (uint32_t i = 0; i < core->n_members; i++)
        for (uint32_t k = 0; k < core->members[i].n_transfers; k++, n++) n_values += core->members[i].transfers[k].count;
    core->largest = calloc(n, sizeof *core->largest);
    core->spans = calloc(n, sizeof *core->spans);
    core->twins = calloc(n_values, sizeof *core->twins);
    core->singles = calloc(n_values, sizeof *core->singles);
    core->most = calloc(n_values, sizeof *core->most);
    core->coupling_of = calloc(n_values, sizeof *core->coupling_of);
    core->couplings = calloc(n, sizeof *core->couplings);
    span *place = calloc(n, sizeof *place);
    if (!place || !core->largest || !core->spans || !core->twins || !core->singles || !core->most || !core->coupling_of || !core->couplings)
        return free(place), failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
    if (!core->unmeasured) list(core, 1, &listed);
    list_singles(core, place);
    free(place);
    core->n_plain = core->n_spans;
    if (!core->unmeasured) list(core, 0, &listed);
    clear_couplings(core);
    return 1;
}

void clear_couplings(uuv_core *core) {
    for (uint32_t i = 0; i < core->n_couplings; i++) {
        const coupling *c = &core->couplings[i];
        core->largest[i] = (uuv_coupling){.source_slot = c->source, .target_slot = c->target};
    }
    for (span *s = core->spans; s < core->spans + core->n_spans; s++) {
        s->since = core->tick + s->delay;
        for (uint32_t k = 0; k < s->count; k++) core->most[s->first + k] = 0.0;
    }
}

void note_residuals(uuv_core *core, const span *s) {
    for (uint32_t k = 0; k < s->count; k++) {
        const uint32_t source = s->source + k, target = s->target + k, i = core->coupling_of[s->first + k];
        const double turn = core->turns[target], due = s->factor * core->slots[source].f + s->offset;
        double residual = fabs(due - core->slots[target].f);
        /* A wrapped angle jumps by one turn; one that changes by more is no such angle, or diverges. */
        if (residual > 0.5 * turn && residual < 1.5 * turn) residual = fabs(residual - turn);
        if (!(residual > core->most[s->first + k])) continue;
        core->largest[i] = (uuv_coupling){
            .source_slot = source, .target_slot = target, .residual = residual,
            .relative = residual / (1.0 + fabs(core->slots[target].f)), .tick = core->tick};
        const coupling *c = &core->couplings[i];
        for (uint32_t v = 0; v < c->count; v++) core->most[c->first + v] = residual;
    }
}

UUV_CORE_API void uuv_core_angle(uuv_core *core, uint32_t slot, double turn) { core->turns[slot] = turn; }

UUV_CORE_API void uuv_core_measure_nothing(uuv_core *core) { core->unmeasured = 1; }

UUV_CORE_API uint32_t uuv_core_couplings(const uuv_core *core) { return core->n_couplings; }

UUV_CORE_API void uuv_core_coupling(const uuv_core *core, uint32_t i, uuv_coupling *coupling_) {
    *coupling_ = core->largest[i];
}
