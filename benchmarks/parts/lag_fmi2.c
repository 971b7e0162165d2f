/* The smallest first-order lag as an FMI 2.0 FMU, dy/dt = (u - y) / T by Euler's method: a step
 * costs next to nothing, so that a benchmark over it measures the engine. */
#include <stdlib.h>
#include <string.h>

#include "fmi2Functions.h"

typedef struct {
    double u, y, T;
} lag;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)c, (void)on, (void)n, (void)names;
    return fmi2OK;
}
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible,
                              fmi2Boolean logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
    lag *s = calloc(1, sizeof *s);
    if (s) s->T = 0.5;
    return s;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real b, fmi2Real start, fmi2Boolean d,
                               fmi2Real stop) {
    (void)c, (void)a, (void)b, (void)start, (void)d, (void)stop;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Reset(fmi2Component c) {
    memset(c, 0, sizeof(lag));
    ((lag *)c)->T = 0.5;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] > 2) return fmi2Error;
        x[i] = (&((lag *)c)->u)[r[i]];
    }
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) {
        if (r[i] > 2) return fmi2Error;
        (&((lag *)c)->u)[r[i]] = x[i];
    }
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean a) {
    lag *s = c;
    (void)t, (void)a;
    s->y += h * (s->u - s->y) / s->T;
    return fmi2OK;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!*state) *state = malloc(sizeof(lag));
    if (!*state) return fmi2Error;
    memcpy(*state, c, sizeof(lag));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    memcpy(c, state, sizeof(lag));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* What other engines look for, and this FMU has no values of. */
#define NONE(name, type)                                                                         \
    fmi2Status name(fmi2Component c, const fmi2ValueReference r[], size_t n, type x[]) {         \
        (void)c, (void)r, (void)x;                                                               \
        return n ? fmi2Error : fmi2OK;                                                           \
    }
NONE(fmi2GetInteger, fmi2Integer)
NONE(fmi2GetBoolean, fmi2Boolean)
NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer)
NONE(fmi2SetBoolean, const fmi2Boolean)
NONE(fmi2SetString, const fmi2String)
fmi2Status fmi2CancelStep(fmi2Component c) { return c ? fmi2Error : fmi2Error; }
#define STATUS(name, type)                                                                       \
    fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type *x) {                       \
        (void)c, (void)kind, (void)x;                                                            \
        return fmi2Discard;                                                                      \
    }
STATUS(fmi2GetStatus, fmi2Status)
STATUS(fmi2GetRealStatus, fmi2Real)
STATUS(fmi2GetIntegerStatus, fmi2Integer)
STATUS(fmi2GetBooleanStatus, fmi2Boolean)
STATUS(fmi2GetStringStatus, fmi2String)
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                       const fmi2Integer order[], const fmi2Real x[]) {
    (void)c, (void)r, (void)order, (void)x;
    return n ? fmi2Error : fmi2OK;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n,
                                        const fmi2Integer order[], fmi2Real x[]) {
    (void)c, (void)r, (void)order, (void)x;
    return n ? fmi2Error : fmi2OK;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference z[], size_t nz,
                                        const fmi2ValueReference v[], size_t nv, const fmi2Real dv[],
                                        fmi2Real dz[]) {
    (void)c, (void)z, (void)nz, (void)v, (void)nv, (void)dv, (void)dz;
    return fmi2Error;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) {
    (void)c, (void)s;
    *n = sizeof(lag);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) {
    (void)c;
    memcpy(b, s, n);
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s) {
    (void)c;
    *s = malloc(sizeof(lag));
    if (!*s) return fmi2Error;
    memcpy(*s, b, n);
    return fmi2OK;
}
