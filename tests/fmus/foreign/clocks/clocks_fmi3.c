/* Clocks of FMI 3.0 for Co-Simulation, which refuses every call that the standard does not allow.
 * k: counts its ticks, and takes w. c: its n-th interval is n * wait. in: takes u; out: ticks with each
 * `every`-th tick of k, or, as an echo, with `in` and y = u + 1. x is the time.
 * FAULT: 1 out ticks in each round, 2 the third interval of c is negative, 3 c ticks again at once. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#ifndef FAULT
#define FAULT 0
#endif
#define UNUSED(x) (void)(x)

enum { K = 1, C, IN, OUT, TICKS = 10, AT, U, Y, GOT, SUM, COUNTED, W, W_SUM, X, EVERY, ECHO, WAIT, INTERVAL, SHIFT };
enum mode { STARTING, INITIALIZING, EVENT, STEP };

typedef struct {
    double t, at, u, y, sum, w, w_sum, wait, interval, shift, told;
    int ticks, got, counted, every, echo, known;
    int k, c, in, out, read; /* which are active; `out` was read */
    enum mode mode;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} clockwork;

static void start(clockwork *s) {
    const fmi3LogMessageCallback log = s->log;
    const fmi3InstanceEnvironment environment = s->environment;
    memset(s, 0, sizeof *s);
    s->log = log, s->environment = environment;
    s->every = 1;
    s->interval = 0.1;
    s->told = -1.0;
}
static fmi3Status refuse(const clockwork *s, const char *why) {
    s->log(s->environment, fmi3Error, "logStatusError", why);
    return fmi3Error;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean log_on, fmi3Boolean events,
                                         fmi3Boolean early, const fmi3ValueReference r[], size_t n,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log_on), UNUSED(r), UNUSED(n), UNUSED(update);
    UNUSED(early);
    if (strcmp(token, "{clocks}") != 0 || !events) return NULL;
    clockwork *s = calloc(1, sizeof *s);
    s->log = log, s->environment = environment;
    start(s);
    return s;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 d, fmi3Float64 t,
                                       fmi3Boolean e, fmi3Float64 f) {
    clockwork *s = c;
    UNUSED(a), UNUSED(d), UNUSED(e), UNUSED(f);
    s->t = t;
    s->mode = INITIALIZING;
    s->known = s->wait != 0.0 || FAULT == 3;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ((clockwork *)c)->mode = EVENT;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance c) {
    start(c);
    return fmi3OK;
}

static int closed(const clockwork *s, int active) { return s->mode == STEP || (s->mode == EVENT && !active); }

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t n_x) {
    clockwork *s = c;
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) {
        if ((r[i] == AT && closed(s, s->k)) || (r[i] == Y && closed(s, s->out)) || (r[i] == U && closed(s, s->in)) ||
            (r[i] == W && closed(s, s->k)))
            return refuse(s, "a clocked variable is read while its clock is not active");
        x[i] = r[i] == AT ? s->at : r[i] == U ? s->u : r[i] == Y ? (s->echo ? s->u + 1.0 : s->at) : r[i] == SUM ? s->sum
             : r[i] == W ? s->w : r[i] == W_SUM ? s->w_sum : r[i] == X ? s->t : r[i] == WAIT ? s->wait
             : r[i] == INTERVAL ? s->interval : s->shift;
    }
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[], size_t n_x) {
    clockwork *s = c;
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) {
        if ((r[i] == U && closed(s, s->in)) || (r[i] == W && closed(s, s->k)))
            return refuse(s, "a clocked variable is set while its clock is not active");
        if (r[i] == INTERVAL && s->mode == STEP) return refuse(s, "a parameter is set in Step Mode");
        *(r[i] == U ? &s->u : r[i] == W ? &s->w : r[i] == WAIT ? &s->wait : r[i] == INTERVAL ? &s->interval : &s->shift) = x[i];
    }
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    clockwork *s = c;
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) {
        if (r[i] == TICKS && closed(s, s->k)) return refuse(s, "ticks is read while k is not active");
        x[i] = r[i] == TICKS ? s->ticks : r[i] == GOT ? s->got : r[i] == COUNTED ? s->counted : s->every;
    }
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 x[], size_t n_x) {
    UNUSED(r), UNUSED(n), UNUSED(n_x);
    ((clockwork *)c)->every = x[0];
    return fmi3OK;
}
fmi3Status fmi3GetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Boolean x[], size_t n_x) {
    UNUSED(r), UNUSED(n), UNUSED(n_x);
    x[0] = ((clockwork *)c)->echo;
    return fmi3OK;
}
fmi3Status fmi3SetBoolean(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Boolean x[], size_t n_x) {
    UNUSED(r), UNUSED(n), UNUSED(n_x);
    ((clockwork *)c)->echo = x[0];
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s) {
    if (!*s) *s = malloc(sizeof(clockwork));
    memcpy(*s, c, sizeof(clockwork));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    memcpy(c, s, sizeof(clockwork));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *s) {
    UNUSED(c);
    free(*s);
    *s = NULL;
    return fmi3OK;
}

/* ---- clocks ------------------------------------------------------------------------------- */

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock x[]) {
    clockwork *s = c;
    if (s->mode != EVENT || n != 1 || r[0] != OUT) return refuse(s, "fmi3GetClock is not allowed");
    x[0] = s->out && !s->read;
    s->read = s->out;
    return fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Clock x[]) {
    clockwork *s = c;
    if (s->mode != EVENT) return refuse(s, "fmi3SetClock is called outside Event Mode");
    for (size_t i = 0; i < n; i++) {
        if (!x[i] || (r[i] == K ? s->k : r[i] == C ? s->c : s->in)) return refuse(s, "a clock is set twice");
        if (r[i] == K) {
            s->k = 1;
            s->ticks++;
            s->at = s->t;
            s->out |= s->every && s->ticks % s->every == 0;
        } else if (r[i] == C) {
            s->c = 1;
            s->counted++;
        } else {
            s->in = 1;
            s->out |= s->echo;
        }
    }
    return fmi3OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                                  fmi3IntervalQualifier q[]) {
    clockwork *s = c;
    if (s->mode == STEP || n != 1) return refuse(s, "fmi3GetIntervalDecimal is not allowed");
    if (r[0] == C) {
        q[0] = s->known ? fmi3IntervalChanged : fmi3IntervalNotYetKnown;
        x[0] = FAULT == 3 ? 0.0 : (s->counted + 1) * s->wait * (FAULT == 2 && s->counted == 2 ? -1.0 : 1.0);
        s->known = 0;
        return fmi3OK;
    }
    x[0] = s->interval;
    q[0] = s->told == s->interval ? fmi3IntervalUnchanged : fmi3IntervalChanged;
    s->told = s->interval;
    return fmi3OK;
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[]) {
    UNUSED(n), UNUSED(r);
    x[0] = ((clockwork *)c)->shift;
    return fmi3OK;
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[]) {
    UNUSED(n);
    if (r[0] != K || ((clockwork *)c)->mode != INITIALIZING) return refuse(c, "fmi3SetIntervalDecimal is not allowed");
    ((clockwork *)c)->interval = ((clockwork *)c)->told = x[0];
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c) {
    clockwork *s = c;
    if (s->mode != STEP) return refuse(s, "fmi3EnterEventMode is not allowed");
    s->mode = EVENT;
    return fmi3OK;
}
fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    clockwork *s = c;
    if (s->mode != EVENT || s->k || s->c || s->in || s->out) return refuse(s, "fmi3EnterStepMode is not allowed");
    s->mode = STEP;
    return fmi3OK;
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals,
                                    fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next) {
    clockwork *s = c;
    if (s->mode != EVENT) return refuse(s, "fmi3UpdateDiscreteStates is not allowed");
    if (s->k) s->w_sum += s->w;
    if (s->in) s->got++, s->sum += s->u;
    if (s->c) s->known = 1;
    s->k = s->c = s->in = s->read = 0;
    s->out = FAULT == 1 && s->ticks > 1;
    *again = *end = *nominals = *values = *defined = fmi3False;
    *next = 0.0;
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean never_goes_back,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *reached) {
    clockwork *s = c;
    UNUSED(never_goes_back);
    if (s->mode != STEP || fabs(t - s->t) > 1e-9) return refuse(s, "fmi3DoStep is not allowed");
    *reached = s->t = t + h;
    *event = *end = *early = fmi3False;
    return fmi3OK;
}
