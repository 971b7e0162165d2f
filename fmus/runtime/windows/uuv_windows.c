/* What a component needs of C's start-up and stdio on Windows, over ucrtbase.dll alone.
 *
 * Zig would otherwise compile the whole of mingw-w64 first, which takes minutes and is not used.
 */
#include <stdarg.h>
#include <stddef.h>

#define STANDARD_SNPRINTF 2ull /* gives the length that the text would have had */

int __stdio_common_vsprintf(unsigned long long, char *, size_t, const char *, void *, va_list);
int __stdio_common_vsscanf(unsigned long long, const char *, size_t, const char *, void *, va_list);

int _fltused = 1; /* the linker asks for it where there are floating-point numbers */

#define ATTACHED 1 /* reason: the library was loaded */
typedef void constructor(void);
extern constructor *__CTOR_LIST__[]; /* the linker's: -1, the constructors, 0 */

int __stdcall DllMainCRTStartup(void *library, unsigned reason, void *reserved) {
    (void)library, (void)reserved;
    for (size_t k = 1; reason == ATTACHED && __CTOR_LIST__[k]; k++) __CTOR_LIST__[k]();
    return 1;
}

int vsnprintf(char *text, size_t size, const char *format, va_list arguments) {
    return __stdio_common_vsprintf(STANDARD_SNPRINTF, text, size, format, NULL, arguments);
}

int snprintf(char *text, size_t size, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    int written = vsnprintf(text, size, format, arguments);
    va_end(arguments);
    return written;
}

int sscanf(const char *text, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    int read = __stdio_common_vsscanf(0, text, (size_t)-1, format, NULL, arguments);
    va_end(arguments);
    return read;
}

/* What each thread keeps of its own (`_Thread_local`) lies between these two; the linker and
 * Windows find it by the names `_tls_used` and `_tls_index`. */
__attribute__((section(".tls"), aligned(16), used)) char _tls_start[16] = {0};
__attribute__((section(".tls$ZZZ"), used)) char _tls_end = 0;
unsigned long _tls_index = 0;
static void *no_callbacks[1] = {NULL};

__attribute__((used)) const struct {
    void *start, *end, *index, *callbacks;
    unsigned long zero_fill, characteristics;
} _tls_used = {_tls_start, &_tls_end, &_tls_index, no_callbacks, 0, 0};

/* A frame of more than a page calls this, its size in rax, so that Windows adds page after page to
 * the stack: each is read once, from the caller's stack pointer downwards. No register changes. */
__asm__(".text\n"
        ".globl ___chkstk_ms\n"
        "___chkstk_ms:\n"
        "    pushq %r10\n"
        "    pushq %rax\n"
        "    leaq 24(%rsp), %r10\n"
        "1:  cmpq $4096, %rax\n"
        "    jbe 2f\n"
        "    subq $4096, %r10\n"
        "    testb $0, (%r10)\n"
        "    subq $4096, %rax\n"
        "    jmp 1b\n"
        "2:  subq %rax, %r10\n"
        "    testb $0, (%r10)\n"
        "    popq %rax\n"
        "    popq %r10\n"
        "    ret\n");
