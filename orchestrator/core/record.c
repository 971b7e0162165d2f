/* A row of the recording: the recorded slots at one communication point. */
#include <stdlib.h>
#include <string.h>

#include "tables.h"

int record_is_full(const uuv_core *core) {
    const recording *r = &core->record;
    return r->n_columns != 0 && r->rows && r->used == r->n_rows;
}

/* Stores a text, and gives its index, or UINT64_MAX. */
static uint64_t store(recording *r, const uuv_blob *text) {
    if (r->n_stored == r->capacity) {
        const uint64_t capacity = r->capacity ? 2 * r->capacity : 64;
        uuv_blob *texts = realloc(r->texts, capacity * sizeof *texts);
        if (!texts) return UINT64_MAX;
        memset(texts + r->capacity, 0, (capacity - r->capacity) * sizeof *texts);
        r->texts = texts;
        r->capacity = capacity;
    }
    if (!blob_assign(&r->texts[r->n_stored], text->data, text->size)) return UINT64_MAX;
    return r->n_stored++;
}

static int same(const uuv_blob *a, const uuv_blob *b) {
    return a->size == b->size && memcmp(a->data, b->data, a->size) == 0;
}

static int write_texts(uuv_core *core, uint64_t *row) {
    recording *r = &core->record;
    for (uint32_t i = 0; i < r->n_texts; i++) {
        const uuv_blob *text = core->slots[r->text_slots[i]].blob;
        uint64_t *last = &r->last_text[i];
        if (*last == UINT64_MAX || !same(&r->texts[*last], text)) *last = store(r, text);
        if (*last == UINT64_MAX) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        row[r->text_columns[i]] = *last;
    }
    return 1;
}

static int write_row(uuv_core *core) {
    recording *r = &core->record;
    uint64_t *row = r->rows + (size_t)r->used * r->n_columns;
    for (uint32_t i = 0; i < r->n_runs; i++)
        memcpy(row + r->runs[i].column, core->slots + r->runs[i].slot, r->runs[i].count * sizeof *row);
    if (!write_texts(core, row)) return 0;
    r->ticks[r->used++] = (int64_t)core->tick;
    return 1;
}

/* Writes a row if this communication point is one that is recorded. */
int record_row(uuv_core *core) {
    recording *r = &core->record;
    if (r->n_columns == 0 || !r->rows || core->tick < r->next) return 1;
    r->next = core->tick + r->every - core->tick % r->every;
    return write_row(core);
}

UUV_CORE_API void uuv_core_rows(uuv_core *core, uint64_t *rows, int64_t *ticks, uint32_t n_rows) {
    recording *r = &core->record;
    r->rows = rows;
    r->ticks = ticks;
    r->n_rows = n_rows;
    r->used = 0;
    r->n_stored = 0;
    for (uint32_t i = 0; i < r->n_texts; i++) r->last_text[i] = UINT64_MAX;
}

/* The first communication point of which a row may still come. */
UUV_CORE_API uint64_t uuv_core_next_row(const uuv_core *core) { return core->record.next; }

UUV_CORE_API void uuv_core_set_next_row(uuv_core *core, uint64_t tick) { core->record.next = tick; }

UUV_CORE_API uint32_t uuv_core_rows_used(const uuv_core *core) { return core->record.used; }

UUV_CORE_API uint64_t uuv_core_texts(const uuv_core *core) { return core->record.n_stored; }

UUV_CORE_API const char *uuv_core_text(const uuv_core *core, uint64_t index, size_t *size) {
    *size = core->record.texts[index].size;
    return core->record.texts[index].data;
}
