/* Messages of a foreign FMU: formatted here, because the loggers of FMI 1.0 and 2.0 are variadic,
 * and kept in a ring from which Python takes them.
 *
 * A log is the instance environment of one FMU instance. FMI 1.0 has no environment: its logger gets
 * the instance, which is not known before it is made, and the instance's name. FMUs may call from any
 * thread, and some hand back an environment that is not theirs: such a message goes to the log that
 * is newest.
 */
#include <stdarg.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { CAPACITY = 256, LONGEST = 16384 };

typedef struct {
    int32_t status;
    char *category;
    char *text;
} message;

typedef struct uuv_log {
    uint32_t count; /* first, so that a reader can look without a call */
    uint32_t first;
    uint64_t lost; /* overwritten before they were taken */
    struct uuv_log *next;
    const void *component; /* FMI 1.0, as `name` */
    char *name;
    message ring[CAPACITY];
} uuv_log;

static atomic_flag busy = ATOMIC_FLAG_INIT;
static uuv_log *logs;

static void lock(void) {
    while (atomic_flag_test_and_set_explicit(&busy, memory_order_acquire)) {
    }
}

static void unlock(void) { atomic_flag_clear_explicit(&busy, memory_order_release); }

static char *copy(const char *text) {
    const char *source = text != NULL ? text : "";
    size_t size = strlen(source) + 1;
    char *result = malloc(size);
    if (result != NULL) memcpy(result, source, size);
    return result;
}

/* `key` is an environment or an instance of FMI 1.0. */
static uuv_log *find(const void *key, const char *name) {
    for (uuv_log *log = logs; log != NULL; log = log->next)
        if (log == key || (key != NULL && log->component == key)) return log;
    for (uuv_log *log = logs; log != NULL && name != NULL; log = log->next)
        if (log->name != NULL && strcmp(log->name, name) == 0) return log;
    return logs;
}

/* Takes ownership of `text`. */
static void append(const void *key, const char *name, int32_t status, const char *category, char *text) {
    char *owned_category = copy(category);
    lock();
    uuv_log *log = find(key, name);
    if (log == NULL || owned_category == NULL || text == NULL) {
        unlock();
        free(owned_category);
        free(text);
        return;
    }
    message *slot = &log->ring[(log->first + log->count) % CAPACITY];
    message old = {0, NULL, NULL};
    if (log->count == CAPACITY) {
        old = *slot;
        log->first = (log->first + 1) % CAPACITY;
        log->lost++;
    } else {
        log->count++;
    }
    slot->status = status;
    slot->category = owned_category;
    slot->text = text;
    unlock();
    free(old.category);
    free(old.text);
}

EXPORT uuv_log *uuv_log_new(void) {
    uuv_log *log = calloc(1, sizeof *log);
    if (log != NULL) {
        lock();
        log->next = logs;
        logs = log;
        unlock();
    }
    return log;
}

EXPORT void uuv_log_free(uuv_log *log) {
    lock();
    uuv_log **link = &logs;
    while (*link != NULL && *link != log) link = &(*link)->next;
    if (*link != NULL) *link = log->next;
    unlock();
    for (uint32_t i = 0; i < log->count; i++) {
        message *m = &log->ring[(log->first + i) % CAPACITY];
        free(m->category);
        free(m->text);
    }
    free(log->name);
    free(log);
}

EXPORT void uuv_log_name(uuv_log *log, const char *name, const void *component) {
    char *owned = copy(name);
    lock();
    char *old = log->name;
    log->name = owned;
    log->component = component;
    unlock();
    free(old);
}

/* Takes the oldest message; the caller frees both texts with uuv_release. 0: there is none. */
EXPORT int32_t uuv_log_take(uuv_log *log, int32_t *status, char **category, char **text) {
    lock();
    int32_t any = log->count > 0;
    if (any) {
        message *m = &log->ring[log->first];
        *status = m->status;
        *category = m->category;
        *text = m->text;
        log->first = (log->first + 1) % CAPACITY;
        log->count--;
    }
    unlock();
    return any;
}

EXPORT uint64_t uuv_log_lost(uuv_log *log) {
    lock();
    uint64_t lost = log->lost;
    log->lost = 0;
    unlock();
    return lost;
}

static char *formatted(const char *format, va_list arguments) {
    char *text = format != NULL ? malloc(LONGEST) : NULL;
    if (text == NULL) return NULL;
    int written = vsnprintf(text, LONGEST, format, arguments);
    if (written < 0) snprintf(text, LONGEST, "%s", format);
    char *fitted = copy(text);
    free(text);
    return fitted;
}

/* fmiCallbackLogger of FMI 1.0 */
EXPORT void uuv_log_fmi1(void *component, const char *instance, int32_t status,
                         const char *category, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char *text = formatted(format, arguments);
    va_end(arguments);
    append(component, instance, status, category, text);
}

/* fmi2CallbackLogger */
EXPORT void uuv_log_fmi2(void *environment, const char *instance, int32_t status,
                         const char *category, const char *format, ...) {
    (void)instance;
    va_list arguments;
    va_start(arguments, format);
    char *text = formatted(format, arguments);
    va_end(arguments);
    append(environment, NULL, status, category, text);
}

/* fmi3LogMessageCallback */
EXPORT void uuv_log_fmi3(void *environment, int32_t status, const char *category,
                         const char *text) {
    append(environment, NULL, status, category, copy(text));
}

/* fmi2CallbackAllocateMemory and fmi2CallbackFreeMemory, and those of FMI 1.0 */
EXPORT void *uuv_allocate(size_t count, size_t size) { return calloc(count, size); }

EXPORT void uuv_release(void *memory) { free(memory); }
