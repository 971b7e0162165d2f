/* Fast path: an FMU in no group whose connected and recorded values are all Float64. Its FMI
 * functions and their arguments lie together, and the loop calls them without indirection. */
#ifndef UUV_CORE_FAST_PATH_H
#define UUV_CORE_FAST_PATH_H

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include "tables.h"

/* Looks at every member once the tables are complete. */
void find_fast_paths(uuv_core *core);

/* Steps all members and reads their outputs. All have a fast path of one FMI version and are due
 * at each tick. Returns the member that failed, or NULL. Meanwhile their `due` is left as it was: see `settle`. */
member *lockstep(uuv_core *core, double t);

static inline int fast_status(int status, int action, uint32_t slot, uuv_failure *why) {
    if ((unsigned)status <= 1) return 1; /* OK and Warning, in FMI 2.0 and 3.0 */
    why->slot = slot;
    return failed(why, UUV_CORE_BAD_STATUS, status, action);
}

/* Says whether a step reached its end, except for rounding. */
static inline int is_whole(double t, double h, double reached) { return reached >= t + h * (1.0 - 1e-6); }

static inline int fast_do(uuv_core *core, member *m, double t, const uint32_t version) {
    const fast_path *s = &m->fast;
    uuv_slot *const slots = core->slots;
    if (s->alone) { /* one value comes in: in a chain, all there is to do */
        slots[s->set_slot] = slots[s->alone_source];
    } else {
        for (uint32_t i = 0; i < m->n_transfers; i++) {
            const transfer *c = &m->transfers[i];
            for (uint32_t k = 0; k < c->count; k++) slots[c->target + k] = slots[c->source + k];
        }
    }
    int status = 0;
    if (s->n_set) {
        calling(m, version == 2 ? "fmi2SetReal" : "fmi3SetFloat64", "");
        const double *values = &slots[s->set_slot].f;
        if (version == 2)
            status = ((fmi2SetRealTYPE *)s->set)(m->instance, s->set_references, s->n_set_references, values);
        else
            status = ((fmi3SetFloat64TYPE *)s->set)(m->instance, s->set_references, s->n_set_references,
                                                    values, s->n_set);
        if (!fast_status(status, UUV_CORE_SET, s->set_slot, &core->why)) return 0;
    }
    calling(m, version == 2 ? "fmi2DoStep" : "fmi3DoStep", "");
    if (version == 2) {
        status = ((fmi2DoStepTYPE *)m->do_step)(m->instance, t, m->h, never_goes_back(m));
    } else {
        fmi3Boolean event = fmi3False, end = fmi3False, early = fmi3False;
        fmi3Float64 reached = t + m->h;
        status = ((fmi3DoStepTYPE *)m->do_step)(m->instance, t, m->h, never_goes_back(m), &event, &end, &early, &reached);
        if (status <= 1 && end) return failed(&core->why, UUV_CORE_ENDED, is_whole(t, m->h, reached), UUV_CORE_DO_STEP);
        if (status <= 1 && early) return failed(&core->why, UUV_CORE_EARLY_RETURN, status, UUV_CORE_DO_STEP);
    }
    if ((unsigned)status > 1) return failed(&core->why, UUV_CORE_BAD_STATUS, status, UUV_CORE_DO_STEP);
    return 1;
}

static inline int fast_step(uuv_core *core, member *m, double t) {
    if (!fast_do(core, m, t, m->fast.version)) return 0;
    m->due += m->step_ticks;
    return 1;
}

static inline int fast_read(uuv_core *core, member *m, const uint32_t version) {
    const fast_path *s = &m->fast;
    if (!s->n_get) return 1;
    uuv_slot *const to = core->slots + s->get_slot;
    int status;
    calling(m, version == 2 ? "fmi2GetReal" : "fmi3GetFloat64", "");
    if (version == 2)
        status = ((fmi2GetRealTYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f);
    else
        status = ((fmi3GetFloat64TYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f, s->n_get);
    if (!fast_status(status, UUV_CORE_GET, s->get_slot, &core->why)) return 0;
    const uint64_t exponent = UINT64_C(0x7ff0000000000000);
    int bad = 0;
    for (uint32_t i = 0; i < s->n_get; i++) bad |= (to[i].u & exponent) == exponent;
    if (bad) {
        uint32_t which;
        all_finite(to, s->n_get, &which);
        core->why.slot = s->get_slot + which;
        return failed(&core->why, UUV_CORE_NOT_FINITE, 0, UUV_CORE_GET);
    }
    return 1;
}

static inline int fast_show(uuv_core *core, member *m) {
    if (!fast_read(core, m, m->fast.version)) return 0;
    if (m->n_faults) apply_faults(core, m, core->slots);
    return 1;
}

#endif
