/* Initialization Mode: values flow through the connections before the first step. */
#include <stdlib.h>

#include "tables.h"

/* Reads the outputs of a member that feeds another, unless they are known already. */
static int know_outputs(uuv_core *core, member *m, uint8_t *known) {
    uint8_t *mine = known + (m - core->members);
    if (*mine) return 1;
    if (m->n_gets && !m->kind->get(m, core->slots, &core->why)) return 0;
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        uint32_t which;
        if (a->class == CLASS_FLOAT && !all_finite(core->slots + a->slot, a->n_values, &which)) {
            core->why.slot = a->slot + which;
            return failed(&core->why, UUV_CORE_NOT_FINITE, 0, UUV_CORE_GET);
        }
    }
    return *mine = 1;
}

static int set_inputs(uuv_core *core, member *m, uint8_t *known, member **culprit) {
    if (!m->n_transfers) return 1;
    for (uint32_t i = 0; i < m->n_transfers; i++) {
        *culprit = core->members + m->transfers[i].from;
        if (!know_outputs(core, *culprit, known)) return 0;
    }
    *culprit = m;
    known[m - core->members] = 0;
    return transfer_inputs(core, m) && m->kind->set(m, core->slots, &core->why);
}

/* Sets the inputs of the members in `order`, which names one again where more has become known. */
static int32_t propagate(uuv_core *core, uint64_t tick, uint32_t n, const uint32_t *order) {
    uint8_t *known = calloc(core->n_members + 1, 1);
    member *culprit = core->members;
    int good = known != NULL || failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
    core->tick = tick;
    for (member *m = core->members; m < core->members + core->n_members; m++) m->due = tick;
    for (uint32_t i = 0; good && i < n; i++) good = set_inputs(core, core->members + order[i], known, &culprit);
    free(known);
    if (good) return UUV_CORE_GOOD;
    core->why.member = (uint32_t)(culprit - core->members);
    core->why.tick = tick;
    return core->why.outcome;
}

UUV_CORE_API int32_t uuv_core_propagate(uuv_core *core, uint64_t tick, uint32_t n, const uint32_t *order) {
    enter(core);
    const int32_t outcome = propagate(core, tick, n, order);
    leave(core);
    return outcome;
}
