/* Five tasks for Scheduled Execution in FMI 3.0, each a model partition of an input clock: fast (every
 * 0.1 s from 0.05 s) adds u to sum, starts the countdown late at each fourth tick and activates the output
 * clock done at each third; slow (every `period`) copies fast's number of ticks to seen; shrink
 * has intervals 0.1 s, 0.2 s, ...; asked is triggered by the importer. Each partition writes its time to at.
 * FAULT: 1 has an interval of 0 s, 2 restarts the countdown without delay, 3 keeps preemption locked, 4
 * needs an interval that is not known, 5 returns an error, 6 restarts it with a vanishing delay. */
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#ifndef FAULT
#define FAULT 0
#endif
#define UNUSED(x) (void)(x)

enum { FAST = 1, SLOW, SHRINK, LATE, ASKED, DONE, N_CLOCKS };
enum { U = 10, PERIOD, DELAY, SUM, AT, N_FAST, N_SLOW, N_SHRINK, N_LATE, N_ASKED, SEEN };

typedef struct {
    double u, period, delay, sum, at, countdown;
    int n[N_CLOCKS], seen, changed, done, updating, running;
} values;

typedef struct {
    values v;
    fmi3InstanceEnvironment environment;
    fmi3ClockUpdateCallback update;
    fmi3LockPreemptionCallback lock;
    fmi3UnlockPreemptionCallback unlock;
} tasks;

static void start(tasks *x) {
    memset(&x->v, 0, sizeof x->v);
    x->v.period = 0.3;
    x->v.delay = 0.02;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean log_on,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(log_on), UNUSED(log);
    if (strcmp(token, "{tasks}") != 0) return NULL;
    tasks *x = calloc(1, sizeof *x);
    *x = (tasks){.environment = environment, .update = update, .lock = lock, .unlock = unlock};
    start(x);
    return x;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean a, fmi3Float64 d, fmi3Float64 t, fmi3Boolean e,
                                       fmi3Float64 f) {
    UNUSED(c), UNUSED(a), UNUSED(d), UNUSED(t), UNUSED(e), UNUSED(f);
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    ((tasks *)c)->v.running = 1;
    return fmi3OK;
}
fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance c) {
    start(c);
    return fmi3OK;
}

static double *real(values *v, fmi3ValueReference r) {
    return r == U ? &v->u : r == PERIOD ? &v->period : r == DELAY ? &v->delay : r == SUM ? &v->sum : &v->at;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[], size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = *real(&((tasks *)c)->v, r[i]);
    return fmi3OK;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 x[],
                          size_t n_x) {
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) *real(&((tasks *)c)->v, r[i]) = x[i];
    return fmi3OK;
}
fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 x[], size_t n_x) {
    const values *v = &((tasks *)c)->v;
    UNUSED(n_x);
    for (size_t i = 0; i < n; i++) x[i] = r[i] == SEEN ? v->seen : v->n[r[i] - N_FAST + FAST];
    return fmi3OK;
}
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *s) {
    if (!*s) *s = malloc(sizeof(values));
    memcpy(*s, &((tasks *)c)->v, sizeof(values));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) {
    memcpy(&((tasks *)c)->v, s, sizeof(values));
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
    *n = sizeof(values);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState s, fmi3Byte data[], size_t n) {
    UNUSED(c);
    memcpy(data, s, n);
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte data[], size_t n, fmi3FMUState *s) {
    UNUSED(c);
    *s = malloc(sizeof(values));
    memcpy(*s, data, n);
    return fmi3OK;
}

/* Output clocks may be read in Clock Update Mode only. */
fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock x[]) {
    values *v = &((tasks *)c)->v;
    if (n != 1 || r[0] != DONE || !v->updating) return fmi3Error;
    x[0] = v->done;
    v->done = 0;
    return fmi3OK;
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[],
                                  fmi3IntervalQualifier q[]) {
    values *v = &((tasks *)c)->v;
    if (n != 1) return fmi3Error;
    q[0] = FAULT == 4 ? fmi3IntervalNotYetKnown : fmi3IntervalChanged;
    x[0] = 0.0;
    if (r[0] == SLOW) x[0] = FAULT == 1 ? 0.0 : v->period;
    if (r[0] == SHRINK) x[0] = 0.1 * (v->n[SHRINK] + 1);
    if (r[0] == LATE) {
        q[0] = v->changed ? fmi3IntervalChanged : v->n[LATE] ? fmi3IntervalUnchanged : fmi3IntervalNotYetKnown;
        x[0] = v->countdown;
        v->changed = 0;
    }
    return fmi3OK;
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 x[]) {
    UNUSED(c);
    if (n != 1 || r[0] != SLOW) return fmi3Error;
    x[0] = 0.05;
    return fmi3OK;
}
static void report(tasks *x) {
    x->v.updating = 1;
    x->update(x->environment);
    x->v.updating = 0;
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference r, fmi3Float64 t) {
    tasks *x = c;
    values *v = &x->v;
    if (!v->running || r < FAST || r > ASKED || FAULT == 5) return fmi3Error;
    x->lock();
    v->n[r]++;
    v->at = t;
    if (FAULT != 3) x->unlock();
    if (r == FAST) {
        v->sum += v->u;
        v->done = v->n[FAST] % 3 == 0;
        v->changed = v->n[FAST] % 4 == 0;
        v->countdown = v->delay;
        if (v->done || v->changed) report(x);
    }
    if (r == SLOW) v->seen = v->n[FAST];
    if (r == LATE && (FAULT == 2 || FAULT == 6)) {
        v->changed = 1;
        v->countdown = FAULT == 2 ? 0.0 : 1e-9;
        report(x);
    }
    return fmi3OK;
}
