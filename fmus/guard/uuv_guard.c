/* What foreign code does to the process is reported with the component that was being called.
 *
 * A component may end the process: by a crash, or by calling exit(). The first is a signal; its
 * handler writes one line and lets the process die as before. The second would look like success,
 * so a handler of exit() writes one line, lets `uuv_guard_on_exit`'s function close what is open,
 * and leaves with status 3. An exit() that Python asked for has been announced by
 * `uuv_guard_leaving` and passes.
 */
#define _GNU_SOURCE
#include "uuv_guard.h"

#include <signal.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#if defined(_WIN32)
#include <io.h>
#include <process.h>
#define EXPORT __declspec(dllexport)
#define TLS _Thread_local
#define write _write
#else
#include <pthread.h>
#include <unistd.h>
#define EXPORT __attribute__((visibility("default")))
/* Reached from a signal's handler, so it must not be allocated there. */
#define TLS _Thread_local __attribute__((tls_model("initial-exec")))
#endif

enum { FAILED = 3 /* exit status of a component that failed */ };

static TLS uuv_frame *top;
static atomic_int inside; /* threads' entered frames */
static atomic_int leaving, reported;
static void (*on_exit_function)(void);

EXPORT void uuv_guard_enter(uuv_frame *frame) {
    frame->outer = top;
    top = frame;
    atomic_fetch_add_explicit(&inside, 1, memory_order_relaxed);
}

EXPORT void uuv_guard_leave(uuv_frame *frame) {
    top = frame->outer;
    atomic_fetch_sub_explicit(&inside, 1, memory_order_relaxed);
}

/* Async-signal-safe. */
static void say(const char *text) {
    const size_t size = text ? strlen(text) : 0;
    if (size && write(2, text, (unsigned)size) < 0) return;
}

static void say_function(void) {
    if (!top || !top->verb) return;
    say(" in ");
    say(top->verb);
    say(top->noun);
}

static void say_component(void) {
    if (top && top->component) {
        say("component '");
        say(top->component);
        say("'");
    } else {
        say("a thread of a component");
    }
}

/* Says who called exit(), once; gives 0 for an exit() that is no component's. */
EXPORT int uuv_guard_report(void) {
    if (!top && (atomic_load(&leaving) || atomic_load(&inside) == 0)) return 0;
    if (atomic_exchange(&reported, 1)) return 0;
    say("\nuuvsim: ");
    say_component();
    say(" called exit()");
    say_function();
    say(", which ends the whole program; expected it to return a status\n");
    return 1;
}

static void at_exit(void) {
    if (!uuv_guard_report()) return;
    if (on_exit_function) on_exit_function();
    _exit(FAILED);
}

/* Handlers run in the reverse order: a later call sees libraries alive that were loaded since. */
EXPORT int uuv_guard_arm(void) {
#if !defined(_WIN32) && !defined(__APPLE__)
    at_quick_exit(at_exit);
#endif
    return atexit(at_exit) == 0;
}

EXPORT void uuv_guard_on_exit(void (*function)(void)) { on_exit_function = function; }

/* Python leaves in good order: frames that an interruption may have left count no more. */
EXPORT void uuv_guard_leaving(void) {
    top = NULL;
    atomic_store(&leaving, 1);
}

/* Which component this thread is calling; NULL: none. */
EXPORT const char *uuv_guard_component(void) { return top ? top->component : NULL; }

#if !defined(_WIN32)
static const int SIGNALS[] = {SIGSEGV, SIGBUS, SIGILL, SIGFPE, SIGABRT};
static const char *const NAMES[] = {"SIGSEGV", "SIGBUS", "SIGILL", "SIGFPE", "SIGABRT"};
enum { N_SIGNALS = sizeof SIGNALS / sizeof *SIGNALS };
static struct sigaction before[N_SIGNALS];

/* What was there before is called as if this were not: it may know more, or even go on. */
static void pass_on(const struct sigaction *old, int number, siginfo_t *info, void *context) {
    if (old->sa_flags & SA_SIGINFO) {
        old->sa_sigaction(number, info, context);
    } else if (old->sa_handler == SIG_DFL) {
        sigaction(number, old, NULL);
        raise(number);
    } else if (old->sa_handler != SIG_IGN) {
        old->sa_handler(number);
    }
}

static void crashed(int number, siginfo_t *info, void *context) {
    int i = 0;
    while (i < N_SIGNALS && SIGNALS[i] != number) i++;
    if (i == N_SIGNALS) return;
    if (top && !atomic_exchange(&reported, 1)) {
        say("\nuuvsim: ");
        say_component();
        say(" crashed");
        say_function();
        say(" (");
        say(NAMES[i]);
        say("); in a process of its own, its crash is an error and no more\n");
    }
    pass_on(&before[i], number, info, context);
}

/* In a process that was forked, nobody calls a component yet. */
static void forked(void) {
    top = NULL;
    atomic_store(&inside, 0);
}

EXPORT void uuv_guard_watch(void) {
    static char stack[1 << 16];
    stack_t now = {0}, own = {.ss_sp = stack, .ss_size = sizeof stack};
    if (sigaltstack(NULL, &now) == 0 && (now.ss_flags & SS_DISABLE)) sigaltstack(&own, NULL);
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_sigaction = crashed;
    action.sa_flags = SA_NODEFER | SA_ONSTACK | SA_SIGINFO;
    sigemptyset(&action.sa_mask);
    for (int i = 0; i < N_SIGNALS; i++) sigaction(SIGNALS[i], &action, &before[i]);
    pthread_atfork(NULL, NULL, forked);
}
#else
EXPORT void uuv_guard_watch(void) {}
#endif
