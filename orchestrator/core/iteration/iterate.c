/* A communication step of an iterated group. FMI allows no get after set without a step, so each
 * trial restores the members' states, sets the inputs x and steps; T(y) are the inputs that follow
 * from the outputs of that trial, at the step's end. The solvers look for x = T(y(x)). */
#include "iterate.h"

#include <math.h>
#include <string.h>

static int one_trial(uuv_core *core, iteration *it) {
    for (uint32_t i = it->first; i < it->first + it->n_members; i++) {
        member *m = &core->members[i];
        it->culprit = i;
        if (it->begun && !restore_state(m, &core->why)) return 0;
        if (!m->kind->set(m, core->slots, &core->why)) return 0;
        if (!m->kind->do_step(m, core->slots, it->t, m->h, &core->why)) return 0;
        if (!read_outputs(core, m)) return 0;
    }
    return 1;
}

static int transfer_all(uuv_core *core, iteration *it) {
    for (uint32_t i = it->first; i < it->first + it->n_members; i++) {
        it->culprit = i;
        if (!transfer_inputs(core, &core->members[i])) return 0;
    }
    return 1;
}

/* Inputs from the trial's outputs; says whether one that is no number has changed. */
static int transfer_trial(uuv_core *core, iteration *it) {
    int done;
    for (uint32_t j = 0; j < it->n_others; j++) it->before[j] = core->slots[it->others[j]];
    core->iterating = 1;
    done = transfer_all(core, it);
    core->iterating = 0;
    it->unsettled = 0;
    for (uint32_t j = 0; j < it->n_others; j++)
        if (it->before[j].u != core->slots[it->others[j]].u) {
            it->unsettled = 1;
            it->restless = it->others[j];
        }
    return done;
}

int evaluate(uuv_core *core, iteration *it, const double *x, double *r) {
    for (uint32_t j = 0; j < it->n; j++) core->slots[it->slots[j]].f = x[j];
    if (!one_trial(core, it)) return 0;
    it->begun = 1;
    if (!transfer_trial(core, it)) return 0;
    for (uint32_t j = 0; j < it->n; j++) r[j] = core->slots[it->slots[j]].f - x[j];
    return 1;
}

int agreed(const iteration *it, const double *x, const double *r) {
    for (uint32_t j = 0; j < it->n; j++)
        if (!(fabs(x[j]) <= it->largest[j]) ||
            !(fabs(r[j]) <= it->tolerance * (1.0 + fabs(x[j]))))
            return 0;
    return 1;
}

int not_converged(uuv_core *core, const iteration *it, const double *r) {
    uint32_t worst = 0;
    for (uint32_t j = 1; j < it->n; j++)
        if (fabs(r[j]) > fabs(r[worst])) worst = j;
    core->why.slot = it->slots[worst];
    core->why.residual = fabs(r[worst]);
    return failed(&core->why, UUV_CORE_NOT_CONVERGED, (int)it->count, UUV_CORE_DO_STEP);
}

int ran_away(uuv_core *core, const iteration *it, const double *r) {
    const int outcome = core->why.outcome;
    if (outcome != UUV_CORE_NOT_FINITE && outcome != UUV_CORE_STATE_NOT_FINITE) return 0;
    return not_converged(core, it, r);
}

int step_group(uuv_core *core, iteration *it, double t) {
    it->t = t;
    it->begun = 0;
    it->count = 0;
    if (!transfer_all(core, it)) return 0; /* the outputs at the step's start are the first guess */
    for (uint32_t i = it->first; i < it->first + it->n_members; i++) {
        it->culprit = i;
        if (!save_state(&core->members[i], &core->why)) return 0;
    }
    for (uint32_t j = 0; j < it->n; j++) it->x[j] = core->slots[it->slots[j]].f;
    do {
        const int first = !it->begun;
        if (!evaluate(core, it, it->x, it->r)) return 0;
        for (uint32_t j = 0; first && j < it->n; j++)
            it->largest[j] = 1e6 * (1.0 + fabs(it->x[j]) + fabs(it->r[j]));
        if (!it->solve(core, it)) return 0;
        if (it->unsettled && it->count++ >= it->limit) {
            core->why.slot = it->restless;
            core->why.residual = 0.0;
            return failed(&core->why, UUV_CORE_NOT_CONVERGED, (int)it->count, UUV_CORE_DO_STEP);
        }
    } while (it->unsettled);
    for (uint32_t i = it->first; i < it->first + it->n_members; i++)
        core->members[i].due += core->members[i].step_ticks;
    return 1;
}
