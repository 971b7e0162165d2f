/* Coupling residuals: how far inputs that were held over a step are from the outputs at its end. */
#ifndef UUV_CORE_COUPLING_H
#define UUV_CORE_COUPLING_H

#include <math.h>

#include "tables.h"

/* Lists the delayed connections, once the tables are complete. 0: no memory. */
int find_couplings(uuv_core *core);
/* Forgets the residuals of an earlier run. */
void clear_couplings(uuv_core *core);
/* Notes a larger residual of element k; an angle that passes +-pi has not jumped. */
void note_residual(uuv_core *core, coupling *c, uint32_t k, double residual);

/* Looks at the connections of all whose step ended at the communication point that is reached;
 * with `every`, that is all. An output that no step has produced yet may be a mere start value, as
 * that of a sensor before its first sample: what it fed does not count. */
static inline void measure_couplings(uuv_core *core, int every) {
    const uuv_slot *const slots = core->slots;
    coupling *c = core->couplings, *const plain = c + core->n_plain, *const end = c + core->n_couplings;
    for (; c < plain; c++) {
        if (core->tick < c->since || (!every && core->members[c->to].due != core->tick)) continue;
        for (uint32_t k = 0; k < c->count; k++) {
            const double residual = fabs(slots[c->source + k].f - slots[c->target + k].f);
            if (residual > c->most) note_residual(core, c, k, residual);
        }
    }
    for (; c < end; c++) {
        if (core->tick < c->since || (!every && core->members[c->to].due != core->tick)) continue;
        for (uint32_t k = 0; k < c->count; k++) {
            const double due = c->factor * slots[c->source + k].f + c->offset;
            const double residual = fabs(due - slots[c->target + k].f);
            if (residual > c->most) note_residual(core, c, k, residual);
        }
    }
}

#endif
