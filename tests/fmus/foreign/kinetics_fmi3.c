/* Robertson's chemical kinetics as an FMI 3.0 FMU, for Model Exchange and for Co-Simulation:
 *   da/dt = -0.04 a + 1e4 b c,  db/dt = 0.04 a - 1e4 b c - 3e7 b^2,  c = 1 - a - b.
 * In Co-Simulation, a step is one of Euler's. `kind` says which interface is used. The structural
 * parameter n is the size of the input u, the gain (n rows of 2) and the output
 * y[i] = gain[i,1] + gain[i,2] u[i]; the FMU checks the sizes that it is given. */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)

enum { A = 1, B, C, DA, DB, KIND, N, U, GAIN, Y };
enum { MOST = 8 };
enum mode { INSTANTIATED, CONFIGURING, RUNNING };

typedef struct {
    double x[2], t, u[MOST], gain[2 * MOST];
    fmi3UInt64 n;
    int32_t kind;
    enum mode mode;
} kinetics;

static void start(kinetics *k) {
    const int32_t kind = k->kind;
    memset(k, 0, sizeof *k);
    k->kind = kind;
    k->x[0] = 1.0;
    k->n = 3;
}

static fmi3Instance make(fmi3String token, int32_t kind) {
    if (strcmp(token, "{kinetics}") != 0) return NULL;
    kinetics *k = calloc(1, sizeof *k);
    k->kind = kind;
    start(k);
    return k;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(logging), UNUSED(environment), UNUSED(log);
    return make(token, 2);
}
fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(logging), UNUSED(events), UNUSED(early);
    UNUSED(required), UNUSED(n_required), UNUSED(environment), UNUSED(log), UNUSED(update);
    return make(token, 1);
}
void fmi3FreeInstance(fmi3Instance s) { free(s); }

fmi3Status fmi3EnterConfigurationMode(fmi3Instance s) {
    kinetics *k = s;
    if (k->mode != INSTANTIATED) return fmi3Error;
    k->mode = CONFIGURING;
    return fmi3OK;
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance s) {
    kinetics *k = s;
    if (k->mode != CONFIGURING) return fmi3Error;
    k->mode = INSTANTIATED;
    return fmi3OK;
}
fmi3Status fmi3EnterInitializationMode(fmi3Instance s, fmi3Boolean a, fmi3Float64 b,
                                       fmi3Float64 t, fmi3Boolean d, fmi3Float64 e) {
    UNUSED(a), UNUSED(b), UNUSED(d), UNUSED(e);
    kinetics *k = s;
    if (k->mode != INSTANTIATED) return fmi3Error;
    k->mode = RUNNING;
    k->t = t;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }
fmi3Status fmi3Terminate(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance s) {
    start(s);
    return fmi3OK;
}

static void derivatives(const kinetics *k, double dx[]) {
    const double a = k->x[0], b = k->x[1], c = 1.0 - a - b;
    dx[0] = -0.04 * a + 1e4 * b * c;
    dx[1] = 0.04 * a - 1e4 * b * c - 3e7 * b * b;
}

static size_t size_of(const kinetics *k, fmi3ValueReference r) {
    return r == GAIN ? 2 * k->n : r == U || r == Y ? k->n : 1;
}

fmi3Status fmi3GetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                          size_t n_x) {
    const kinetics *k = s;
    double dx[2];
    derivatives(k, dx);
    for (size_t i = 0; i < n; i++) {
        const size_t size = size_of(k, r[i]);
        if (size > n_x) return fmi3Error;
        for (size_t j = 0; j < size; j++)
            x[j] = r[i] == 0      ? k->t
                   : r[i] == A    ? k->x[0]
                   : r[i] == B    ? k->x[1]
                   : r[i] == C    ? 1.0 - k->x[0] - k->x[1]
                   : r[i] == DA   ? dx[0]
                   : r[i] == DB   ? dx[1]
                   : r[i] == U    ? k->u[j]
                   : r[i] == GAIN ? k->gain[j]
                                  : k->gain[2 * j] + k->gain[2 * j + 1] * k->u[j];
        x += size, n_x -= size;
    }
    return n_x == 0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                          const fmi3Float64 x[], size_t n_x) {
    kinetics *k = s;
    for (size_t i = 0; i < n; i++) {
        const size_t size = size_of(k, r[i]);
        if (size > n_x || (r[i] != U && r[i] != GAIN)) return fmi3Error;
        memcpy(r[i] == U ? k->u : k->gain, x, size * sizeof *x);
        x += size, n_x -= size;
    }
    return n_x == 0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Int32 x[],
                        size_t n_x) {
    if (n != 1 || n_x != 1 || r[0] != KIND) return fmi3Error;
    x[0] = ((kinetics *)s)->kind;
    return fmi3OK;
}
fmi3Status fmi3GetUInt64(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3UInt64 x[],
                         size_t n_x) {
    if (n != 1 || n_x != 1 || r[0] != N) return fmi3Error;
    x[0] = ((kinetics *)s)->n;
    return fmi3OK;
}
fmi3Status fmi3SetUInt64(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                         const fmi3UInt64 x[], size_t n_x) {
    kinetics *k = s;
    if (n != 1 || n_x != 1 || r[0] != N || k->mode != CONFIGURING || x[0] > MOST) return fmi3Error;
    k->n = x[0];
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance s, fmi3Float64 t, fmi3Float64 h, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    UNUSED(final);
    kinetics *k = s;
    double dx[2];
    derivatives(k, dx);
    for (int i = 0; i < 2; i++) k->x[i] += h * dx[i];
    k->t = *reached = t + h;
    *event = *end = *early = fmi3False;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance s, fmi3Float64 t) {
    ((kinetics *)s)->t = t;
    return fmi3OK;
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance s, size_t *n) {
    *n = 2;
    return s ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance s, size_t *n) {
    *n = 0;
    return s ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetContinuousStates(fmi3Instance s, fmi3Float64 x[], size_t n) {
    memcpy(x, ((kinetics *)s)->x, n * sizeof *x);
    return fmi3OK;
}
fmi3Status fmi3SetContinuousStates(fmi3Instance s, const fmi3Float64 x[], size_t n) {
    memcpy(((kinetics *)s)->x, x, n * sizeof *x);
    return fmi3OK;
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance s, fmi3Float64 dx[], size_t n) {
    derivatives(s, dx);
    return n == 2 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetEventIndicators(fmi3Instance s, fmi3Float64 z[], size_t n) {
    UNUSED(z);
    return s && n == 0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance s, fmi3Float64 x[], size_t n) {
    UNUSED(s), UNUSED(n);
    x[0] = 1.0, x[1] = 1e-4;
    return fmi3OK;
}
fmi3Status fmi3EnterEventMode(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance s, fmi3Boolean *again, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *defined, fmi3Float64 *next) {
    *again = *end = *nominals = *values = *defined = fmi3False;
    *next = 0.0;
    return s ? fmi3OK : fmi3Error;
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance s, fmi3Boolean final, fmi3Boolean *event,
                                       fmi3Boolean *end) {
    UNUSED(final);
    *event = *end = fmi3False;
    return s ? fmi3OK : fmi3Error;
}
