/* A first-order lag as an FMI 1.0 Co-Simulation FMU, dy/dt = (k u - y) / T by Euler, that can also
 * misbehave.
 *
 * From t >= fault_time on, `fault` makes fmiDoStep: 1 give NaN, 2 return error with a formatted
 * message, 3 abort, 4 discard after half a step, 5 return fatal, 6 never return, 8 return pending,
 * 9 write to address 0. It refuses what the standard leaves undefined: outputs before
 * fmiInitializeSlave, and parameters after it. `begun` is u at fmiInitializeSlave.
 */
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi1Functions.h"

#pragma GCC visibility push(default) /* the header exports nothing */

#ifndef PREFIX
#define PREFIX first_order
#endif
#define JOIN(a, b) a##b
#define NAMED(prefix, name) JOIN(prefix, _fmi##name)
#define FMI(name) NAMED(PREFIX, name)

enum { N_REAL = 24, N_TEXT = 32 };
enum { U, Y, K, T, FAULT_TIME, V, W = V + 3, BEGUN = W + 3 }; /* v[3], w[3] */
enum { STEPS, FAULT, MODE, STOP, N_INTEGER };

typedef struct {
    fmi1Real real[N_REAL];
    fmi1Integer integer[N_INTEGER];
    fmi1Boolean flags[2]; /* on, spare */
    char label[N_TEXT];
    int initialized;
    double reached;
    fmi1CallbackFunctions callbacks;
    char name[64];
} instance;

static void start(instance *s) {
    memset(s, 0, offsetof(instance, callbacks));
    s->real[K] = 1.0;
    s->real[T] = 0.5;
    s->flags[0] = fmi1True;
    s->integer[MODE] = 1;
    strcpy(s->label, "first order");
}

static fmi1Status refuse(instance *s, const char *what) {
    s->callbacks.logger(s, s->name, fmi1Error, "error", "%s is refused %s", what,
                        s->initialized ? "after fmiInitializeSlave" : "before fmiInitializeSlave");
    return fmi1Error;
}

fmi1Component FMI(InstantiateSlave)(fmi1String name, fmi1String guid, fmi1String location, fmi1String mime,
                                    fmi1Real timeout, fmi1Boolean visible, fmi1Boolean interactive,
                                    fmi1CallbackFunctions callbacks, fmi1Boolean logging) {
    if (strcmp(guid, "{first-order}") != 0) {
        callbacks.logger(NULL, name, fmi1Error, "error", "guid %s is wrong", guid);
        return NULL;
    }
    instance *s = callbacks.allocateMemory(1, sizeof *s);
    s->callbacks = callbacks;
    snprintf(s->name, sizeof s->name, "%s", name);
    start(s);
    callbacks.logger(s, s->name, fmi1OK, "all", "%d instance%s of %s, %d %%", 1, "", mime, 100);
    if (strncmp(location, "file:///", 8) != 0 || timeout != 0 || visible || interactive || !logging)
        callbacks.logger(s, s->name, fmi1Warning, "all", "at %s", location);
    return s;
}

void FMI(FreeSlaveInstance)(fmi1Component c) { ((instance *)c)->callbacks.freeMemory(c); }

fmi1Status FMI(InitializeSlave)(fmi1Component c, fmi1Real t, fmi1Boolean stops, fmi1Real stop) {
    instance *s = c;
    if (s->initialized) return refuse(s, "fmiInitializeSlave");
    s->initialized = 1;
    s->real[BEGUN] = s->real[U];
    s->reached = t;
    s->integer[STOP] = stops ? (int)stop : -1;
    return fmi1OK;
}

fmi1Status FMI(GetReal)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1Real x[]) {
    instance *s = c;
    for (int i = 0; i < 3; i++) s->real[W + i] = 2 * s->real[V + i];
#ifndef READS_EARLY
    if (!s->initialized) return refuse(s, "fmiGetReal");
#endif
    for (size_t i = 0; i < n; i++) x[i] = s->real[r[i]];
    return fmi1OK;
}

fmi1Status FMI(SetReal)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1Real x[]) {
    instance *s = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] == T && x[i] <= 0) {
            s->callbacks.logger(s, s->name, fmi1Error, "error", "#r%u# = %g is not positive", r[i], x[i]);
            return fmi1Error;
        }
        if (s->initialized && r[i] >= K && r[i] <= FAULT_TIME) return refuse(s, "a parameter");
        s->real[r[i]] = x[i];
    }
    return fmi1OK;
}

#ifndef WITHOUT_STEP
fmi1Status FMI(DoStep)(fmi1Component c, fmi1Real t, fmi1Real h, fmi1Boolean new_step) {
    instance *s = c;
    if (!s->initialized || !new_step) return refuse(s, "fmiDoStep");
    int fault = t >= s->real[FAULT_TIME] - 1e-12 ? s->integer[FAULT] : 0;
    if (fault == 1) s->real[Y] = 0.0 / (s->real[T] - s->real[T]);
    if (fault == 2) {
        s->callbacks.logger(s, s->name, fmi1Error, "error", "step %d at %.3f s: %s, y is #r1#",
                            s->integer[STEPS], t, "too hot");
        return fmi1Error;
    }
    if (fault == 3) abort();
    if (fault == 9) *(volatile int *)(size_t)(fault - 9) = 1; /* a segmentation fault */
    if (fault == 4) {
        s->reached = t + h / 2;
        return fmi1Discard;
    }
    if (fault == 5) return fmi1Fatal;
    if (fault == 8) return 5; /* fmiPending */
    while (fault == 6) {
        volatile int forever = 1;
        (void)forever;
    }
    if (fault != 1 && s->flags[0]) s->real[Y] += h * (s->real[K] * s->real[U] - s->real[Y]) / s->real[T];
    s->integer[STEPS]++;
    s->reached = t + h;
    return fmi1OK;
}
#endif

fmi1Status FMI(TerminateSlave)(fmi1Component c) { return c ? fmi1OK : fmi1Error; }
fmi1Status FMI(ResetSlave)(fmi1Component c) {
    start(c);
    return fmi1OK;
}
fmi1Status FMI(GetRealStatus)(fmi1Component c, const fmi1StatusKind kind, fmi1Real *x) {
    if (kind != fmi1LastSuccessfulTime) return fmi1Discard;
    *x = ((instance *)c)->reached;
    return fmi1OK;
}
fmi1Status FMI(GetInteger)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1Integer x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->integer[r[i]];
    return fmi1OK;
}
fmi1Status FMI(SetInteger)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1Integer x[]) {
    for (size_t i = 0; i < n; i++) ((instance *)c)->integer[r[i]] = x[i];
    return fmi1OK;
}
fmi1Status FMI(GetBoolean)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1Boolean x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->flags[r[i]];
    return fmi1OK;
}
fmi1Status FMI(SetBoolean)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1Boolean x[]) {
    for (size_t i = 0; i < n; i++) ((instance *)c)->flags[r[i]] = x[i];
    return fmi1OK;
}
fmi1Status FMI(GetString)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1String x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->label;
    return fmi1OK;
}
fmi1Status FMI(SetString)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1String x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) snprintf(((instance *)c)->label, N_TEXT, "%s", x[i]);
    return fmi1OK;
}

/* What a tool that binds everything asks for. */
const char *FMI(GetVersion)(void) { return "1.0"; }
const char *FMI(GetTypesPlatform)(void) { return "standard32"; }
fmi1Status FMI(SetDebugLogging)(fmi1Component c, fmi1Boolean on) {
    (void)on;
    return c ? fmi1OK : fmi1Error;
}
fmi1Status FMI(CancelStep)(fmi1Component c) { return c ? fmi1Discard : fmi1Error; }
#define STATUS(name, type)                                                                       \
    fmi1Status FMI(Get##name##Status)(fmi1Component c, const fmi1StatusKind k, type *x) {        \
        (void)c, (void)k, (void)x;                                                               \
        return fmi1Discard;                                                                      \
    }
STATUS(, fmi1Status)
STATUS(Integer, fmi1Integer)
STATUS(Boolean, fmi1Boolean)
STATUS(String, fmi1String)
fmi1Status FMI(SetRealInputDerivatives)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                                        const fmi1Integer order[], const fmi1Real x[]) {
    (void)c, (void)r, (void)n, (void)order, (void)x;
    return fmi1Discard;
}
fmi1Status FMI(GetRealOutputDerivatives)(fmi1Component c, const fmi1ValueReference r[], size_t n,
                                         const fmi1Integer order[], fmi1Real x[]) {
    (void)c, (void)r, (void)n, (void)order, (void)x;
    return fmi1Discard;
}
