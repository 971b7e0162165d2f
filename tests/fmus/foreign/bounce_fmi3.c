/* A ball that bounces, for Co-Simulation in FMI 3.0: dh/dt = v, dv/dt = -g, and v <- -e v at the
 * ground, by the closed form. It counts its bounces (hits); whenever the input hit has another value,
 * its own speed gets a kick. With Event Mode it returns early at the instant of a bounce, and takes
 * hit in Event Mode only; without, it bounces inside its step, and takes hit at the step's start.
 * FAULT: 1 needs rounds without end, 2 returns early without progress, 3 counts at each round. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#ifndef FAULT
#define FAULT 0
#endif
#define UNUSED(x) (void)(x)

enum { H, V, G, E, KICK, N_VALUES, HIT = 5, HITS = 6 };
enum mode { STARTING, EVENT, STEP };

typedef struct {
    double x[N_VALUES], t;
    int hit, taken, hits, lands, events;
    enum mode mode;
} ball;

static void start(ball *b) {
    const int events = b->events;
    memset(b, 0, sizeof *b);
    b->events = events;
    b->x[H] = 1.0;
    b->x[G] = 9.81;
    b->x[E] = 0.8;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean log_on, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference r[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log_on), UNUSED(r), UNUSED(n);
    UNUSED(environment), UNUSED(log), UNUSED(update);
    if (strcmp(token, "{bounce}") != 0 || events != early) return NULL;
    ball *b = calloc(1, sizeof *b);
    b->events = events;
    start(b);
    return b;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 d, fmi3Float64 t,
                                       fmi3Boolean e, fmi3Float64 f) {
    UNUSED(a), UNUSED(d), UNUSED(e), UNUSED(f);
    ((ball *)c)->t = t;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ball *b = c;
    b->taken = b->hit;
    b->mode = b->events ? EVENT : STEP;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance c) {
    start(c);
    return fmi3OK;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = ((ball *)c)->x[r[i]];
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[],
                          size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) ((ball *)c)->x[r[i]] = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = r[i] == HIT ? ((ball *)c)->hit : ((ball *)c)->hits;
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 x[], size_t n_x) {
    ball *b = c;
    UNUSED(r), UNUSED(n_x);
    if (b->events && b->mode == STEP) return fmi3Error; /* discrete inputs are set in Event Mode */
    for (size_t i = 0; i < n; i++) b->hit = x[i];
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

static void take_hit(ball *b) {
    if (b->hit != b->taken) b->x[V] += b->x[KICK];
    b->taken = b->hit;
}
static void bounce(ball *b) {
    b->x[H] = 0.0;
    b->x[V] *= -b->x[E];
    b->hits++;
}
static void fly(ball *b, double s) {
    b->x[H] += s * (b->x[V] - 0.5 * b->x[G] * s);
    b->x[V] -= b->x[G] * s;
    b->t += s;
}
/* Seconds until the ball lands. */
static double time_to_land(const ball *b) {
    const double v = b->x[V], g = b->x[G];
    return (v + sqrt(v * v + 2.0 * g * b->x[H])) / g;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    ball *b = c;
    const fmi3Status status = b->events && b->mode == STEP ? fmi3OK : fmi3Error;
    b->mode = EVENT;
    return status;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    ball *b = c;
    const fmi3Status status = b->mode == EVENT ? fmi3OK : fmi3Error;
    b->mode = STEP;
    return status;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next) {
    ball *b = c;
    const int lands = b->lands;
    if (b->mode != EVENT) return fmi3Error;
    b->lands = 0;
    if (lands) bounce(b);
    if (FAULT == 3 && b->t > 0.0) b->hits++;
    take_hit(b);
    *again = lands || (FAULT == 1 && b->t > 0.0);
    *end = *nominals = *values = *defined = fmi3False;
    *next = 0.0;
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean never_goes_back,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    ball *b = c;
    double rest = h;
    UNUSED(never_goes_back);
    if (b->mode != STEP || fabs(t - b->t) > 1e-9) return fmi3Error;
    b->t = t;
    *event = *end = *early = fmi3False;
    if (!b->events) take_hit(b);
    for (;;) {
        const double s = time_to_land(b);
        if (FAULT == 2 && b->hits) {
            *event = *early = fmi3True;
            break;
        }
        if (s > rest) {
            fly(b, rest);
            break;
        }
        fly(b, s);
        if (b->events) {
            b->x[H] = 0.0;
            b->lands = 1;
            *event = fmi3True;
            *early = s < rest;
            break;
        }
        bounce(b);
        rest -= s;
    }
    *reached = b->t;
    return fmi3OK;
}
