/* FMI 3.0 for Co-Simulation, without and with Event Mode and early return. */
#include "clocks.h"
#include "fmi3FunctionTypes.h"
#include "pack.h"
#include "fast_path.h"

typedef fmi3Status get_function(fmi3Instance, const fmi3ValueReference[], size_t, void *, size_t);
typedef fmi3Status set_function(fmi3Instance, const fmi3ValueReference[], size_t, const void *, size_t);

static int accept(fmi3Status status, int action, uuv_failure *why) {
    if (status == fmi3OK || status == fmi3Warning) return 1;
    return failed(why, UUV_CORE_BAD_STATUS, (int)status, action);
}

static fmi3Status call_set(const member *m, const access *a, const void *values) {
    if (a->type == UUV_CORE_BINARY)
        return ((fmi3SetBinaryTYPE *)a->function)(m->instance, a->references, a->n_references, a->sizes,
                                                  (const fmi3Binary *)values, a->n_values);
    return ((set_function *)a->function)(m->instance, a->references, a->n_references, values, a->n_values);
}

static fmi3Status call_get(const member *m, const access *a, void *values) {
    if (a->type == UUV_CORE_BINARY)
        return ((fmi3GetBinaryTYPE *)a->function)(m->instance, a->references, a->n_references, a->sizes,
                                                  (fmi3Binary *)values, a->n_values);
    return ((get_function *)a->function)(m->instance, a->references, a->n_references, values, a->n_values);
}

int fmi3_set_access(member *m, const access *a, const uuv_slot *slots, uuv_failure *why) {
    why->slot = a->slot; /* says which function failed, if one does */
    calling(m, "fmi3Set", type_name(a->type, 3));
    const void *values = pack(a, slots, BOOLEAN_BOOL, why);
    return values && accept(call_set(m, a, values), UUV_CORE_SET, why);
}

/* Clocked variables are set and read while their clocks are active (clocks.h). */
static int fmi3_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    for (const access *a = m->sets; a < m->sets + m->n_sets; a++) {
        if (a->clocks || (a->discrete && !*m->events->inside)) continue;
        if (!fmi3_set_access(m, a, slots, why)) return 0;
    }
    return 1;
}

/* What a component says of its step. */
typedef struct {
    fmi3Boolean event, terminate, early;
    fmi3Float64 reached;
    fmi3Status status;
} step_answer;

static int make_step(member *m, double t, double h, step_answer *a, uuv_failure *why) {
    *a = (step_answer){.reached = t + h};
    calling(m, "fmi3DoStep", "");
    a->status = ((fmi3DoStepTYPE *)m->do_step)(m->instance, t, h, never_goes_back(m), &a->event, &a->terminate,
                                               &a->early, &a->reached);
    if (!accept(a->status, UUV_CORE_DO_STEP, why)) return 0;
    return !a->terminate || failed(why, UUV_CORE_ENDED, is_whole(t, h, a->reached), UUV_CORE_DO_STEP);
}

static int fmi3_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    step_answer a;
    (void)slots;
    if (!make_step(m, t, h, &a, why)) return 0;
    return !a.early || failed(why, UUV_CORE_EARLY_RETURN, (int)a.status, UUV_CORE_DO_STEP);
}

int fmi3_get_access(member *m, const access *a, uuv_slot *slots, uuv_failure *why) {
    why->slot = a->slot;
    calling(m, "fmi3Get", type_name(a->type, 3));
    if (!accept(call_get(m, a, unpack_buffer(a, slots)), UUV_CORE_GET, why)) return 0;
    return unpack(a, slots, BOOLEAN_BOOL) || failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
}

static int fmi3_get(member *m, uuv_slot *slots, uuv_failure *why) {
    for (const access *a = m->gets; a < m->gets + m->n_gets; a++)
        if (!a->clocks && !fmi3_get_access(m, a, slots, why)) return 0;
    return 1;
}

const kind kind_fmi3 = {fmi3_set, fmi3_do_step, fmi3_get};

/* ---- with Event Mode ---------------------------------------------------------------------- */

static int fmi3_step_to_event(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    step_answer a;
    (void)slots;
    if (!make_step(m, t, h, &a, why)) return 0;
    m->events->needed = a.event;
    m->events->early = a.early;
    m->events->reached = a.reached;
    return 1;
}

int fmi3_change_mode(member *m, int inside, uuv_failure *why) {
    if (*m->events->inside == inside) return 1;
    calling(m, inside ? "fmi3EnterEventMode" : "fmi3EnterStepMode", "");
    /* Both functions have one type. */
    fmi3EnterEventModeTYPE *const change = inside ? m->events->enter : m->events->leave;
    *m->events->inside = inside;
    return accept(change(m->instance), inside ? UUV_CORE_ENTER_EVENT_MODE : UUV_CORE_ENTER_STEP_MODE, why);
}

int fmi3_update_discrete_states(member *m, int *again, uuv_failure *why) {
    fmi3Boolean needed = fmi3False, terminate = fmi3False, nominals = fmi3False, values = fmi3False,
                defined = fmi3False;
    fmi3Float64 next = 0.0;
    calling(m, "fmi3UpdateDiscreteStates", "");
    const fmi3Status status = ((fmi3UpdateDiscreteStatesTYPE *)m->events->update)(
        m->instance, &needed, &terminate, &nominals, &values, &defined, &next);
    if (!accept(status, UUV_CORE_UPDATE_DISCRETE_STATES, why)) return 0;
    if (terminate) return failed(why, UUV_CORE_ENDED, 0, UUV_CORE_UPDATE_DISCRETE_STATES);
    *again = needed;
    return 1;
}

/* ---- clocks ------------------------------------------------------------------------------- */

int fmi3_get_clock(member *m, uint32_t reference, int *active, uuv_failure *why) {
    fmi3Clock ticks = fmi3ClockInactive;
    calling(m, "fmi3GetClock", "");
    const fmi3Status status = ((fmi3GetClockTYPE *)m->events->clocks->get)(m->instance, &reference, 1, &ticks);
    *active = ticks == fmi3ClockActive;
    return accept(status, UUV_CORE_GET_CLOCK, why);
}

int fmi3_set_clocks(member *m, const uint32_t *references, uint32_t n, uuv_failure *why) {
    const fmi3Clock active[] = {fmi3ClockActive, fmi3ClockActive, fmi3ClockActive, fmi3ClockActive};
    calling(m, "fmi3SetClock", "");
    for (uint32_t i = 0; i < n; i += 4) {
        const uint32_t some = n - i < 4 ? n - i : 4;
        if (!accept(((fmi3SetClockTYPE *)m->events->clocks->set)(m->instance, references + i, some, active),
                    UUV_CORE_SET_CLOCK, why))
            return 0;
    }
    return 1;
}

int fmi3_get_interval(member *m, uint32_t reference, int fraction, double *interval, int *qualifier,
                      uuv_failure *why) {
    const struct clocks *c = m->events->clocks;
    fmi3IntervalQualifier q = fmi3IntervalNotYetKnown;
    fmi3UInt64 counter = 0, resolution = 0;
    fmi3Status status;
    calling(m, fraction ? "fmi3GetIntervalFraction" : "fmi3GetIntervalDecimal", "");
    if (fraction) {
        status = ((fmi3GetIntervalFractionTYPE *)c->fraction)(m->instance, &reference, 1, &counter, &resolution, &q);
        *interval = (double)counter / (double)resolution;
    } else {
        status = ((fmi3GetIntervalDecimalTYPE *)c->decimal)(m->instance, &reference, 1, interval, &q);
    }
    *qualifier = (int)q;
    return accept(status, fraction ? UUV_CORE_GET_INTERVAL_FRACTION : UUV_CORE_GET_INTERVAL_DECIMAL, why);
}

const kind kind_fmi3_events = {fmi3_set, fmi3_step_to_event, fmi3_get};
