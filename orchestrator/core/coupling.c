/* The table of delayed connections, and what was measured of them (coupling.h). */
#include "coupling.h"

#include <stdlib.h>

/* Those that see a new value in the same step are not delayed. */
static int delays(const transfer *t) {
    return !t->early && !t->pairs && t->source_class == CLASS_FLOAT && t->target_class == CLASS_FLOAT;
}

static void list(uuv_core *core, int plain) {
    for (uint32_t i = 0; i < core->n_members; i++)
        for (uint32_t k = 0; k < core->members[i].n_transfers; k++) {
            const transfer *t = &core->members[i].transfers[k];
            if (delays(t) && t->copy == plain)
                core->couplings[core->n_couplings++] = (coupling){
                    .source = t->source, .target = t->target, .count = t->count, .to = i,
                    .delay = core->members[t->from].step_ticks + core->members[i].step_ticks,
                    .factor = t->factor, .offset = t->offset};
        }
}

int find_couplings(uuv_core *core) {
    size_t n = 1;
    if (core->couplings) return 1;
    for (uint32_t i = 0; i < core->n_members; i++) n += core->members[i].n_transfers;
    core->largest = calloc(n, sizeof *core->largest);
    core->couplings = calloc(n, sizeof *core->couplings);
    if (!core->largest || !core->couplings) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
    if (!core->unmeasured) list(core, 1);
    core->n_plain = core->n_couplings;
    if (!core->unmeasured) list(core, 0);
    clear_couplings(core);
    return 1;
}

void clear_couplings(uuv_core *core) {
    for (uint32_t i = 0; i < core->n_couplings; i++) {
        coupling *c = &core->couplings[i];
        c->most = 0.0;
        c->since = core->tick + c->delay;
        core->largest[i] = (uuv_coupling){.source_slot = c->source, .target_slot = c->target};
    }
}

void note_residual(uuv_core *core, coupling *c, uint32_t k, double residual) {
    const double turn = core->turns[c->target + k];
    /* A wrapped angle jumps by one turn; one that changes by more is no such angle, or diverges. */
    if (residual > 0.5 * turn && residual < 1.5 * turn) {
        residual = fabs(residual - turn);
        if (!(residual > c->most)) return;
    }
    core->largest[c - core->couplings] = (uuv_coupling){
        .source_slot = c->source + k, .target_slot = c->target + k, .residual = residual,
        .relative = residual / (1.0 + fabs(core->slots[c->target + k].f)), .tick = core->tick};
    c->most = residual;
}

UUV_CORE_API void uuv_core_angle(uuv_core *core, uint32_t slot, double turn) { core->turns[slot] = turn; }

UUV_CORE_API void uuv_core_measure_nothing(uuv_core *core) { core->unmeasured = 1; }

UUV_CORE_API uint32_t uuv_core_couplings(const uuv_core *core) { return core->n_couplings; }

UUV_CORE_API void uuv_core_coupling(const uuv_core *core, uint32_t i, uuv_coupling *coupling_) {
    *coupling_ = core->largest[i];
}
