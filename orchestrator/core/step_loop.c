/* The stepping loop. Start reading at `uuv_core_run`. */
#include "uuv_core.h"

#include <string.h>

#include "budget.h"
#include "coupling.h"
#include "events.h"
#include "iterate.h"
#include "record.h"
#include "fast_path.h"
#include "variable_step.h"

/* Seconds at a communication point: from integers, rounded once, never summed up. */
static double seconds_at(const uuv_core *core, uint64_t tick) {
    return (double)(tick * core->num) / (double)core->den;
}

/* Copies what a member's last step produced to where everybody sees it. */
static int make_visible(uuv_core *core, member *m) {
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        for (uint32_t s = a->slot; s < a->slot + a->n_values; s++) {
            if (a->class != CLASS_BLOB)
                core->slots[s] = core->fresh[s];
            else if (!blob_assign(core->slots[s].blob, core->fresh[s].blob->data, core->fresh[s].blob->size))
                return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        }
    }
    return 1;
}

/* Reads a member's outputs, and refuses values that are not finite. */
int read_outputs(uuv_core *core, member *m) {
    if (m->n_gets == 0) return 1;
    if (!m->kind->get(m, m->fresh, &core->why)) return 0;
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        uint32_t which;
        if (a->class == CLASS_FLOAT && !all_finite(m->fresh + a->slot, a->n_values, &which)) {
            core->why.slot = a->slot + which;
            return failed(&core->why, UUV_CORE_NOT_FINITE, 0, UUV_CORE_GET);
        }
    }
    return 1;
}

/* At the point where its step ends, everybody sees a member's outputs, with their faults: of an
 * iterated group only the others do, and the group itself agrees on what is true. */
static int show_outputs(uuv_core *core, member *m) {
    if (!(m->sequential ? make_visible : read_outputs)(core, m)) return 0;
    if (m->n_faults && (!m->sequential || m->group)) apply_faults(core, m, core->slots);
    return 1;
}

/* Inputs from the outputs that are valid now, then one communication step of the member. */
static int step_member(uuv_core *core, member *m, double t) {
    if (!transfer_inputs(core, m)) return 0;
    if (!m->kind->set(m, core->slots, &core->why)) return 0;
    if (!m->kind->do_step(m, core->slots, t, m->h, &core->why)) return 0;
    m->due += m->step_ticks;
    if (!m->sequential) return 1;
    if (!read_outputs(core, m)) return 0;
    apply_faults(core, m, core->fresh);
    return 1;
}

/* Begins the step of a member that steps elsewhere, beside the others of the tick: what they read
 * was valid at its start, so nothing depends on who ends first. */
static int post_step(uuv_core *core, member *m, double t) {
    if (!transfer_inputs(core, m)) return 0;
    if (!m->kind->set(m, core->slots, &core->why)) return 0;
    if (!m->kind->post(m, t, m->h, &core->why)) return 0;
    m->stepping = 1;
    core->n_stepping++;
    return 1;
}

/* Waits for all steps that were posted; gives the first member that failed, or NULL. */
static member *collect_steps(uuv_core *core) {
    member *culprit = NULL;
    uuv_failure first = core->why;
    for (member *m = core->members; core->n_stepping; m++) {
        if (!m->stepping) continue;
        m->stepping = 0;
        core->n_stepping--;
        if (m->kind->collect(m, &core->why)) {
            m->due += m->step_ticks;
        } else if (!culprit) {
            culprit = m;
            first = core->why;
        }
    }
    core->why = first;
    return culprit;
}

/* Steps a member, or its whole group if that is iterated; gives the one that failed. */
static int step(uuv_core *core, member **m, double t) {
    if ((*m)->events) return step_event_group(core, m, t);
    iteration *group = (*m)->group;
    if (!group) return ((*m)->kind->post && !(*m)->sequential ? post_step : step_member)(core, *m, t);
    if (step_group(core, group, t)) return 1;
    *m = core->members + group->culprit;
    return 0;
}

static int32_t stop(uuv_core *core, const member *m) {
    const member *before = core->n_stepping ? collect_steps(core) : NULL;
    if (before) m = before; /* as if they stepped one after the other */
    core->why.member = (uint32_t)(m - core->members);
    core->why.tick = core->tick;
    return core->why.outcome;
}

/* Steps the members of a segment that are due; gives the one that failed. */
static member *step_segment(uuv_core *core, const segment *s, double t) {
    switch (s->how) {
    case IN_PLACE: return do_segment(core, s, t, IN_PLACE);
    case FMI2: return do_segment(core, s, t, FMI2);
    case FMI3: return do_segment(core, s, t, FMI3);
    default:
        for (member *m = s->first; m < s->end; m++)
            if (m->due == core->tick && !step(core, &m, t)) return m;
        return NULL;
    }
}

/* Shows what the members of a segment give at this communication point; gives the one that failed. */
static member *show(uuv_core *core, const segment *s) {
    switch (s->how) {
    case IN_PLACE: return show_segment(core, s, IN_PLACE);
    case FMI2: return show_segment(core, s, FMI2);
    case FMI3: return show_segment(core, s, FMI3);
    default:
        for (member *m = s->first; m < s->end; m++)
            if (m->due == core->tick && !show_outputs(core, m)) return m;
        return NULL;
    }
}

/* Steps all that are due, and shows what they give at the next communication point; gives the one
 * that failed. */
static member *step_due(uuv_core *core, double t) {
    const segment *const end = core->segments + core->n_segments;
    member *culprit = NULL;
    for (const segment *s = core->segments; !culprit && s < end; s++) culprit = step_segment(core, s, t);
    if (!culprit && core->n_stepping) culprit = collect_steps(core);
    if (culprit) return culprit;
    core->tick += core->stride;
    for (const segment *s = core->segments; !culprit && s < end; s++) culprit = show(core, s);
    return culprit;
}

static void collect_all(uuv_core *core) {
    if (core->n_stepping) collect_steps(core);
}

/* Makes communication steps; the members stand in stepping order. Outputs are read only at the
 * point where their step ends, so that within a tick everybody sees the values valid at its
 * start (Jacobi). The exceptions are transfers marked `early` (Gauss-Seidel), and iterated groups,
 * which step when their first member is due. */
UUV_CORE_API int32_t uuv_core_run(uuv_core *core, uint64_t n_ticks, double seconds) {
    const uint64_t last = core->tick + n_ticks;
    member *culprit = NULL;
    budget wall = budget_of(seconds);
    if (!find_couplings(core) || !find_event_groups(core)) return stop(core, core->members);
    find_segments(core);
    enter(core);
    while (core->tick < last && !record_is_full(core) && !budget_is_spent(&wall)) {
        culprit = core->varied ? vary(core, step_due, collect_all) : step_due(core, seconds_at(core, core->tick));
        if (culprit) break;
        if (!core->varied || core->varied->now.counts.steps > 1) measure_couplings(core);
        if (!record_row(core)) culprit = core->members;
        if (culprit) break;
    }
    leave(core);
    return culprit ? stop(core, culprit) : UUV_CORE_GOOD;
}

static int32_t begin(uuv_core *core, uint64_t tick) {
    core->tick = tick;
    core->record.next = tick;
    if (!find_fast_paths(core) || !find_couplings(core) || !begin_variable_step(core) || !find_event_groups(core))
        return stop(core, core->members);
    clear_couplings(core);
    for (member *m = core->members; m < core->members + core->n_members; m++) {
        m->due = tick;
        if (!read_outputs(core, m)) return stop(core, m);
        if (m->sequential && !make_visible(core, m)) return stop(core, m);
    }
    member *at = core->members;
    if (!begin_events(core, &at)) return stop(core, at);
    for (member *m = core->members; m < core->members + core->n_members; m++)
        if (m->events && !make_visible(core, m)) return stop(core, m);
    return record_row(core) ? UUV_CORE_GOOD : stop(core, core->members);
}

UUV_CORE_API int32_t uuv_core_begin(uuv_core *core, uint64_t tick) {
    enter(core);
    const int32_t outcome = begin(core, tick);
    leave(core);
    return outcome;
}

UUV_CORE_API int32_t uuv_core_accept_step(uuv_core *core, uint32_t i) {
    member *m = core->members + i;
    if (m->group || m->events) return 0;
    enter(core);
    m->due += m->step_ticks;
    if (m->sequential && read_outputs(core, m)) apply_faults(core, m, core->fresh);
    leave(core);
    return 1;
}

int failed(uuv_failure *why, int outcome, int status, int action) {
    why->outcome = outcome;
    why->status = status;
    why->action = action;
    return 0;
}

int all_finite(const uuv_slot *slots, uint32_t n, uint32_t *which) {
    const uint64_t exponent = UINT64_C(0x7ff0000000000000);
    int bad = 0;
    for (uint32_t i = 0; i < n; i++) bad |= (slots[i].u & exponent) == exponent;
    if (!bad) return 1;
    for (*which = 0; (slots[*which].u & exponent) != exponent;) ++*which;
    return 0;
}
