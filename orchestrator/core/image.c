/* The state of the loop and of its native members as one run of bytes: what a snapshot keeps. */
#include <string.h>

#include "clocks.h"
#include "variable_step.h"

typedef void native_get_state(const void *instance, void *out);
typedef void native_set_state(void *instance, const void *in);

static int in_image(const member *m) { return m->kind == &kind_native && m->get_state; }

UUV_CORE_API size_t uuv_core_image_size(const uuv_core *core) {
    size_t size = (1 + core->n_members + 2 * (size_t)core->n_slots) * sizeof(uint64_t);
    for (const member *m = core->members; m < core->members + core->n_members; m++)
        if (in_image(m)) size += m->state_size;
    return size + step_state_size(core) + clock_state_size(core);
}

/* Slots that point to texts are zero in the image, and stay as they are when it is restored. */
static void put_slots(const uuv_core *core, const uuv_slot *slots, char *out) {
    memcpy(out, slots, core->n_slots * sizeof *slots);
    if (!memchr(core->classes, CLASS_BLOB, core->n_slots)) return;
    for (uint32_t s = 0; s < core->n_slots; s++)
        if (core->classes[s] == CLASS_BLOB) memset(out + s * sizeof *slots, 0, sizeof *slots);
}

static void take_slots(const uuv_core *core, uuv_slot *slots, const char *in) {
    if (!memchr(core->classes, CLASS_BLOB, core->n_slots)) {
        memcpy(slots, in, core->n_slots * sizeof *slots);
        return;
    }
    for (uint32_t s = 0; s < core->n_slots; s++)
        if (core->classes[s] != CLASS_BLOB) memcpy(slots + s, in + s * sizeof *slots, sizeof *slots);
}

UUV_CORE_API void uuv_core_get_image(const uuv_core *core, void *image) {
    const member *const end = core->members + core->n_members;
    const size_t slots = core->n_slots * sizeof(uuv_slot);
    char *out = image;
    memcpy(out, &core->tick, sizeof core->tick);
    out += sizeof core->tick;
    for (const member *m = core->members; m < end; m++, out += sizeof m->due)
        memcpy(out, &m->due, sizeof m->due);
    put_slots(core, core->slots, out);
    put_slots(core, core->fresh, out + slots);
    out += 2 * slots;
    for (const member *m = core->members; m < end; m++)
        if (in_image(m)) {
            ((native_get_state *)m->get_state)(m->instance, out);
            out += m->state_size;
        }
    if (core->varied) put_step_state(core, out);
    else if (clock_state_size(core)) put_clock_state(core, out); /* there are no events with a variable step */
}

UUV_CORE_API void uuv_core_set_image(uuv_core *core, const void *image) {
    member *const end = core->members + core->n_members;
    const size_t slots = core->n_slots * sizeof(uuv_slot);
    const char *in = image;
    uint64_t tick;
    memcpy(&tick, in, sizeof tick);
    uuv_core_set_tick(core, tick);
    in += sizeof tick;
    for (member *m = core->members; m < end; m++, in += sizeof m->due)
        memcpy(&m->due, in, sizeof m->due);
    take_slots(core, core->slots, in);
    take_slots(core, core->fresh, in + slots);
    in += 2 * slots;
    for (member *m = core->members; m < end; m++)
        if (in_image(m)) {
            ((native_set_state *)m->set_state)(m->instance, in);
            in += m->state_size;
        }
    if (core->varied) take_step_state(core, in);
    else if (clock_state_size(core)) take_clock_state(core, in);
}
