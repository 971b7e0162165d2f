/* Waiting, waking and copying through shared memory; on Linux only, elsewhere there are pipes. */
#include "exchange.h"

#include <stdlib.h>
#include <string.h>

#if defined(__linux__)
#include <linux/futex.h>
#include <sys/mman.h>
#include <sys/syscall.h>
#include <time.h>

long syscall(long number, ...); /* unistd.h has an `access` of its own */

static void pause_briefly(void) {
#if defined(__x86_64__) || defined(__i386__)
    __asm__ __volatile__("pause");
#elif defined(__aarch64__)
    __asm__ __volatile__("yield");
#endif
}

void turnstile_set(turnstile *t, uint32_t count) {
    __atomic_store_n(&t->count, count, __ATOMIC_SEQ_CST);
    if (__atomic_load_n(&t->asleep, __ATOMIC_SEQ_CST))
        syscall(SYS_futex, &t->count, FUTEX_WAKE, 1, NULL, NULL, 0);
}

int turnstile_spin(const turnstile *t, uint32_t seen, patience *p) {
    const uint32_t spins = p->waits++ % 256 ? p->spins : p->limit; /* now and then it is tried anew */
    for (uint32_t i = 0; i <= spins; i++) {
        if (__atomic_load_n(&t->count, __ATOMIC_ACQUIRE) != seen) {
            p->spins = p->limit;
            return 1;
        }
        pause_briefly();
    }
    p->spins /= 2;
    return 0;
}

int turnstile_sleep(turnstile *t, uint32_t seen, double seconds) {
    const struct timespec time = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
    if (seconds <= 0.0) return __atomic_load_n(&t->count, __ATOMIC_ACQUIRE) != seen;
    /* Whoever counts up after this store sees it and wakes; who did before is seen by the kernel. */
    __atomic_store_n(&t->asleep, 1, __ATOMIC_SEQ_CST);
    if (__atomic_load_n(&t->count, __ATOMIC_SEQ_CST) == seen)
        syscall(SYS_futex, &t->count, FUTEX_WAIT, seen, &time, NULL, 0);
    __atomic_store_n(&t->asleep, 0, __ATOMIC_SEQ_CST);
    return __atomic_load_n(&t->count, __ATOMIC_ACQUIRE) != seen;
}

static void *map(int fd, size_t size) {
    void *p = mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_NORESERVE, fd, 0);
    return p == MAP_FAILED ? NULL : p;
}

static void unmap(void *p, size_t size) { munmap(p, size); }
#else
void turnstile_set(turnstile *t, uint32_t count) { t->count = count; }

int turnstile_spin(const turnstile *t, uint32_t seen, patience *p) {
    (void)p;
    return t->count != seen;
}

int turnstile_sleep(turnstile *t, uint32_t seen, double seconds) {
    (void)seconds;
    return t->count != seen;
}

static void *map(int fd, size_t size) {
    (void)fd, (void)size;
    return NULL;
}

static void unmap(void *p, size_t size) { (void)p, (void)size; }
#endif

int exchange_put(const uuv_exchange *e, uuv_slot *shared, char *texts, const uuv_slot *slots,
                 const access *accesses, uint32_t n) {
    const uint32_t first = n ? accesses[0].slot : 0;
    size_t used = 0;
    for (uint32_t i = 0; i < n; i++) {
        const access *a = &accesses[i];
        uuv_slot *to = shared + (a->slot - first);
        const uuv_slot *from = slots + a->slot;
        if (a->class != CLASS_BLOB) {
            memcpy(to, from, a->n_values * sizeof *to);
            continue;
        }
        for (uint32_t k = 0; k < a->n_values; k++) {
            const uuv_blob *text = from[k].blob;
            if (text->size > e->text_room - used) return 0;
            memcpy(texts + used, text->data, text->size);
            to[k].u = text->size;
            used += text->size;
        }
    }
    return 1;
}

int exchange_take(const uuv_exchange *e, const uuv_slot *shared, const char *texts, uuv_slot *slots,
                  const access *accesses, uint32_t n) {
    const uint32_t first = n ? accesses[0].slot : 0;
    size_t used = 0;
    for (uint32_t i = 0; i < n; i++) {
        const access *a = &accesses[i];
        const uuv_slot *from = shared + (a->slot - first);
        uuv_slot *to = slots + a->slot;
        if (a->class != CLASS_BLOB) {
            memcpy(to, from, a->n_values * sizeof *to);
            continue;
        }
        for (uint32_t k = 0; k < a->n_values; k++) {
            /* Read once: the other process may change it, or give a size beyond the memory. */
            const uint64_t size = __atomic_load_n(&from[k].u, __ATOMIC_RELAXED);
            if (size > e->text_room - used || !blob_assign(to[k].blob, texts + used, size)) return 0;
            used += size;
        }
    }
    return 1;
}

static size_t slots_at(void) { return (sizeof(exchange) + 127) / 128 * 128; }

/* Bytes to share, for so many slots and `text_room` bytes of texts each way. */
UUV_CORE_API size_t uuv_exchange_size(uint32_t n_in, uint32_t n_out, size_t text_room) {
    return slots_at() + ((size_t)n_in + n_out) * sizeof(uuv_slot) + 2 * text_room;
}

UUV_CORE_API uuv_exchange *uuv_exchange_new(void) { return calloc(1, sizeof(uuv_exchange)); }

/* Takes the memory behind `fd`, and gives up what was mapped before; 0: it cannot be had. */
UUV_CORE_API int uuv_exchange_map(uuv_exchange *e, int fd, uint32_t n_in, uint32_t n_out,
                                  size_t text_room) {
    if (e->shared) unmap(e->shared, e->size);
    memset(e, 0, sizeof *e);
    e->size = uuv_exchange_size(n_in, n_out, text_room);
    e->shared = map(fd, e->size);
    if (!e->shared) return 0;
    e->n_in = n_in;
    e->n_out = n_out;
    e->text_room = text_room;
    e->in = (uuv_slot *)(void *)((char *)e->shared + slots_at());
    e->out = e->in + n_in;
    e->in_texts = (char *)(e->out + n_out);
    e->out_texts = e->in_texts + text_room;
    return 1;
}

/* How to wait for the process that answers (0: this one does, from the next request on). */
UUV_CORE_API void uuv_exchange_waits(uuv_exchange *e, int64_t child, double watchdog, uint32_t spins) {
    e->child = child;
    e->watchdog = watchdog;
    e->seen = e->shared->request.count;
    e->patience = (patience){spins, spins, 0};
}

/* Gives the memory up; whoever steps it still is told that the child has died. */
UUV_CORE_API void uuv_exchange_close(uuv_exchange *e) {
    if (e->shared) unmap(e->shared, e->size);
    e->shared = NULL;
    if (e->trouble == EXCHANGE_FINE || e->trouble == EXCHANGE_FAILED) e->trouble = EXCHANGE_DIED;
}

UUV_CORE_API void uuv_exchange_free(uuv_exchange *e) {
    if (e) uuv_exchange_close(e);
    free(e);
}
