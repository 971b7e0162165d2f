/* An FMU in plain C that does in its second step what a sandbox of WebAssembly must survive, by its
 * parameter `act`. `got` is 1 if that succeeded, and -1 if it was refused; `path` is text for it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "fmi3Functions.h"

enum { Y = 1, ACT, FAILS, GOT, PATH };
enum { NOTHING, LOOPS, ABORTS, DIVIDES, OUTSIDE, RECURSES, GROWS, EXITS, READS, PRINTS, NULL_CALL, LOGS, TIME, BAD_TEXT };

typedef struct {
    fmi3Float64 y;
    fmi3Int32 act, fails, got;
    char path[512];
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance;

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    instance *s = calloc(1, sizeof *s);
    s->environment = environment;
    s->log = log;
    return s;
}
void fmi3FreeInstance(fmi3Instance s) { free(s); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance s, fmi3Boolean a, fmi3Float64 b, fmi3Float64 c,
                                       fmi3Boolean d, fmi3Float64 e) {
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance s) { return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance s) { return fmi3OK; }
fmi3Status fmi3GetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t n_x) {
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)s)->y;
    return fmi3OK;
}
static fmi3Int32 *integer(instance *s, fmi3ValueReference r) {
    return r == ACT ? &s->act : r == FAILS ? &s->fails : &s->got;
}
fmi3Status fmi3GetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    for (size_t i = 0; i < n; i++) x[i] = *integer(s, r[i]);
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, const fmi3Int32 x[], size_t n_x) {
    for (size_t i = 0; i < n; i++) *integer(s, r[i]) = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetString(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3String x[], size_t n_x) {
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)s)->act == BAD_TEXT ? (fmi3String)0xfffffff0u : ((instance *)s)->path;
    return fmi3OK;
}
fmi3Status fmi3SetString(fmi3Instance s, const fmi3ValueReference r[], size_t n, const fmi3String x[], size_t n_x) {
    snprintf(((instance *)s)->path, sizeof ((instance *)s)->path, "%s", x[0]);
    return fmi3OK;
}

static int deeper(volatile char *above) {
    volatile char here[4096];
    here[0] = above[0];
    return deeper(here) + here[0];
}

static int acts(instance *s) {
    volatile int zero = 0;
    int (*volatile nothing)(void) = NULL;
    switch (s->act) {
    case LOOPS:
        for (;;) zero = 0;
    case ABORTS: abort();
    case DIVIDES: return 7 / zero;
    case OUTSIDE: return *(volatile int *)(0xfffffff0u);
    case RECURSES: return deeper(s->path);
    case GROWS:
        for (volatile char *piece;;)
            if ((piece = malloc(1 << 24)) == NULL) return -1;
            else piece[0] = 1;
    case EXITS: exit(3);
    case READS: return fopen(s->path, "r") ? 1 : -1;
    case PRINTS: return printf("%s %d\n", s->path, 7) > 0 && fflush(stdout) == 0;
    case NULL_CALL: return nothing();
    case LOGS: s->log(s->environment, fmi3Warning, "all", s->path); return 1;
    case TIME: return time(NULL) > 1000000000;
    }
    return 1;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean never_back,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    instance *s = c;
    *event = *end = *early = 0;
    *reached = t + h;
    if (s->act && !s->got && t > 0) s->got = acts(s);
    s->y += h;
    return s->fails && s->got < 0 ? fmi3Error : fmi3OK;
}
