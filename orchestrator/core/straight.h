/* The common case without detours: an FMU whose connected and recorded values are all Float64, in
 * no group. What a step of it needs lies together, and is called from the loop itself. */
#ifndef UUV_CORE_STRAIGHT_H
#define UUV_CORE_STRAIGHT_H

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include "tables.h"

/* Looks at every member once the tables are complete. */
void find_straight(uuv_core *core);

/* Steps all members, which are straight, of one version, and due at each tick, and shows what they
 * give; gives the one that failed. Meanwhile their `due` is left as it was: see `settle`. */
member *lockstep(uuv_core *core, double t);

static inline int straight_status(int status, int action, uint32_t slot, uuv_failure *why) {
    if ((unsigned)status <= 1) return 1; /* OK and Warning, in FMI 2.0 and 3.0 */
    why->slot = slot;
    return failed(why, UUV_CORE_BAD_STATUS, status, action);
}

static inline int straight_do(uuv_core *core, member *m, double t, const uint32_t version) {
    const straight *s = &m->straight;
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
        const double *values = &slots[s->set_slot].f;
        if (version == 2)
            status = ((fmi2SetRealTYPE *)s->set)(m->instance, s->set_references, s->n_set_references, values);
        else
            status = ((fmi3SetFloat64TYPE *)s->set)(m->instance, s->set_references, s->n_set_references,
                                                    values, s->n_set);
        if (!straight_status(status, UUV_CORE_SET, s->set_slot, &core->why)) return 0;
    }
    if (version == 2) {
        status = ((fmi2DoStepTYPE *)m->do_step)(m->instance, t, m->h, fmi2True);
    } else {
        fmi3Boolean event = fmi3False, end = fmi3False, early = fmi3False;
        fmi3Float64 reached = t;
        status = ((fmi3DoStepTYPE *)m->do_step)(m->instance, t, m->h, fmi3True, &event, &end, &early, &reached);
        if (status <= 1 && end) return failed(&core->why, UUV_CORE_ENDED, status, UUV_CORE_DO_STEP);
        if (status <= 1 && early) return failed(&core->why, UUV_CORE_EARLY_RETURN, status, UUV_CORE_DO_STEP);
    }
    if ((unsigned)status > 1) return failed(&core->why, UUV_CORE_BAD_STATUS, status, UUV_CORE_DO_STEP);
    return 1;
}

static inline int straight_step(uuv_core *core, member *m, double t) {
    if (!straight_do(core, m, t, m->straight.version)) return 0;
    m->due += m->step_ticks;
    return 1;
}

static inline int straight_read(uuv_core *core, member *m, const uint32_t version) {
    const straight *s = &m->straight;
    if (!s->n_get) return 1;
    uuv_slot *const to = core->slots + s->get_slot;
    int status;
    if (version == 2)
        status = ((fmi2GetRealTYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f);
    else
        status = ((fmi3GetFloat64TYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f, s->n_get);
    if (!straight_status(status, UUV_CORE_GET, s->get_slot, &core->why)) return 0;
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

static inline int straight_show(uuv_core *core, member *m) {
    if (!straight_read(core, m, m->straight.version)) return 0;
    if (m->n_faults) apply_faults(core, m, core->slots);
    return 1;
}

#endif
