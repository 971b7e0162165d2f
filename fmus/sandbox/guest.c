/* Part of each module that an FMU's sources become: its messages and its memory.
 *
 * The module has no other way to the outside than these two imports and those of WASI, which the
 * sandbox refuses by name. */
#undef malloc /* which the compiler's options rename in all sources */
#undef calloc
#undef realloc
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#define IMPORTED(NAME) __attribute__((import_module("uuv"), import_name(NAME)))
#define EXPORTED(NAME) __attribute__((export_name(NAME)))

IMPORTED("log") void uuv_guest_log(int status, const char *category, const char *text);
IMPORTED("more") void uuv_guest_more(size_t bytes); /* that memory is refused */

static void log3(void *environment, int status, const char *category, const char *text) {
    (void)environment;
    uuv_guest_log(status, category ? category : "", text ? text : "");
}

static void log2(void *environment, const char *name, int status, const char *category, const char *format, ...) {
    char text[2048];
    va_list list;
    (void)environment;
    (void)name;
    va_start(list, format);
    vsnprintf(text, sizeof text, format ? format : "", list);
    va_end(list);
    uuv_guest_log(status, category ? category : "", text);
}

static const struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished, *environment;
} callbacks = {log2, calloc, free, NULL, NULL};

EXPORTED("uuv_guest_fmi2") const void *uuv_guest_fmi2(void) { return &callbacks; }
EXPORTED("uuv_guest_fmi3") void *uuv_guest_fmi3(void) { return (void *)log3; }

/* The sources call these in place of the C library's, which do not tell that memory is refused. */
static void *checked(void *given, size_t n) {
    if (!given && n) uuv_guest_more(n);
    return given;
}
void *uuv_guest_malloc(size_t n) { return checked(malloc(n), n); }
void *uuv_guest_realloc(void *before, size_t n) { return checked(realloc(before, n), n); }
void *uuv_guest_calloc(size_t n, size_t width) {
    return checked(calloc(n, width), width && n > SIZE_MAX / width ? SIZE_MAX : n * width);
}
