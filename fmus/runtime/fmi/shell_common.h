/* What the FMI 2 and the FMI 3 shell share: modes, messages, and the life of an instance.
 *
 * A call that is refused changes nothing: it gives a message and an error status. Only a value
 * that is not finite, after a step or at the end of initialization, makes the instance FAILED;
 * from there it can be read, reset, freed, or put back into a saved state. There is no static
 * data that changes.
 */
#ifndef SHELL_COMMON_H
#define SHELL_COMMON_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "shell_hooks.h"

enum shell_mode {
    INSTANTIATED = 1,
    INITIALIZATION_MODE = 2,
    STEP_MODE = 4,
    TERMINATED = 8,
    FAILED = 16,
    EVENT_MODE = 32, /* of Model Exchange, as the next */
    CONTINUOUS_TIME_MODE = 64,
    ANY_MODE = 127
};

typedef struct {
    uuv_instance *block;
    char *name;
    uint64_t mode;
    int exchange; /* for Model Exchange; else for Co-Simulation */
    int warned;   /* a value below a soft minimum has been reported */
    double time, start_time, stop_time; /* stop_time: inf where there is none */
    void *environment;
    void (*log)(void); /* the importer's callback, cast by the shell */
} shell;

/* What a call gives: its status is Error, OK or Warning. */
enum { REFUSED = 0, DONE = 1, DONE_WITH_WARNING = 2 };

/* Hands a finished message to the importer, as an error or a warning; each shell has its own. */
static void shell_log(shell *s, int result, const char *message);

static const char *mode_name(uint64_t mode) {
    switch (mode) {
    case INSTANTIATED: return "Instantiated";
    case INITIALIZATION_MODE: return "Initialization Mode";
    case STEP_MODE: return "Step Mode";
    case TERMINATED: return "Terminated";
    case EVENT_MODE: return "Event Mode";
    case CONTINUOUS_TIME_MODE: return "Continuous-Time Mode";
    default: return "Failed";
    }
}

/* Logs a message and gives 0, so that `return refuse(…)` reads well. */
static int refuse(shell *s, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    shell_log(s, REFUSED, text);
    return REFUSED;
}

__attribute__((noinline, cold)) static int wrong_mode(shell *s, const char *function, unsigned allowed) {
    char expected[192] = "";
    size_t used = 0;
    for (unsigned m = INSTANTIATED; m <= CONTINUOUS_TIME_MODE; m <<= 1)
        if (allowed & m)
            used += (size_t)snprintf(expected + used, sizeof expected - used, "%s%s",
                                     used ? " or " : "", mode_name(m));
    return refuse(s, "%s is not allowed in state %s; expected %s", function, mode_name(s->mode),
                  expected);
}

static inline int in_mode(shell *s, const char *function, unsigned allowed) {
    return s && (s->mode & allowed || wrong_mode(s, function, allowed));
}

/* ---- life ------------------------------------------------------------------------------ */

static void shell_free(shell *s) {
    if (!s) return;
    uuv_free(s->block);
    free(s->name);
    free(s);
}

static shell *shell_instantiate(const char *name, const char *token, void *environment,
                                void (*log)(void)) {
    const uuv_component *c = uuv_get_component();
    const char *given = name && *name ? name : c->name;
    shell *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->environment = environment;
    s->log = log;
    s->mode = INSTANTIATED;
    s->stop_time = __builtin_inf();
    s->name = malloc(strlen(given) + 1);
    if (s->name) strcpy(s->name, given);
    if (!token || strcmp(token, c->token) != 0) {
        refuse(s, "token \"%s\" is not that of this binary; expected \"%s\"", token ? token : "",
               c->token);
        shell_free(s);
        return NULL;
    }
    s->block = uuv_instantiate(c);
    if (!s->block || !s->name) {
        refuse(s, "out of memory");
        shell_free(s);
        return NULL;
    }
    return s;
}

static void shell_reset(shell *s) {
    uuv_reset(s->block);
    s->mode = INSTANTIATED;
    s->warned = 0;
    s->time = s->start_time = 0.0;
    s->stop_time = __builtin_inf();
}

static int shell_setup(shell *s, const char *function, double start, int stop_defined,
                       double stop) {
    if (!__builtin_isfinite(start))
        return refuse(s, "%s: startTime is %g; expected a finite number", function, start);
    if (stop_defined && !(stop >= start))
        return refuse(s, "%s: stopTime is %g; expected at least startTime %g", function, stop,
                      start);
    s->start_time = start;
    s->stop_time = stop_defined ? stop : __builtin_inf();
    return 1;
}

/* Sets the time, and each clock to its first sample that is not before the start. */
static void shell_enter_initialization(shell *s) {
    s->time = s->start_time;
    uuv_enter_initialization(s->block, s->start_time);
    s->mode = INITIALIZATION_MODE;
}

#endif
