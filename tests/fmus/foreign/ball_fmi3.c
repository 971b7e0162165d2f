/* ball.h as an FMI 3.0 Model Exchange FMU. */
#include <stdlib.h>

#include "fmi3Functions.h"

#include "ball.h"

#define UNUSED(x) (void)(x)
#define IN(m) (((ball *)c)->mode == (m) ? fmi3OK : fmi3Error)

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean log_on,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log_on), UNUSED(environment), UNUSED(log);
    if (strcmp(token, "{ball}") != 0) return NULL;
    ball *b = calloc(1, sizeof *b);
    ball_start(b);
    return b;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 d, fmi3Float64 t,
                                       fmi3Boolean e, fmi3Float64 f) {
    UNUSED(a), UNUSED(d), UNUSED(e), UNUSED(f);
    ((ball *)c)->t = t;
    ((ball *)c)->mode = INITIALIZING;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ((ball *)c)->mode = EVENT;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance c) {
    ball_start(c);
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                          size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = ball_get(c, r[i]);
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n,
                          const fmi3Float64 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) {
        if (!ball_may_set(c, r[i])) return fmi3Error;
        ((ball *)c)->x[r[i]] = x[i];
    }
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s) {
    if (!*s) *s = malloc(sizeof(ball));
    memcpy(*s, c, sizeof(ball));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    memcpy(c, s, sizeof(ball));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s) {
    UNUSED(c);
    free(*s);
    *s = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState s, size_t *n) {
    UNUSED(c), UNUSED(s);
    *n = sizeof(ball);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState s, fmi3Byte out[], size_t n) {
    UNUSED(c);
    memcpy(out, s, n);
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte in[], size_t n, fmi3FMUState *s) {
    UNUSED(c);
    *s = malloc(n);
    memcpy(*s, in, n);
    return fmi3OK;
}
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t) {
    ((ball *)c)->t = t;
    return IN(CONTINUOUS);
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    *n = 2;
    return c ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    *n = 1;
    return c ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    memcpy(x, ((ball *)c)->x, n * sizeof *x);
    return fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
    memcpy(((ball *)c)->x, x, n * sizeof *x);
    return IN(CONTINUOUS);
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 dx[], size_t n) {
    ball_derivatives(c, dx);
    return n == 2 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n) {
    z[0] = ball_indicator(c);
    return n == 1 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    UNUSED(c);
    for (size_t i = 0; i < n; i++) x[i] = 1.0;
    return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    const fmi3Status status = IN(CONTINUOUS);
    ((ball *)c)->mode = EVENT;
    return status;
}
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) {
    const fmi3Status status = IN(EVENT);
    ((ball *)c)->mode = CONTINUOUS;
    return status;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *defined, fmi3Float64 *next) {
    *again = ball_event(c);
    *end = ball_ends(c);
    *nominals = *values = fmi3False;
    *defined = ball_next(c) < 1e9;
    *next = ball_next(c);
    return IN(EVENT);
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean a, fmi3Boolean *event,
                                       fmi3Boolean *end) {
    UNUSED(a);
    *event = fmi3False;
    *end = ball_ends(c);
    return IN(CONTINUOUS);
}
