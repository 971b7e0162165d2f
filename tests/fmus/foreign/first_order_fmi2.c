/* A first-order lag as an FMI 2.0 FMU, dy/dt = (k u - y) / T by Euler, that can also misbehave.
 *
 * From t >= fault_time on, `fault` makes do_step: 1 give NaN, 2 return error with a formatted
 * message, 3 abort, 4 discard, 5 return fatal, 6 never return, 7 ask to end after the step, 9 write
 * to address 0, 10 exit(0). With 11, fmi2GetFMUstate returns error. BARE leaves out all that a
 * plain simulation does not need.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

enum { N_REAL = 24, N_TEXT = 32 };
enum { U, Y, K, T, FAULT_TIME, V, W = V + 3, M = W + 3 }; /* v[3], w[3], m[2,2] */
enum { STEPS, FAULT, MODE, N_INTEGER };

typedef struct {
    fmi2Real real[N_REAL];
    fmi2Integer integer[N_INTEGER];
    fmi2Boolean on;
    char label[N_TEXT];
} values;

typedef struct {
    values v;
    fmi2CallbackFunctions callbacks;
    char name[64];
    double reached;
} instance;

static void start(values *v) {
    memset(v, 0, sizeof *v);
    v->real[K] = 1.0;
    v->real[T] = 0.5;
    for (int i = 0; i < 4; i++) v->real[M + i] = i + 1;
    v->on = fmi2True;
    v->integer[MODE] = 1;
    strcpy(v->label, "first order");
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    (void)type, (void)resources, (void)visible, (void)logging;
    if (strcmp(guid, "{first-order}") != 0) {
        callbacks->logger(callbacks->componentEnvironment, name, fmi2Error, "logStatusError",
                          "guid %s is wrong", guid);
        return NULL;
    }
    instance *s = callbacks->allocateMemory(1, sizeof *s);
    s->callbacks = *callbacks;
    snprintf(s->name, sizeof s->name, "%s", name);
    start(&s->v);
    callbacks->logger(callbacks->componentEnvironment, s->name, fmi2OK, "logAll",
                      "%d instance%s of %d %%", 1, "", 100);
    return s;
}

void fmi2FreeInstance(fmi2Component c) {
    instance *s = c;
    s->callbacks.freeMemory(s);
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real d,
                               fmi2Boolean e, fmi2Real f) {
    (void)c, (void)a, (void)b, (void)d, (void)e, (void)f;
#ifdef HABITS_OF_20SIM
    ((instance *)c)->v.real[K] = 1.0; /* parameters that were set before are lost */
#endif
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real x[]) {
    values *v = &((instance *)c)->v;
    for (int i = 0; i < 3; i++) v->real[W + i] = 2 * v->real[V + i];
    for (size_t i = 0; i < n; i++) x[i] = v->real[r[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n,
                       const fmi2Real x[]) {
    instance *s = c;
    for (size_t i = 0; i < n; i++) {
        if (r[i] == T && x[i] <= 0) {
            s->callbacks.logger(s->callbacks.componentEnvironment, s->name, fmi2Error,
                                "logStatusError", "#r%u# = %g is not positive", r[i], x[i]);
            return fmi2Error;
        }
        s->v.real[r[i]] = x[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean final) {
#ifdef HABITS_OF_FMI4CPP
    if (!final) return fmi2OK; /* it stands still unless earlier states will not be set */
#else
    (void)final;
#endif
    instance *s = c;
    values *v = &s->v;
#ifdef SHOWS_NO_RETURN
    v->real[Y] = final; /* noSetFMUStatePriorToCurrentPoint */
    return fmi2OK;
#endif
    int fault = t >= v->real[FAULT_TIME] - 1e-12 ? v->integer[FAULT] : 0;
    if (fault == 1) v->real[Y] = 0.0 / (v->real[T] - v->real[T]);
    if (fault == 2)
        s->callbacks.logger(s->callbacks.componentEnvironment, s->name, fmi2Error,
                            "logStatusError", "step %d at %.3f s: %s, y is #r1#",
                            v->integer[STEPS], t, "too hot");
    if (fault == 2) return fmi2Error;
    if (fault == 3) abort();
    if (fault == 9) *(volatile int *)(size_t)(fault - 9) = 1; /* a segmentation fault */
    if (fault == 10) exit(0);
    if (fault == 4) return fmi2Discard;
    if (fault == 5) return fmi2Fatal;
    while (fault == 6) {
        volatile int forever = 1;
        (void)forever;
    }
    if (fault != 1 && v->on) v->real[Y] += h * (v->real[K] * v->real[U] - v->real[Y]) / v->real[T];
    v->integer[STEPS]++;
    s->reached = t + h;
    return fault == 7 ? fmi2Discard : fmi2OK;
}

#ifndef BARE
const char *fmi2GetVersion(void) { return "2.0"; }
const char *fmi2GetTypesPlatform(void) { return "default"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) {
    (void)on, (void)n, (void)s;
    return c ? fmi2OK : fmi2Error;
}
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Reset(fmi2Component c) {
    start(&((instance *)c)->v);
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n,
                          fmi2Integer x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->v.integer[r[i]];
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n,
                          const fmi2Integer x[]) {
    for (size_t i = 0; i < n; i++) ((instance *)c)->v.integer[r[i]] = x[i];
    return fmi2OK;
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n,
                          fmi2Boolean x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->v.on;
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n,
                          const fmi2Boolean x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) ((instance *)c)->v.on = x[i];
    return fmi2OK;
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n,
                         fmi2String x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) x[i] = ((instance *)c)->v.label;
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n,
                         const fmi2String x[]) {
    (void)r;
    for (size_t i = 0; i < n; i++) snprintf(((instance *)c)->v.label, N_TEXT, "%s", x[i]);
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (((instance *)c)->v.integer[FAULT] == 11) return fmi2Error;
    if (*state == NULL) *state = malloc(sizeof(values));
    memcpy(*state, &((instance *)c)->v, sizeof(values));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(&((instance *)c)->v, state, sizeof(values));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)c, (void)state;
    *size = sizeof(values);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size) {
    (void)c;
    memcpy(bytes, state, size);
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state) {
    (void)c;
    if (size != sizeof(values)) return fmi2Error;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return fmi2OK;
}

/* d(w[i]) = 2 d(v[i]); y does not depend on u directly. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t n_unknown, const fmi2ValueReference known[],
                                        size_t n_known, const fmi2Real seed[], fmi2Real out[]) {
    (void)c;
    for (size_t i = 0; i < n_unknown; i++) {
        out[i] = 0;
        for (size_t j = 0; j < n_known; j++)
            if (unknown[i] == known[j] + 3) out[i] += 2 * seed[j];
    }
    return fmi2OK;
}

/* What a tool that binds everything asks for. */
#define STATUS(name, type)                                                                   \
    fmi2Status fmi2Get##name##Status(fmi2Component c, const fmi2StatusKind k, type *x) {     \
        (void)c, (void)k, (void)x;                                                           \
        return fmi2Discard;                                                                  \
    }
STATUS(, fmi2Status)
STATUS(Integer, fmi2Integer)
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real *x) {
    if (k != fmi2LastSuccessfulTime) return fmi2Discard;
    *x = ((instance *)c)->reached;
    return fmi2OK;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean *x) {
    if (k != fmi2Terminated) return fmi2Discard;
    *x = ((instance *)c)->v.integer[FAULT] == 7;
    return fmi2OK;
}
STATUS(String, fmi2String)
fmi2Status fmi2CancelStep(fmi2Component c) { return c ? fmi2Discard : fmi2Error; }
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real x[]) {
    (void)c, (void)r, (void)n, (void)order, (void)x;
    return fmi2Discard;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real x[]) {
    (void)c, (void)r, (void)n, (void)order, (void)x;
    return fmi2Discard;
}
#endif
