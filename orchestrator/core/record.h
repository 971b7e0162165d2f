/* A row of the recording: the recorded slots at one communication point. */
#ifndef UUV_CORE_RECORD_H
#define UUV_CORE_RECORD_H

#include <string.h>

#include "tables.h"

int write_texts(uuv_core *core, uint64_t *at);

static inline int record_is_full(const uuv_core *core) {
    const recording *r = &core->record;
    return r->n_columns != 0 && r->rows && r->used == r->n_rows;
}

/* Writes a row if this communication point is one that is recorded. */
static inline int record_row(uuv_core *core) {
    recording *r = &core->record;
    if (r->n_columns == 0 || !r->rows || core->tick < r->next) return 1;
    r->next = core->tick + (r->every == 1 ? 1 : r->every - core->tick % r->every);
    uint64_t *const at = r->rows + r->used * r->row_stride;
    const size_t stride = r->column_stride;
    for (const run *part = r->runs; part < r->runs + r->n_runs; part++) {
        uint64_t *to = at + part->column * stride;
        const uuv_slot *const from = core->slots + part->slot, *const end = from + part->count;
        if (stride == 1)
            memcpy(to, from, part->count * sizeof *to);
        else
            for (const uuv_slot *slot = from; slot < end; slot++, to += stride) *to = slot->u;
    }
    if (r->n_texts && !write_texts(core, at)) return 0;
    r->ticks[r->used++] = (int64_t)core->tick;
    return 1;
}

#endif
