/* The loop's own state, for snapshots; and blobs, the memory of texts and bytes. */
#include <stdlib.h>
#include <string.h>

#include "tables.h"

int blob_assign(uuv_blob *blob, const char *data, size_t size) {
    if (size + 1 > blob->capacity) {
        const size_t capacity = 2 * size + 16;
        char *grown = realloc(blob->data, capacity);
        if (!grown) return 0;
        blob->data = grown;
        blob->capacity = capacity;
    }
    if (size) memmove(blob->data, data, size);
    blob->data[size] = 0;
    blob->size = size;
    return 1;
}

UUV_CORE_API void uuv_core_why(const uuv_core *core, uuv_failure *failure) { *failure = core->why; }

UUV_CORE_API uint64_t uuv_core_tick(const uuv_core *core) { return core->tick; }

UUV_CORE_API void uuv_core_set_tick(uuv_core *core, uint64_t tick) {
    core->tick = tick;
    if (core->record.every) core->record.next = tick + core->record.every - tick % core->record.every;
}

/* What was kept of the old instance went with it. */
UUV_CORE_API void uuv_core_instance(uuv_core *core, uint32_t member_, void *instance,
                                    int32_t *kept) {
    member *m = &core->members[member_];
    m->instance = core->instances[member_] = instance;
    m->kept = kept;
    m->state = NULL;
    if (m->values.offsets) find_block(m);
}

UUV_CORE_API int uuv_core_any(const uint32_t *const *counts, uint32_t n) {
    uint32_t any = 0;
    for (uint32_t i = 0; i < n; i++) any |= *counts[i];
    return any != 0;
}

UUV_CORE_API uuv_slot *uuv_core_slots(uuv_core *core) { return core->slots; }

UUV_CORE_API uuv_slot *uuv_core_fresh(uuv_core *core) { return core->fresh; }

UUV_CORE_API const char *uuv_core_read_blob(const uuv_slot *slot, size_t *size) {
    *size = slot->blob->size;
    return slot->blob->data;
}

UUV_CORE_API int uuv_core_write_blob(uuv_slot *slot, const char *data, size_t size) {
    return blob_assign(slot->blob, data, size);
}
