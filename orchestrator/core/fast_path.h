/* Fast paths of members in no iterated group. A component of this package is read and written in
 * place, in its own block of values. Of another FMU whose connected and recorded values are all
 * Float64, the FMI functions and their arguments lie together; those of FMI 1.0 are called as
 * those of FMI 2.0, except for the type of a Boolean. Members that follow each other, step
 * at each tick and have no fault are a segment, which is stepped without a look at what is due. */
#ifndef UUV_CORE_FAST_PATH_H
#define UUV_CORE_FAST_PATH_H

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include "values.h"

/* Looks at every member once the tables are complete. 0: no memory. */
int find_fast_paths(uuv_core *core);
/* Looks at which members can be stepped together from the present communication point on. */
void find_segments(uuv_core *core);
void free_values(member *m);

static inline int fast_status(int status, int action, uint32_t slot, uuv_failure *why) {
    if ((unsigned)status <= 1) return 1; /* OK and Warning, in FMI 1.0, 2.0 and 3.0 */
    why->slot = slot;
    return failed(why, UUV_CORE_BAD_STATUS, status, action);
}

/* Says whether a step reached its end, except for rounding. */
static inline int is_whole(double t, double h, double reached) { return reached >= t + h * (1.0 - 1e-6); }

static inline int is_not_finite(uuv_slot s) {
    const uint64_t exponent = UINT64_C(0x7ff0000000000000);
    return (s.u & exponent) == exponent;
}

/* The outputs of a component of this package after its step, which has checked that they are finite.
 * What is stale since is left to the general way. */
static inline int read_in_place(uuv_core *core, member *m) {
    const in_place *v = &m->values;
    if (*v->at.dirty | *v->at.outputs_stale) return read_outputs(core, m);
    for (const part *p = v->reads, *const end = p + v->n_reads; p < end; p++) {
        uuv_slot *restrict const to = m->fresh + p->slot;
        const double *restrict const from = v->at.block + p->offset;
        const uint32_t count = p->count;
        uint32_t k = 0;
        if (p->class == CLASS_FLOAT) {
            for (; k + 2 <= count; k += 2) *(pair *)&to[k].f = *(const pair *)(from + k);
            if (k < count) to[k].f = from[k];
        } else {
            for (; k < count; k++) to[k] = from_block(from[k], p->class);
        }
    }
    return 1;
}

/* Says whether the component's own setter has to look at an input, because it may refuse it. */
static inline int is_outside(double x, double low, double high) { return !(x >= low) | !(x <= high); }

static inline int set_in_place(uuv_core *core, member *m) {
    const in_place *v = &m->values;
    uuv_slot *const slots = core->slots;
    double *const block = v->at.block;
    int outside = core->n_faulty != 0; /* what faults do to a number may leave it infinite */
    for (const copied *c = v->pairs, *const end = c + v->n_pairs; c < end; c++)
        *(pair *)(block + c->offset) = *(pair *)&slots[c->slot].f = *(const pair *)&slots[c->source].f;
    for (const copied *c = v->copies, *const end = c + v->n_copies; c < end; c++)
        block[c->offset] = slots[c->slot].f = slots[c->source].f;
    for (const bounded *b = v->bounds, *const end = b + v->n_bounds; b < end; b++)
        outside |= is_outside(slots[b->slot].f, b->low, b->high);
    if (v->n_writes) {
        for (uint32_t i = 0; i < m->n_transfers; i++)
            if (!m->transfers[i].in_place && !carry(core, &m->transfers[i])) return 0;
        for (const part *p = v->writes; p < v->writes + v->n_writes; p++)
            for (uint32_t k = 0; k < p->count; k++) {
                const double x = block[p->offset + k] = to_block(slots[p->slot + k], p->class);
                outside |= is_outside(x, core->low[p->slot + k], core->high[p->slot + k]);
            }
    }
    *v->at.outputs_stale = 1;
    return !outside || m->kind->set(m, slots, &core->why);
}

/* Steps `n` equal members; gives the one that failed, or NULL. */
static inline member *do_in_place(uuv_core *core, member *m, uint32_t n, double t) {
    uint32_t set = 0;
    int32_t status;
    while (set < n && set_in_place(core, m + set)) set++;
    if (!set) return m;
    calling(m, "its step", "");
    const uint32_t made = m->values.steps(core->instances + (m - core->members), set, t, m->h, &status);
    for (uint32_t i = 0; i < made; i++) m[i].due++;
    if (made == n) return m->sequential && !read_in_place(core, m) ? m : NULL;
    if (made < set) { /* else it is the one whose inputs were refused */
        const int native = m->kind == &kind_native;
        failed(&core->why, native ? UUV_CORE_STATE_NOT_FINITE : UUV_CORE_BAD_STATUS,
               native ? status - 1 : status, UUV_CORE_DO_STEP);
    }
    return m + made;
}

static inline int show_in_place(uuv_core *core, member *m) {
    if (!m->sequential) return read_in_place(core, m);
    const in_place *v = &m->values;
    for (uint32_t s = v->first_out; s < v->first_out + v->n_out; s++) core->slots[s] = core->fresh[s];
    return 1;
}

typedef int fmi1_do_step_function(void *, double, double, char);

static inline const char *verb_of(const uint32_t version, const char *fmi1, const char *fmi2, const char *fmi3) {
    return version == FMI1 ? fmi1 : version == FMI2 ? fmi2 : fmi3;
}

static inline int fast_do(uuv_core *core, member *m, double t, const uint32_t version) {
    const fast_path *s = &m->fast;
    uuv_slot *const slots = core->slots;
    uuv_frame *const at = &core->frame;
    at->component = m->name;
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
        at->verb = verb_of(version, "fmiSetReal", "fmi2SetReal", "fmi3SetFloat64");
        const double *values = &slots[s->set_slot].f;
        if (version != FMI3)
            status = ((fmi2SetRealTYPE *)s->set)(m->instance, s->set_references, s->n_set_references, values);
        else
            status = ((fmi3SetFloat64TYPE *)s->set)(m->instance, s->set_references, s->n_set_references,
                                                    values, s->n_set);
        if (!fast_status(status, UUV_CORE_SET, s->set_slot, &core->why)) return 0;
    }
    at->verb = verb_of(version, "fmiDoStep", "fmi2DoStep", "fmi3DoStep");
    if (version == FMI1) {
        status = ((fmi1_do_step_function *)m->do_step)(m->instance, t, m->h, 1);
    } else if (version == FMI2) {
        status = ((fmi2DoStepTYPE *)m->do_step)(m->instance, t, m->h, never_goes_back(m));
    } else {
        fmi3Boolean event = fmi3False, end = fmi3False, early = fmi3False;
        fmi3Float64 reached = t + m->h;
        status = ((fmi3DoStepTYPE *)m->do_step)(m->instance, t, m->h, never_goes_back(m), &event, &end, &early, &reached);
        if (status <= 1 && end) return failed(&core->why, UUV_CORE_ENDED, is_whole(t, m->h, reached), UUV_CORE_DO_STEP);
        if (status <= 1 && early) return failed(&core->why, UUV_CORE_EARLY_RETURN, status, UUV_CORE_DO_STEP);
    }
    if ((unsigned)status > 1) return failed(&core->why, UUV_CORE_BAD_STATUS, status, UUV_CORE_DO_STEP);
    m->due++;
    return 1;
}

static inline int fast_read(uuv_core *core, member *m, const uint32_t version) {
    const fast_path *s = &m->fast;
    if (!s->n_get) return 1;
    uuv_slot *const to = core->slots + s->get_slot;
    int status;
    core->frame.component = m->name;
    if (version != FMI3)
        status = ((fmi2GetRealTYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f);
    else
        status = ((fmi3GetFloat64TYPE *)s->get)(m->instance, s->get_references, s->n_get_references, &to->f, s->n_get);
    if (!fast_status(status, UUV_CORE_GET, s->get_slot, &core->why)) return 0;
    int bad = 0;
    for (uint32_t i = 0; i < s->n_get; i++) bad |= is_not_finite(to[i]);
    if (bad) {
        uint32_t which;
        all_finite(to, s->n_get, &which);
        core->why.slot = s->get_slot + which;
        return failed(&core->why, UUV_CORE_NOT_FINITE, 0, UUV_CORE_GET);
    }
    return 1;
}

static inline member *do_members(uuv_core *core, const segment *s, double t, const uint32_t how) {
    for (member *m = s->first; m < s->end;) {
        if (how == IN_PLACE) {
            const uint32_t left = (uint32_t)(s->end - m), n = m->values.together < left ? m->values.together : left;
            member *const culprit = do_in_place(core, m, n, t);
            if (culprit) return culprit;
            m += n;
        } else if (!fast_do(core, m++, t, how)) {
            return m - 1;
        }
    }
    return NULL;
}

/* The steps of a segment, and what others see of it afterwards; each gives the member that failed,
 * or NULL. */
static inline member *do_segment(uuv_core *core, const segment *s, double t, const uint32_t how) {
    core->frame.noun = "";
    return how == FMI2 && s->is_fmi1 ? do_members(core, s, t, FMI1) : do_members(core, s, t, how);
}

static inline member *show_segment(uuv_core *core, const segment *s, const uint32_t how) {
    core->frame.noun = "";
    core->frame.verb = how == FMI2 && s->is_fmi1 ? "fmiGetReal" : verb_of(how, "", "fmi2GetReal", "fmi3GetFloat64");
    for (member *m = s->first; m < s->end; m++)
        if (!(how == IN_PLACE ? show_in_place(core, m) : fast_read(core, m, how))) return m;
    return NULL;
}

#endif
