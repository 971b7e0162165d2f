/* ball.h as an FMI 2.0 Model Exchange FMU. */
#include <stdlib.h>

#include "fmi2Functions.h"

#include "ball.h"

#define UNUSED(x) (void)(x)
#define IN(m) (((ball *)c)->mode == (m) ? fmi2OK : fmi2Error)

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *f, fmi2Boolean visible, fmi2Boolean log) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log), UNUSED(f);
    if (type != fmi2ModelExchange || strcmp(guid, "{ball}") != 0) return NULL;
    ball *b = calloc(1, sizeof *b);
    ball_start(b);
    return b;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean a, fmi2Real d, fmi2Real t,
                               fmi2Boolean e, fmi2Real f) {
    UNUSED(a), UNUSED(d), UNUSED(e), UNUSED(f);
    ((ball *)c)->t = t;
    return IN(INSTANTIATED);
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    ((ball *)c)->mode = INITIALIZING;
    return fmi2OK;
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    ((ball *)c)->mode = EVENT;
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Reset(fmi2Component c) {
    ball_start(c);
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ball_get(c, r[i]);
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real x[]) {
    for (size_t i = 0; i < n; i++) {
        if (!ball_may_set(c, r[i])) return fmi2Error;
        ((ball *)c)->x[r[i]] = x[i];
    }
    return fmi2OK;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *s) {
    if (!*s) *s = malloc(sizeof(ball));
    memcpy(*s, c, sizeof(ball));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
    memcpy(c, s, sizeof(ball));
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *s) {
    UNUSED(c);
    free(*s);
    *s = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t *n) {
    UNUSED(c), UNUSED(s);
    *n = sizeof(ball);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte out[], size_t n) {
    UNUSED(c);
    memcpy(out, s, n);
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte in[], size_t n, fmi2FMUstate *s) {
    UNUSED(c);
    *s = malloc(n);
    memcpy(*s, in, n);
    return fmi2OK;
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) {
    ((ball *)c)->t = t;
    return IN(CONTINUOUS);
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    memcpy(x, ((ball *)c)->x, n * sizeof *x);
    return fmi2OK;
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    memcpy(((ball *)c)->x, x, n * sizeof *x);
    return IN(CONTINUOUS);
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real dx[], size_t n) {
    ball_derivatives(c, dx);
    return n == 2 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) {
    z[0] = ball_indicator(c);
    return n == 1 ? fmi2OK : fmi2Error;
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    UNUSED(c);
    for (size_t i = 0; i < n; i++) x[i] = 1.0;
    return fmi2OK;
}
fmi2Status fmi2EnterEventMode(fmi2Component c) {
    const fmi2Status status = IN(CONTINUOUS);
    ((ball *)c)->mode = EVENT;
    return status;
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    const fmi2Status status = IN(EVENT);
    ((ball *)c)->mode = CONTINUOUS;
    return status;
}
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    memset(info, 0, sizeof *info);
    info->newDiscreteStatesNeeded = ball_event(c);
    info->terminateSimulation = ball_ends(c);
    info->nextEventTimeDefined = ball_next(c) < 1e9;
    info->nextEventTime = ball_next(c);
    return IN(EVENT);
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean a, fmi2Boolean *event,
                                       fmi2Boolean *end) {
    UNUSED(a);
    *event = fmi2False;
    *end = ball_ends(c);
    return IN(CONTINUOUS);
}
