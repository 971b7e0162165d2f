/* Components behind a function pointer: Python classes, isolated processes, anything else. */
#include "tables.h"

static int callback_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    (void)m;
    (void)slots;
    (void)why;
    return 1; /* do_step takes the inputs along */
}

static int callback_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    calling(m, "its step", "");
    const uuv_slot *in = m->n_sets ? slots + m->sets[0].slot : slots;
    int32_t *status = m->instance;
    *status = UUV_CORE_INCOMPLETE;
    ((uuv_callback_do_step *)m->do_step)(status, t, h, in);
    return *status ? failed(why, UUV_CORE_BAD_STATUS, *status, UUV_CORE_DO_STEP) : 1;
}

static int callback_get(member *m, uuv_slot *slots, uuv_failure *why) {
    calling(m, "its outputs", "");
    int32_t *status = m->instance;
    *status = UUV_CORE_INCOMPLETE;
    ((uuv_callback_get *)m->get)(status, slots + m->gets[0].slot);
    return *status ? failed(why, UUV_CORE_BAD_STATUS, *status, UUV_CORE_GET) : 1;
}

const kind kind_callback = {callback_set, callback_do_step, callback_get};
