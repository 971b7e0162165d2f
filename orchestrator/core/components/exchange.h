/* A component in another process: one request and its reply at a time, in shared memory.
 *
 * The parent writes the inputs and a command, and counts up `request`; the child steps, writes the
 * outputs and why it failed, if it did, and sets `reply` to the same number. Whoever waits spins for
 * a while and then sleeps in the kernel (futex), so that neither side burns a core for long.
 */
#ifndef UUV_CORE_EXCHANGE_H
#define UUV_CORE_EXCHANGE_H

#include "tables.h"

/* LEAVE has no reply: the child's loop ends, and Python answers on the pipe. */
enum exchange_command { EXCHANGE_LEAVE = 1, EXCHANGE_STEP, EXCHANGE_GET, EXCHANGE_SAVE, EXCHANGE_RESTORE };

/* A number that one side counts up and the other waits for; alone in its cache lines. */
typedef struct {
    _Alignas(128) uint32_t count;
    uint32_t asleep; /* somebody waits in the kernel */
} turnstile;

/* What both processes map; the slots of inputs and outputs follow, then room for texts. */
typedef struct {
    turnstile request, reply;
    _Alignas(128) int32_t command;
    double t, h;
    _Alignas(128) uuv_failure why;
    uint32_t messages; /* of the component, that wait to be fetched */
} exchange;

/* How long it is worth spinning: where the other side was not in time, it is less the next time,
 * so that many processes on few cores do not take them from each other. */
typedef struct {
    uint32_t limit, spins, waits;
} patience;

enum exchange_trouble { EXCHANGE_FINE = 0, EXCHANGE_FAILED, EXCHANGE_DIED, EXCHANGE_LATE };

/* One process's end of it. */
typedef struct {
    exchange *shared;
    uuv_slot *in, *out;
    char *in_texts, *out_texts;
    size_t size, text_room;
    uint32_t n_in, n_out, seen;
    patience patience;
    int64_t child;   /* process that answers, or 0 in the child itself */
    double watchdog; /* seconds to answer in, or 0 for ever */
    double asked;    /* when, in seconds */
    uint32_t before; /* replies before that */
    int read;        /* the outputs in `out` are those of the component as it is now */
    int trouble;
} uuv_exchange;

/* Counts up and wakes. */
void turnstile_set(turnstile *t, uint32_t count);
/* Both give 1 if `count` differs from `seen`; asleep, 0 after about `seconds`. */
int turnstile_spin(const turnstile *t, uint32_t seen, patience *p);
int turnstile_sleep(turnstile *t, uint32_t seen, double seconds);

/* Copies between a process's slots and the shared ones; texts go in order. 0: no room, or memory. */
int exchange_put(const uuv_exchange *e, uuv_slot *shared, char *texts, const uuv_slot *slots,
                 const access *accesses, uint32_t n);
int exchange_take(const uuv_exchange *e, const uuv_slot *shared, const char *texts, uuv_slot *slots,
                  const access *accesses, uint32_t n);

#endif
