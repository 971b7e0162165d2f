/* How a member's state is kept before a trial and restored for the next. */
#include <stdlib.h>

#include "iterate.h"

typedef int fmi_get_state(void *instance, void **state);
typedef int fmi_set_state(void *instance, void *state);
typedef void native_get_state(const void *instance, void *out);
typedef void native_set_state(void *instance, const void *in);

static int call(void *function, int32_t *status) {
    *status = UUV_CORE_INCOMPLETE;
    ((uuv_callback_state *)function)(status);
    return *status;
}

int save_state(member *m, uuv_failure *why) {
    int status = 0;
    calling(m, "the copy of its state", "");
    if (m->kind == &kind_native) {
        if (!m->state) m->state = malloc(m->state_size + 1);
        if (!m->state) return failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        ((native_get_state *)m->get_state)(m->instance, m->state);
    } else if (m->kind == &kind_callback) {
        status = call(m->get_state, m->instance);
    } else {
        status = ((fmi_get_state *)m->get_state)(m->instance, &m->state);
    }
    if (m->kept) *m->kept = 1; /* a trial may be repeated */
    return status <= 1 ? 1 : failed(why, UUV_CORE_BAD_STATUS, status, UUV_CORE_GET_STATE);
}

int restore_state(member *m, uuv_failure *why) {
    int status = 0;
    calling(m, "the restoring of its state", "");
    if (m->kind == &kind_native)
        ((native_set_state *)m->set_state)(m->instance, m->state);
    else if (m->kind == &kind_callback)
        status = call(m->set_state, m->instance);
    else
        status = ((fmi_set_state *)m->set_state)(m->instance, m->state);
    return status <= 1 ? 1 : failed(why, UUV_CORE_BAD_STATUS, status, UUV_CORE_SET_STATE);
}

void forget_state(member *m) {
    if (m->kind == &kind_native)
        free(m->state);
    else if (m->state && m->free_state)
        ((fmi_get_state *)m->free_state)(m->instance, &m->state);
    m->state = NULL;
}

/* The members' instances live no longer than until this has been called. */
UUV_CORE_API void uuv_core_forget(uuv_core *core) {
    for (uint32_t i = 0; i < core->n_members; i++) forget_state(&core->members[i]);
}
