/* The choice of the members that have a fast path, and of their segments; see fast_path.h. */
#include "fast_path.h"

#include <float.h>
#include <stdlib.h>
#include <string.h>

static int has_fast_path(const member *m) {
    if (m->kind != &kind_fmi1 && m->kind != &kind_fmi2 && m->kind != &kind_fmi3) return 0;
    if (m->sequential || m->group || m->n_sets > 1 || m->n_gets > 1) return 0;
    if (m->n_sets && (m->sets->type != UUV_CORE_FLOAT64 || m->sets->negated)) return 0;
    if (m->n_gets && (m->gets->type != UUV_CORE_FLOAT64 || m->gets->negated)) return 0;
    for (uint32_t i = 0; i < m->n_transfers; i++)
        if (!m->transfers[i].copy || m->transfers[i].early) return 0;
    return 1;
}

/* Adds a value to the last part if it continues that, else a new part; 0: no memory. */
static int add_value(const uuv_core *core, part **parts, uint32_t *n, uint32_t slot, uint32_t offset) {
    part *last = *n ? &(*parts)[*n - 1] : NULL;
    if (last && last->class == core->classes[slot] && last->slot + last->count == slot &&
        last->offset + last->count == offset) {
        last->count++;
        return 1;
    }
    part *next = append((void **)parts, n, sizeof *next);
    if (next) *next = (part){slot, offset, 1, core->classes[slot]};
    return next != NULL;
}

static int add_bounds(const uuv_core *core, in_place *v, uint32_t slot) {
    const double low = core->low[slot], high = core->high[slot];
    if (low <= -DBL_MAX && high >= DBL_MAX) return 1; /* outputs are finite */
    bounded *next = append((void **)&v->bounds, &v->n_bounds, sizeof *next);
    if (next) *next = (bounded){low, high, slot};
    return next != NULL;
}

/* Copies of floating-point numbers go straight to the component; others by way of their slots. */
static int add_copies(const uuv_core *core, member *m, uint8_t *is_copied) {
    in_place *v = &m->values;
    for (uint32_t i = 0; i < m->n_transfers; i++) {
        transfer *t = &m->transfers[i];
        const uint32_t source = t->source + (t->early ? core->n_slots : 0);
        t->in_place = t->copy && t->target_class == CLASS_FLOAT;
        for (uint32_t k = 0, n; t->in_place && k < t->count; k += n) {
            const uint32_t slot = t->target + k, *offset = v->offsets + (slot - v->first_in);
            n = k + 1 < t->count && offset[1] == offset[0] + 1 ? 2 : 1;
            copied *next = n == 2 ? append((void **)&v->pairs, &v->n_pairs, sizeof *next)
                                  : append((void **)&v->copies, &v->n_copies, sizeof *next);
            if (!next) return 0;
            *next = (copied){source + k, slot, *offset};
            for (uint32_t s = slot; s < slot + n; s++)
                if (!add_bounds(core, v, s)) return 0;
            memset(is_copied + (slot - v->first_in), 1, n);
        }
    }
    for (uint32_t i = 0; i < v->n_in; i++)
        if (!is_copied[i] && !add_value(core, &v->writes, &v->n_writes, v->first_in + i, v->offsets[i])) return 0;
    for (uint32_t i = 0; i < v->n_out; i++)
        if (!add_value(core, &v->reads, &v->n_reads, v->first_out + i, v->offsets[v->n_in + i])) return 0;
    return 1;
}

void free_values(member *m) {
    in_place *v = &m->values;
    free(v->pairs), free(v->copies), free(v->writes), free(v->reads), free(v->bounds);
    v->pairs = v->copies = NULL;
    v->writes = v->reads = NULL;
    v->bounds = NULL;
    v->n_pairs = v->n_copies = v->n_writes = v->n_reads = v->n_bounds = 0;
}

static int find_values(const uuv_core *core, member *m) {
    in_place *v = &m->values;
    uint8_t *is_copied = calloc(v->n_in + 1, 1);
    free_values(m);
    const int done = is_copied && add_copies(core, m, is_copied);
    free(is_copied);
    find_block(m);
    return done;
}

void find_block(member *m) {
    in_place *v = &m->values;
    uuv_instance *s = m->instance;
    if (v->find)
        v->find(m->instance, &v->at);
    else
        v->at = (uuv_values){s->b, &s->dirty, &s->outputs_stale};
}

int find_fast_paths(uuv_core *core) {
    for (member *m = core->members; m < core->members + core->n_members; m++) {
        fast_path *s = &m->fast;
        *s = (fast_path){0};
        if (m->values.offsets && !m->group) {
            if (!find_values(core, m)) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
            s->how = IN_PLACE;
            continue;
        }
        if (!has_fast_path(m)) continue;
        s->how = m->kind == &kind_fmi1 ? FMI1 : m->kind == &kind_fmi2 ? FMI2 : FMI3;
        if (m->n_sets) {
            s->set = m->sets->function;
            s->set_references = m->sets->references;
            s->n_set_references = m->sets->n_references;
            s->n_set = m->sets->n_values;
            s->set_slot = m->sets->slot;
            s->alone = s->n_set == 1 && m->n_transfers == 1 && m->transfers->target == s->set_slot;
            s->alone_source = s->alone ? m->transfers->source : 0;
        }
        if (m->n_gets) {
            s->get = m->gets->function;
            s->get_references = m->gets->references;
            s->n_get_references = m->gets->n_references;
            s->n_get = m->gets->n_values;
            s->get_slot = m->gets->slot;
        }
    }
    return 1;
}

void find_segments(uuv_core *core) {
    segment *s = core->segments - 1;
    core->n_faulty = 0;
    for (member *m = core->members; m < core->members + core->n_members; m++) {
        const int plain = m->step_ticks == 1 && m->due == core->tick && !m->n_faults;
        core->n_faulty += m->n_faults != 0;
        const uint32_t own = plain ? m->fast.how : GENERAL, is_fmi1 = own == FMI1, how = is_fmi1 ? FMI2 : own;
        if (m == core->members || s->how != how || s->is_fmi1 != is_fmi1) *++s = (segment){m, m, how, is_fmi1};
        s->end = m + 1;
    }
    for (uint32_t i = core->n_members; i--;) { /* equal members that wait for none of each other */
        member *const m = core->members + i, *const next = m + 1;
        const int joins = i + 1 < core->n_members && next->values.steps == m->values.steps &&
                          !m->sequential && !next->sequential;
        m->values.together = joins ? 1 + next->values.together : 1;
    }
    core->n_segments = (uint32_t)(s + 1 - core->segments);
}
