/* Begins a console program over ucrtbase.dll alone, so that no test compiles mingw-w64. */
#include <stdarg.h>
#include <stddef.h>

int main(int, char **);
void exit(int);
int _configure_narrow_argv(int);
int *__p___argc(void);
char ***__p___argv(void);
void *__acrt_iob_func(unsigned);
int __stdio_common_vfprintf(unsigned long long, void *, const char *, void *, va_list);

void __main(void) {}

void mainCRTStartup(void) {
    _configure_narrow_argv(1);
    exit(main(*__p___argc(), *__p___argv()));
}

int fprintf(void *file, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    int written = __stdio_common_vfprintf(0, file, format, NULL, arguments);
    va_end(arguments);
    return written;
}

int printf(const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    int written = __stdio_common_vfprintf(0, __acrt_iob_func(1), format, NULL, arguments);
    va_end(arguments);
    return written;
}
