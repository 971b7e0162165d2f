/* Events across FMUs (events.h). Start reading at `step_event_group`. */
#include "clocks.h"

#include <stdlib.h>
#include <string.h>

#include "iterate.h"

UUV_CORE_API int uuv_core_event_mode(uuv_core *core, uint32_t i, uint32_t group, void *enter, void *update,
                                     void *leave, int repeats) {
    member *m = &core->members[i];
    m->events = calloc(1, sizeof *m->events);
    if (!m->events) return 0;
    *m->events = (struct event_mode){.enter = enter, .update = update, .leave = leave, .group = group,
                                     .repeats = repeats};
    m->kind = &kind_fmi3_events;
    m->sequential = 1; /* its outputs are read during the step, and visible at its end */
    m->fresh = core->fresh;
    if (group >= core->n_event_groups) core->n_event_groups = group + 1;
    return 1;
}

UUV_CORE_API void uuv_core_inside(uuv_core *core, uint32_t i, int32_t *inside) {
    core->members[i].events->inside = inside;
}

UUV_CORE_API void uuv_core_discrete(uuv_core *core, uint32_t i, uint32_t slot) {
    member *m = &core->members[i];
    for (access *a = m->sets; a < m->sets + m->n_sets; a++)
        if (slot >= a->slot && slot < a->slot + a->n_values) a->discrete = 1;
}

UUV_CORE_API uint32_t uuv_core_n_events(const uuv_core *core) { return core->n_noted; }

UUV_CORE_API void uuv_core_take_events(uuv_core *core, uuv_event *events) {
    if (core->n_noted) memcpy(events, core->noted, core->n_noted * sizeof *events);
    core->n_noted = 0;
}

void free_events(uuv_core *core) {
    for (uint32_t g = 0; core->event_groups && g < core->n_event_groups; g++) free(core->event_groups[g].members);
    for (uint32_t i = 0; core->members && i < core->n_members; i++) free(core->members[i].events);
    free(core->event_groups), free(core->before), free(core->noted), free(core->is_new);
}

static int inside_group(const uuv_core *core, const member *m, const transfer *t) {
    const member *from = core->members + t->from;
    return from->events && from->events->group == m->events->group;
}

int find_event_groups(uuv_core *core) {
    if (!core->n_event_groups || core->event_groups) return 1;
    core->event_groups = calloc(core->n_event_groups, sizeof *core->event_groups);
    core->before = calloc((size_t)core->n_slots + 1, sizeof *core->before);
    uint32_t most = 0;
    for (const member *m = core->members; m < core->members + core->n_members; m++)
        if (m->events && m->events->clocks && m->events->clocks->n > most) most = m->events->clocks->n;
    core->is_new = calloc(most + 1, 1);
    if (!core->event_groups || !core->before || !core->is_new) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
    for (member *m = core->members; m < core->members + core->n_members; m++) {
        if (!m->events) continue;
        struct event_group *g = core->event_groups + m->events->group;
        member **next = append((void **)&g->members, &g->n, sizeof *next);
        if (!next) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        *next = m;
        for (transfer *t = m->transfers; t < m->transfers + m->n_transfers; t++)
            if (inside_group(core, m, t)) t->early = IN_EVENTS;
    }
    return 1;
}

int note_event(uuv_core *core, const member *m, uint64_t tick, double offset, int cause) {
    if (core->n_noted == core->noted_room) {
        const uint32_t room = 2 * core->noted_room + 64;
        uuv_event *grown = realloc(core->noted, room * sizeof *grown);
        if (!grown) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_DO_STEP);
        core->noted = grown;
        core->noted_room = room;
    }
    core->noted[core->n_noted++] = (uuv_event){tick, offset, (uint32_t)(m - core->members), cause};
    return 1;
}

/* ---- inputs ------------------------------------------------------------------------------- */

static int is_discrete(const member *m, uint32_t slot) {
    for (const access *a = m->sets; a < m->sets + m->n_sets; a++)
        if (slot >= a->slot && slot < a->slot + a->n_values) return a->discrete;
    return 0;
}

static int other_text(const uuv_blob *a, const uuv_blob *b) {
    return a->size != b->size || memcmp(a->data, b->data, a->size) != 0;
}

int carry_value(uuv_core *core, const transfer *t, int counts, int *changed) {
    const int early = core->in_event && t->early == IN_EVENTS;
    const uuv_slot *const source = (early ? core->fresh : core->slots) + t->source;
    for (uint32_t i = 0; i < t->count; i++)
        if (t->source_class != CLASS_BLOB) {
            core->before[t->target + i] = core->slots[t->target + i];
        } else if (counts && other_text(source[i].blob, core->slots[t->target + i].blob)) {
            *changed = 1;
            core->why.slot = t->target + i;
        }
    if (!carry(core, t)) return 0;
    for (uint32_t i = 0; counts && t->source_class != CLASS_BLOB && i < t->count; i++)
        if (core->before[t->target + i].u != core->slots[t->target + i].u) {
            *changed = 1;
            core->why.slot = t->target + i;
        }
    return 1;
}

/* Carries values to a member's inputs: in Event Mode those of its group, else all; clocked ones only
 * while a clock is active (clocks.h). `changed` becomes 1 if an input, or at a step's start a discrete
 * one, has another value than before. */
static int carry_inputs(uuv_core *core, member *m, int *changed) {
    for (const transfer *t = m->transfers; t < m->transfers + m->n_transfers; t++) {
        if (m->sets[t->access].clocks || (core->in_event && t->early != IN_EVENTS)) continue;
        if (!carry_value(core, t, core->in_event || is_discrete(m, t->target), changed)) return 0;
    }
    return 1;
}

/* ---- event iteration ---------------------------------------------------------------------- */

static int exchange(uuv_core *core, const struct event_group *g, member **at, int all, int *changed) {
    for (uint32_t i = 0; i < g->n; i++)
        if (!read_outputs(core, *at = g->members[i])) return 0;
    for (uint32_t i = 0; i < g->n; i++) {
        member *m = *at = g->members[i];
        int other = all;
        if (!carry_inputs(core, m, &other)) return 0;
        if (other && !m->kind->set(m, core->slots, &core->why)) return 0;
        *changed |= other;
    }
    return 1;
}

/* Names a clock that is active in the last round. */
static int ticks_do_not_end(uuv_core *core, const struct event_group *g, member **at, double now) {
    for (uint32_t i = 0; i < g->n; i++) {
        const struct clocks *all = g->members[i]->events->clocks;
        for (uint32_t k = 0; all && k < all->n; k++) {
            if (!all->all[k].active) continue;
            *at = g->members[i];
            core->why.slot = k;
            core->why.residual = now;
            return failed(&core->why, UUV_CORE_EVENTS_DO_NOT_END, 2, UUV_CORE_DO_STEP);
        }
    }
    return 1;
}

/* Outputs go to inputs and discrete states are updated, until nothing changes. Time-based clocks tick
 * after that, as the standard advises, and the iteration goes on. `ends`: the step ends here, and they
 * tick where the next one starts, with the inputs from outside of the group that are valid then. */
static int iterate(uuv_core *core, const struct event_group *g, member **at, double now, const instant *here,
                   int ends) {
    int again = 0;
    member *last = g->members[0];
    for (uint32_t round = 0;; round++) {
        int changed = 0, ticks = 0;
        core->why.residual = now;
        if (!exchange(core, g, at, round == 0, &changed)) return 0;
        const uint32_t slot = core->why.slot;
        if (!carry_clocks(core, g, at, here, &ticks)) return 0;
        if (!changed && !ticks && !again && !ends) {
            if (!activate_due_clocks(core, g, at, here, &ticks)) return 0;
            if (ticks && !carry_clocks(core, g, at, here, &ticks)) return 0;
        }
        if (!changed && !ticks && !again) return 1;
        if (round == UUV_MOST_ROUNDS) {
            if (ticks && !changed && !again) return ticks_do_not_end(core, g, at, now);
            core->why.slot = slot;
            break;
        }
        again = 0;
        for (uint32_t i = 0; i < g->n; i++) {
            int one = 0;
            if (!fmi3_update_discrete_states(*at = g->members[i], &one, &core->why)) return 0;
            if (one) last = g->members[i];
            again |= one;
        }
        if (!end_clocks(core, g, at, here)) return 0;
    }
    *at = last;
    core->why.residual = now;
    return failed(&core->why, UUV_CORE_EVENTS_DO_NOT_END, again, UUV_CORE_DO_STEP);
}

static int handle_event(uuv_core *core, const struct event_group *g, member **at, double now, const instant *here,
                        int ends) {
    for (uint32_t i = 0; i < g->n; i++)
        if (!fmi3_change_mode(*at = g->members[i], 1, &core->why)) return 0;
    core->in_event = 1;
    const int done = iterate(core, g, at, now, here, ends);
    core->in_event = 0;
    for (uint32_t i = 0; done && i < g->n; i++)
        if (!fmi3_change_mode(*at = g->members[i], 0, &core->why)) return 0;
    return done;
}

int begin_events(uuv_core *core, member **at) {
    const double t = (double)(core->tick * core->num) / (double)core->den;
    const instant here = {.tick = core->tick, .exact = 1};
    core->n_noted = 0;
    for (uint32_t i = 0; i < core->n_event_groups; i++) {
        const struct event_group *g = core->event_groups + i;
        for (uint32_t k = 0; k < g->n; k++)
            if (!transfer_inputs(core, *at = g->members[k])) return 0;
        if (!handle_event(core, g, at, t, &here, 1)) return 0;
    }
    return 1;
}

/* ---- the step ----------------------------------------------------------------------------- */

static int step_to(uuv_core *core, member *m, double now, double length, double to) {
    if (!m->kind->do_step(m, core->slots, now, length, &core->why)) return 0;
    if (!m->events->early || m->events->reached > to) m->events->reached = to;
    return 1;
}

/* Steps all from `now` to `*to`, or to the first of those where a member returns early. */
static int step_together(uuv_core *core, const struct event_group *g, member **at, double now,
                         double length, double *to) {
    for (uint32_t i = 0; g->n > 1 && i < g->n; i++)
        if (g->members[i]->events->repeats && !save_state(*at = g->members[i], &core->why)) return 0;
    for (uint32_t i = 0; i < g->n; i++)
        if (!step_to(core, *at = g->members[i], now, length, *to)) return 0;
    for (;;) {
        member *first = NULL;
        for (uint32_t i = 0; i < g->n; i++)
            if (g->members[i]->events->reached < *to) first = g->members[i], *to = first->events->reached;
        if (!first) return 1;
        core->why.residual = *to;
        *at = first;
        if (!(*to > now)) return failed(&core->why, UUV_CORE_NO_PROGRESS, 0, UUV_CORE_DO_STEP);
        for (uint32_t i = 0; i < g->n; i++) {
            member *m = g->members[i];
            if (m->events->reached <= *to) continue;
            core->why.slot = (uint32_t)(m - core->members);
            if (!m->events->repeats) return failed(&core->why, UUV_CORE_NOT_REPEATED, 0, UUV_CORE_SET_STATE);
            *at = m;
            if (!restore_state(m, &core->why) || !step_to(core, m, now, *to - now, *to)) return 0;
            *at = first;
        }
    }
}

/* Inputs at the step's start. A discrete one with another value is an event, and so is a clock that is
 * due. */
static int take_inputs(uuv_core *core, const struct event_group *g, member **at, double t) {
    const instant here = {.tick = core->tick, .exact = 1};
    int any = is_clock_due(core, g, &here);
    for (uint32_t i = 0; i < g->n; i++) {
        int changed = 0;
        any |= *g->members[i]->events->inside;
        if (!carry_inputs(core, *at = g->members[i], &changed)) return 0;
        if (changed && !note_event(core, *at, core->tick, 0.0, UUV_CORE_INPUT)) return 0;
        any |= changed;
    }
    if (any) return handle_event(core, g, at, t, &here, 0);
    for (uint32_t i = 0; i < g->n; i++)
        if (!(*at = g->members[i])->kind->set(*at, core->slots, &core->why)) return 0;
    return 1;
}

int step_event_group(uuv_core *core, member **at, double t) {
    const struct event_group *g = core->event_groups + (*at)->events->group;
    const double h = (*at)->h, end = t + h;
    const uint64_t ticks = (*at)->step_ticks;
    if (!take_inputs(core, g, at, t)) return 0;
    uint32_t parts = 0;
    for (double now = t, to; now < end; now = to) {
        to = end;
        instant next;
        double tick_at = end; /* of the next clock */
        if (next_clock(core, g, &next) && next.tick < core->tick + ticks) tick_at = t + seconds_from(core, core->tick, &next);
        if (tick_at < end) to = tick_at;
        if (to > now && !step_together(core, g, at, now, to == end && now == t ? h : to - now, &to)) return 0;
        const int ticked = to == tick_at && to < end;
        if (!ticked) next = to < end ? later(core, (instant){.tick = core->tick, .exact = 1}, to - t)
                                     : (instant){.tick = core->tick + ticks, .exact = 1};
        int needed = 0;
        for (uint32_t i = 0; i < g->n; i++) {
            const member *m = g->members[i];
            if (!m->events->needed) continue;
            needed = 1;
            if (!note_event(core, m, core->tick + (to < end ? 0 : ticks), to < end ? to - t : 0.0, UUV_CORE_REPORTED))
                return 0;
        }
        if ((needed || ticked) && !handle_event(core, g, at, to, &next, !(to < end))) return 0;
        core->why.residual = to;
        if (++parts == UUV_MOST_EVENTS && to < end) return failed(&core->why, UUV_CORE_NO_PROGRESS, 1, UUV_CORE_DO_STEP);
    }
    for (uint32_t i = 0; i < g->n; i++) {
        member *m = *at = g->members[i];
        m->due += ticks;
        if (!read_outputs(core, m)) return 0;
        apply_faults(core, m, core->fresh);
    }
    return 1;
}
