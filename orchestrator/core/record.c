/* The recording beside its rows (record.h): texts, and the calls that give room and take rows. */
#include <stdlib.h>
#include <string.h>

#include "record.h"

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

int write_texts(uuv_core *core, uint64_t *at) {
    recording *r = &core->record;
    for (uint32_t i = 0; i < r->n_texts; i++) {
        const uuv_blob *text = core->slots[r->text_slots[i]].blob;
        uint64_t *last = &r->last_text[i];
        if (*last == UINT64_MAX || !same(&r->texts[*last], text)) *last = store(r, text);
        if (*last == UINT64_MAX) return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        at[r->text_columns[i] * r->column_stride] = *last;
    }
    return 1;
}

/* Gives room: column c of row i is to be rows[c * column_stride + i * row_stride]. */
UUV_CORE_API void uuv_core_rows(uuv_core *core, uint64_t *rows, int64_t *ticks, uint32_t n_rows,
                                size_t column_stride, size_t row_stride) {
    recording *r = &core->record;
    r->rows = rows;
    r->column_stride = column_stride;
    r->row_stride = row_stride;
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
