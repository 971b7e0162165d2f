/* The child's loop: one member of a core of its own, stepped as the parent asks. */
#define _GNU_SOURCE
#include <string.h>

#include "exchange.h"
#include "iterate.h"

#if defined(__linux__)
#include <poll.h>

/* The parent is gone, or writes to the pipe. */
static int pipe_calls(int fd) {
    struct pollfd p = {.fd = fd, .events = POLLIN};
    return poll(&p, 1, 0) != 0;
}
#else
static int pipe_calls(int fd) {
    (void)fd;
    return 1;
}
#endif

static int get(uuv_core *core, uuv_exchange *e, member *m) {
    if (m->n_gets == 0) return 1;
    if (!m->kind->get(m, core->slots, &core->why)) return 0;
    if (exchange_put(e, e->out, e->out_texts, core->slots, m->gets, m->n_gets)) return 1;
    return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
}

static int step(uuv_core *core, uuv_exchange *e, member *m) {
    if (!exchange_take(e, e->in, e->in_texts, core->slots, m->sets, m->n_sets))
        return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_SET);
    return m->kind->set(m, core->slots, &core->why) &&
           m->kind->do_step(m, core->slots, e->shared->t, e->shared->h, &core->why) && get(core, e, m);
}

static int obey(uuv_core *core, uuv_exchange *e, int command) {
    member *m = core->members;
    switch (command) {
    case EXCHANGE_STEP: return step(core, e, m);
    case EXCHANGE_GET: return get(core, e, m);
    case EXCHANGE_SAVE: return save_state(m, &core->why);
    default: return restore_state(m, &core->why);
    }
}

/* Serves until the parent leaves, calls on the pipe `fd`, or is gone. `messages`: a count to tell. */
UUV_CORE_API void uuv_core_serve(uuv_core *core, uuv_exchange *e, int fd, const uint32_t *messages) {
    exchange *x = e->shared;
    for (;;) {
        if (!turnstile_spin(&x->request, e->seen, &e->patience)) {
            while (!turnstile_sleep(&x->request, e->seen, 0.5))
                if (pipe_calls(fd)) return;
        }
        e->seen = __atomic_load_n(&x->request.count, __ATOMIC_ACQUIRE);
        if (x->command == EXCHANGE_LEAVE) return;
        memset(&core->why, 0, sizeof core->why);
        enter(core);
        obey(core, e, x->command);
        leave(core);
        x->why = core->why;
        x->messages = messages ? *messages : 0;
        turnstile_set(&x->reply, e->seen);
    }
}
