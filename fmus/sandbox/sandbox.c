/* Calls into a module, with arguments copied into its memory and results out of it. */
#include <stdarg.h>
#include <string.h>

#include "uuv_sandbox.h"

#define NAME(V, N) #V #N,
#define NAME2(T) "fmi2Get" #T, "fmi2Set" #T,
#define NAME3(T) "fmi3Get" #T, "fmi3Set" #T,
static const char *const names[] = {
    SANDBOX_COMMON(NAME, fmi2) SANDBOX_FMI2_OTHERS(NAME, fmi2)
    SANDBOX_COMMON(NAME, fmi3) SANDBOX_FMI3_OTHERS(NAME, fmi3)
    SANDBOX_FMI2_TYPES(NAME2) SANDBOX_FMI3_TYPES(NAME3) NULL,
};
_Static_assert(sizeof names / sizeof *names == N_FUNCTIONS + 1, "a name for each function");

/* Reasons by wasmtime's codes of traps; the others keep wasmtime's words. */
static const char *const reasons[] = {
    "its stack overflowed", "it used memory outside its own", "it used memory that is not aligned",
    "it called a function that does not exist", "it called a null pointer",
    "it called a function with other arguments", "an integer overflowed", "it divided an integer by zero",
    "it converted a number that no integer can hold", "it aborted",
};
enum { INTERRUPTED = 10, PAGE = 65536 };

SANDBOX_EXPORT size_t uuv_sandbox_size(void) { return sizeof(uuv_sandbox); }
SANDBOX_EXPORT const char *const *uuv_sandbox_names(void) { return names; }

/* `api` has the addresses in the order of the structure `wasmtime`. */
SANDBOX_EXPORT void uuv_sandbox_open(uuv_sandbox *s, void *const *api, void *context, const memory *m,
                                     uint64_t ticks) {
    memset(s, 0, sizeof *s);
    memcpy(&s->api, api, sizeof s->api);
    s->context = context;
    s->memory = *m;
    s->ticks = ticks;
}

SANDBOX_EXPORT void uuv_sandbox_function(uuv_sandbox *s, int f, const function *found) { s->functions[f] = *found; }

SANDBOX_EXPORT const char *uuv_sandbox_reason(const uuv_sandbox *s) { return s->reason; }

int sandbox_end(uuv_sandbox *s, const char *reason) {
    s->ended = 1;
    if (!s->reason[0]) strncpy(s->reason, reason, sizeof s->reason - 1);
    if (s->report) s->report(s->environment, SANDBOX_FATAL, "", s->reason);
    return 0;
}

/* Notes the reason of a trap that follows. */
SANDBOX_EXPORT void uuv_sandbox_end(uuv_sandbox *s, const char *reason) {
    strncpy(s->reason, reason, sizeof s->reason - 1);
}

static int ended(uuv_sandbox *s, void *error, void *trap) {
    char text[sizeof s->reason] = "";
    uint8_t code = 255;
    byte_vector message = {0, NULL};
    if (trap && s->api.trap_code(trap, &code) && code < sizeof reasons / sizeof *reasons)
        strcpy(text, reasons[code]);
    else if (trap && code == INTERRUPTED)
        strcpy(text, "it did not answer in time and was interrupted");
    else {
        if (trap) s->api.trap_message(trap, &message);
        else s->api.error_message(error, &message);
        size_t n = message.size < sizeof text - 1 ? message.size : sizeof text - 1;
        memcpy(text, message.data, n);
        text[n] = '\0';
        s->api.bytes_delete(&message);
    }
    if (trap) s->api.trap_delete(trap);
    if (error) s->api.error_delete(error);
    return sandbox_end(s, text);
}

int sandbox_call(uuv_sandbox *s, int f, raw *a, size_t n) {
    void *trap = NULL;
    if (s->ended) return 0;
    s->api.set_deadline(s->context, s->ticks);
    void *error = s->api.call(s->context, &s->functions[f], a, n, &trap);
    return error || trap ? ended(s, error, trap) : 1;
}

uint8_t *sandbox_room(uuv_sandbox *s, size_t size, uint32_t *place) {
    if (s->ended) return NULL;
    if (size > s->scratch_size) {
        uint64_t pages = (size + PAGE - 1) / PAGE, before;
        void *error = s->api.memory_grow(s->context, &s->memory, pages, &before);
        if (error) {
            ended(s, error, NULL);
            return NULL;
        }
        s->scratch = (uint32_t)(before * PAGE);
        s->scratch_size = (uint32_t)(pages * PAGE);
    }
    *place = s->scratch;
    return s->api.memory_data(s->context, &s->memory) + s->scratch;
}

/* The results of a call, which may have moved the memory. */
static const uint8_t *at(const uuv_sandbox *s, uint32_t place) {
    return s->api.memory_data(s->context, &s->memory) + place;
}

/* ---- values ----------------------------------------------------------------------------- */

static size_t whole(size_t bytes) { return (bytes + 7) / 8 * 8; }

static int numbers(uuv_sandbox *s, int f, const uint32_t *references, size_t n, void *out, const void *in,
                   size_t count, size_t width, int counts) {
    uint32_t place;
    size_t first = whole(n * sizeof *references), bytes = count * width;
    uint8_t *room = sandbox_room(s, first + bytes, &place);
    if (!room) return SANDBOX_FATAL;
    memcpy(room, references, n * sizeof *references);
    if (in && bytes) memcpy(room + first, in, bytes);
    raw a[5];
    a[0].i32 = (int32_t)s->instance;
    a[1].i32 = (int32_t)place;
    a[2].i32 = (int32_t)n;
    a[3].i32 = (int32_t)(place + first);
    a[4].i32 = (int32_t)count;
    if (!sandbox_call(s, f, a, counts ? 5 : 4)) return SANDBOX_FATAL;
    if (out && bytes && (uint32_t)a[0].i32 <= SANDBOX_WARNING) memcpy(out, at(s, place + (uint32_t)first), bytes);
    return a[0].i32;
}

int sandbox_get(uuv_sandbox *s, int f, const uint32_t *references, size_t n, void *values, size_t count,
                size_t width, int counts) {
    return numbers(s, f, references, n, values, NULL, count, width, counts);
}

int sandbox_set(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const void *values, size_t count,
                size_t width, int counts) {
    return numbers(s, f, references, n, NULL, values, count, width, counts);
}

int sandbox_get_texts(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const char **values,
                      size_t count, int counts) {
    uint32_t place;
    size_t first = whole(n * sizeof *references);
    uint8_t *room = sandbox_room(s, first + 4 * count, &place);
    if (!room) return SANDBOX_FATAL;
    memcpy(room, references, n * sizeof *references);
    memset(room + first, 0, 4 * count);
    raw a[5] = {{(int32_t)s->instance}, {(int32_t)place}, {(int32_t)n}, {(int32_t)(place + first)}, {(int32_t)count}};
    if (!sandbox_call(s, f, a, counts ? 5 : 4)) return SANDBOX_FATAL;
    size_t size = s->api.memory_size(s->context, &s->memory);
    for (size_t i = 0; (uint32_t)a[0].i32 <= SANDBOX_WARNING && i < count; i++) {
        uint32_t text;
        memcpy(&text, at(s, place + (uint32_t)(first + 4 * i)), 4);
        values[i] = text ? (const char *)at(s, text) : "";
        if (text >= size || !memchr(at(s, text), 0, size - text)) {
            sandbox_end(s, "it returned a text that is outside its memory");
            return SANDBOX_FATAL;
        }
    }
    return a[0].i32;
}

int sandbox_set_texts(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const char *const *values,
                      size_t count, int counts) {
    uint32_t place;
    size_t first = whole(n * sizeof *references), next = first + 4 * count, bytes = next;
    for (size_t i = 0; i < count; i++) bytes += strlen(values[i]) + 1;
    uint8_t *room = sandbox_room(s, bytes, &place);
    if (!room) return SANDBOX_FATAL;
    memcpy(room, references, n * sizeof *references);
    for (size_t i = 0; i < count; i++) {
        uint32_t text = place + (uint32_t)next;
        size_t length = strlen(values[i]) + 1;
        memcpy(room + first + 4 * i, &text, 4);
        memcpy(room + next, values[i], length);
        next += length;
    }
    raw a[5] = {{(int32_t)s->instance}, {(int32_t)place}, {(int32_t)n}, {(int32_t)(place + first)}, {(int32_t)count}};
    return sandbox_call(s, f, a, counts ? 5 : 4) ? a[0].i32 : SANDBOX_FATAL;
}

/* ---- other calls ------------------------------------------------------------------------ */

enum { MOST = 16 };

typedef struct {
    char letter;
    void *to;
    uint32_t place;
    size_t bytes;
} result;

static size_t width_of(char letter) {
    return letter == 'D' || letter == 'V' ? sizeof(double) : letter == 'R' ? sizeof(uint32_t) : 1;
}

static size_t bytes_of(const char *form, va_list list) {
    size_t bytes = 0;
    for (; *form; form++) switch (*form) {
        case 'i': (void)va_arg(list, int); break;
        case 'd': (void)va_arg(list, double); break;
        case 'p': (void)va_arg(list, void *); break;
        case 'n': break;
        case 's': {
            const char *text = va_arg(list, const char *);
            bytes += text ? whole(strlen(text) + 1) : 0;
            break;
        }
        case 'R': case 'D': case 'x': case 'V': case 'X':
            (void)va_arg(list, void *);
            bytes += whole(va_arg(list, size_t) * width_of(*form));
            break;
        default: (void)va_arg(list, void *); bytes += 8;
        }
    return bytes;
}

static void bring(const uuv_sandbox *s, const result *r) {
    uint32_t word;
    const uint8_t *from = at(s, r->place);
    memcpy(&word, from, 4);
    if (r->letter == 'Z') *(size_t *)r->to = word;
    else if (r->letter == 'P' || r->letter == 'Q') *(void **)r->to = (void *)(uintptr_t)word;
    else memcpy(r->to, from, r->bytes);
}

int sandbox_invoke(uuv_sandbox *s, int f, const char *form, ...) {
    raw a[MOST] = {{(int32_t)s->instance}};
    result results[MOST];
    size_t n = 1, n_results = 0, count = 0, bytes;
    uint32_t place = 0;
    uint8_t *room = NULL;
    va_list list;
    if (s->ended) return SANDBOX_FATAL;
    va_start(list, form);
    bytes = bytes_of(form, list);
    va_end(list);
    if (bytes && !(room = sandbox_room(s, bytes, &place))) return SANDBOX_FATAL;
    va_start(list, form);
    for (; *form; form++, n++) {
        size_t size = 8;
        const void *given;
        a[n].i32 = (int32_t)place;
        switch (*form) {
        case 'i': a[n].i32 = va_arg(list, int); continue;
        case 'd': a[n].f64 = va_arg(list, double); continue;
        case 'p': a[n].i32 = (int32_t)(uintptr_t)va_arg(list, void *); continue;
        case 'n': a[n].i32 = (int32_t)count; continue;
        case 's':
            given = va_arg(list, const char *);
            if (!given) {
                a[n].i32 = 0;
                continue;
            }
            size = strlen(given) + 1;
            memcpy(room, given, size);
            break;
        case 'R': case 'D': case 'x': case 'V': case 'X': {
            void *array = va_arg(list, void *);
            count = va_arg(list, size_t);
            size = count * width_of(*form);
            if (*form == 'V' || *form == 'X') results[n_results++] = (result){*form, array, place, size};
            else if (size) memcpy(room, array, size);
            break;
        }
        default: {
            void *to = va_arg(list, void *);
            uint32_t word = *form == 'Q' ? (uint32_t)(uintptr_t)*(void **)to : 0;
            memset(room, 0, 8);
            memcpy(room, &word, 4);
            size_t own = *form == 'b' ? 1 : *form == 'O' ? 8 : 4;
            if (*form == 'O') memcpy(room, to, 8);
            results[n_results++] = (result){*form, to, place, own};
        }
        }
        size = whole(size);
        room += size;
        place += (uint32_t)size;
    }
    va_end(list);
    if (!sandbox_call(s, f, a, n)) return SANDBOX_FATAL;
    for (size_t i = 0; (uint32_t)a[0].i32 <= 2 && i < n_results; i++) bring(s, &results[i]); /* and discard */
    return a[0].i32;
}
