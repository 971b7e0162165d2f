/* Coupling residuals: how far inputs that were held over a step are from the outputs at its end. */
#ifndef UUV_CORE_COUPLING_H
#define UUV_CORE_COUPLING_H

#include <math.h>

#include "tables.h"

/* Lists the delayed connections, once the tables are complete. 0: no memory. */
int find_couplings(uuv_core *core);
/* Forgets the residuals of an earlier run. */
void clear_couplings(uuv_core *core);
/* Notes the values of a span whose residuals are larger than those before; an angle that passes
 * +-pi has not jumped. */
void note_residuals(uuv_core *core, const span *s);

static inline void measure_span(uuv_core *core, const span *s, int converted) {
    if (core->tick < s->since || (s->to != UINT32_MAX && core->members[s->to].due != core->tick)) return;
    const uuv_slot *const source = core->slots + s->source, *const target = core->slots + s->target;
    const double *const most = core->most + s->first;
    int larger = 0;
    if (converted)
        for (uint32_t k = 0; k < s->count; k++)
            larger |= fabs(s->factor * source[k].f + s->offset - target[k].f) > most[k];
    else
        for (uint32_t k = 0; k < s->count; k++) larger |= fabs(source[k].f - target[k].f) > most[k];
    if (larger) note_residuals(core, s);
}

/* Looks at the connections of all whose step ended at the communication point that is reached. An
 * output that no step has produced yet may be a mere start value, as that of a sensor before its
 * first sample: what it fed does not count. */
static inline void measure_couplings(uuv_core *core) {
    const uuv_slot *const slots = core->slots;
    const span *const first = core->spans, *const shorts = first + core->n_long, *const plain = first + core->n_plain;
    for (const span *s = first; s < shorts; s++) measure_span(core, s, 0);
    for (const span *s = plain; s < first + core->n_spans; s++) measure_span(core, s, 1);
    if (shorts == plain || core->tick < shorts->since) return;
    const pair_mask number = {INT64_MAX, INT64_MAX};
    pair_mask larger_of_two = {0, 0};
    for (const single *v = core->twins, *const end = v + core->n_twins; v < end; v++) {
        const pair d = *(const pair *)&slots[v->source].f - *(const pair *)&slots[v->target].f;
        larger_of_two |= (pair)((pair_mask)d & number) > *(const pair *)&core->most[v->value];
    }
    int larger = (larger_of_two[0] | larger_of_two[1]) != 0;
    for (const single *v = core->singles, *const end = v + core->n_singles; v < end; v++)
        larger |= fabs(slots[v->source].f - slots[v->target].f) > core->most[v->value];
    for (const span *s = shorts; larger && s < plain; s++) note_residuals(core, s);
}

#endif
