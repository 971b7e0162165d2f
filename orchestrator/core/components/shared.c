/* A component in a process of its own: set, step and get are one exchange through shared memory. */
#define _GNU_SOURCE
#include "exchange.h"

#if defined(__linux__)
#include <errno.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>

static double seconds_now(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int is_gone(int64_t child) {
    siginfo_t info;
    memset(&info, 0, sizeof info);
    if (waitid(P_PID, (id_t)child, &info, WEXITED | WNOHANG | WNOWAIT)) return errno == ECHILD;
    return info.si_pid != 0;
}
#else
static double seconds_now(void) { return 0.0; }

static int is_gone(int64_t child) { return child != 0; }
#endif

static const double SLICE = 0.02; /* seconds between two looks at whether the child lives */

/* Gives 1 when the child has answered; it may have done so and died. */
static int answered(uuv_exchange *e) {
    turnstile *reply = &e->shared->reply;
    if (turnstile_spin(reply, e->before, &e->patience)) return 1;
    while (e->trouble == EXCHANGE_FINE) {
        const int gone = is_gone(e->child);
        if (turnstile_sleep(reply, e->before, gone ? 0.0 : SLICE)) return 1;
        if (gone)
            e->trouble = EXCHANGE_DIED;
        else if (e->watchdog > 0.0 && seconds_now() - e->asked >= e->watchdog)
            e->trouble = EXCHANGE_LATE;
    }
    return 0;
}

static int request(uuv_exchange *e, int command) {
    exchange *x = e->shared;
    if (e->trouble >= EXCHANGE_DIED) return 0;
    e->trouble = EXCHANGE_FINE;
    e->before = x->reply.count;
    e->asked = seconds_now();
    x->command = command;
    turnstile_set(&x->request, x->request.count + 1);
    return 1;
}

static int ask(uuv_exchange *e, int command) { return request(e, command) && answered(e); }

/* What the child says of what went wrong; its slots are numbered from its first input on. */
static int told(uuv_exchange *e, const member *m, uuv_failure *why) {
    const uuv_failure *its = &e->shared->why;
    const uint32_t slot = its->slot;
    if (its->outcome == UUV_CORE_GOOD) return 1;
    e->trouble = EXCHANGE_FAILED;
    if (slot >= e->n_in && m->n_gets) why->slot = m->gets[0].slot + (slot - e->n_in);
    else if (m->n_sets) why->slot = m->sets[0].slot + slot;
    return failed(why, its->outcome, its->status, its->action);
}

static int lost(uuv_failure *why, int action) {
    return failed(why, UUV_CORE_BAD_STATUS, -1, action);
}

static int shared_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    const uuv_exchange *e = m->instance;
    if (e->trouble >= EXCHANGE_DIED) return lost(why, UUV_CORE_SET);
    if (exchange_put(e, e->in, e->in_texts, slots, m->sets, m->n_sets)) return 1;
    return failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_SET);
}

static int shared_post(member *m, double t, double h, uuv_failure *why) {
    uuv_exchange *e = m->instance;
    if (e->trouble >= EXCHANGE_DIED) return lost(why, UUV_CORE_DO_STEP);
    e->shared->t = t;
    e->shared->h = h;
    e->read = 0;
    return request(e, EXCHANGE_STEP) || lost(why, UUV_CORE_DO_STEP);
}

static int shared_collect(member *m, uuv_failure *why) {
    uuv_exchange *e = m->instance;
    if (!answered(e)) return lost(why, UUV_CORE_DO_STEP);
    e->read = 1;
    /* What failed in reading its outputs is told when they are needed, as in this process. */
    return e->shared->why.action == UUV_CORE_GET || told(e, m, why);
}

static int shared_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    (void)slots;
    return shared_post(m, t, h, why) && shared_collect(m, why);
}

static int shared_get(member *m, uuv_slot *slots, uuv_failure *why) {
    uuv_exchange *e = m->instance;
    if (!e->read && !ask(e, EXCHANGE_GET)) return lost(why, UUV_CORE_GET);
    e->read = 1;
    if (!told(e, m, why)) return 0;
    if (exchange_take(e, e->out, e->out_texts, slots, m->gets, m->n_gets)) return 1;
    return failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
}

const kind kind_shared = {shared_set, shared_do_step, shared_get, shared_post, shared_collect};

/* The child keeps its state; called as FMI's functions are, for iterated groups. */
static int state(uuv_exchange *e, int command) {
    e->read = 0;
    if (!ask(e, command)) return -1;
    if (e->shared->why.outcome == UUV_CORE_GOOD) return 0;
    e->trouble = EXCHANGE_FAILED;
    return e->shared->why.status;
}

UUV_CORE_API int uuv_exchange_save(uuv_exchange *e, void **unused) {
    (void)unused;
    const int status = state(e, EXCHANGE_SAVE);
    return status < 0 ? 3 : status;
}

UUV_CORE_API int uuv_exchange_restore(uuv_exchange *e, void *unused) {
    (void)unused;
    const int status = state(e, EXCHANGE_RESTORE);
    return status < 0 ? 3 : status;
}

/* Before a call on the pipe: the child's loop makes way, and outputs are read anew after it. */
UUV_CORE_API void uuv_exchange_leave(uuv_exchange *e) {
    exchange *x = e->shared;
    if (!x || e->trouble >= EXCHANGE_DIED) return;
    e->read = 0;
    x->command = EXCHANGE_LEAVE;
    turnstile_set(&x->request, x->request.count + 1);
}

/* Why the last step failed, told once; that the child is gone is told again and again. */
UUV_CORE_API int uuv_exchange_trouble(uuv_exchange *e) {
    const int trouble = e->trouble;
    if (trouble == EXCHANGE_FAILED) e->trouble = EXCHANGE_FINE;
    return trouble;
}

UUV_CORE_API uint32_t uuv_exchange_messages(const uuv_exchange *e) {
    return e->shared ? e->shared->messages : 0;
}
