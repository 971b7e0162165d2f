/* The choice of the members that have a fast path; see fast_path.h. */
#include "fast_path.h"

static int has_fast_path(const member *m) {
    if ((m->kind != &kind_fmi2 && m->kind != &kind_fmi3) || m->sequential || m->group) return 0;
    if (m->n_sets > 1 || m->n_gets > 1) return 0;
    if (m->n_sets && m->sets->type != UUV_CORE_FLOAT64) return 0;
    if (m->n_gets && m->gets->type != UUV_CORE_FLOAT64) return 0;
    for (uint32_t i = 0; i < m->n_transfers; i++)
        if (!m->transfers[i].copy || m->transfers[i].early) return 0;
    return 1;
}

static int in_lockstep(const uuv_core *core) {
    for (const member *m = core->members; m < core->members + core->n_members; m++)
        if (!m->fast.version || m->fast.version != core->members->fast.version ||
            m->step_ticks != 1)
            return 0;
    return 1;
}

void find_fast_paths(uuv_core *core) {
    for (member *m = core->members; m < core->members + core->n_members; m++) {
        fast_path *s = &m->fast;
        *s = (fast_path){0};
        if (!has_fast_path(m)) continue;
        s->version = m->kind == &kind_fmi2 ? 2 : 3;
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
    core->lockstep = in_lockstep(core);
}

static inline member *tick_of(uuv_core *core, double t, const uint32_t version) {
    member *const end = core->members + core->n_members;
    for (member *m = core->members; m < end; m++)
        if (!fast_do(core, m, t, version)) return m;
    core->tick++;
    for (member *m = core->members; m < end; m++)
        if (!fast_read(core, m, version)) return m;
    return NULL;
}

member *lockstep(uuv_core *core, double t) {
    return core->members->fast.version == 2 ? tick_of(core, t, 2) : tick_of(core, t, 3);
}
