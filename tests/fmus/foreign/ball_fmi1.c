/* ball.h as an FMI 1.0 Model Exchange FMU; states and the time are set outside of events only. */
#include <stdlib.h>

#include "fmi1Functions.h"

#pragma GCC visibility push(default) /* the header exports nothing */

#include "ball.h"

#define UNUSED(x) (void)(x)
#define FMI(name) ball_fmi##name

static void inform(ball *b, fmi1EventInfo *info, int again) {
    memset(info, 0, sizeof *info);
    info->iterationConverged = !again;
    info->terminateSimulation = (fmi1Boolean)ball_ends(b);
    info->upcomingTimeEvent = ball_next(b) < 1e9;
    info->nextEventTime = ball_next(b);
}

fmi1Component FMI(InstantiateModel)(fmi1String name, fmi1String guid, fmi1CallbackFunctions f, fmi1Boolean log) {
    UNUSED(name), UNUSED(log);
    if (strcmp(guid, "{ball}") != 0) return NULL;
    ball *b = f.allocateMemory(1, sizeof *b);
    ball_start(b);
    f.freeMemory(NULL);
    return b;
}
void FMI(FreeModelInstance)(fmi1Component c) { free(c); }
fmi1Status FMI(SetTime)(fmi1Component c, fmi1Real t) {
    ((ball *)c)->t = t;
    return ((ball *)c)->again ? fmi1Error : fmi1OK; /* the event iteration has not converged */
}
fmi1Status FMI(Initialize)(fmi1Component c, fmi1Boolean controlled, fmi1Real tolerance, fmi1EventInfo *info) {
    ball *b = c;
    UNUSED(controlled), UNUSED(tolerance);
    if (b->mode != INSTANTIATED) return fmi1Error;
    while (ball_event(b)) {
    }
    b->mode = CONTINUOUS;
    inform(b, info, 0);
    return fmi1OK;
}
fmi1Status FMI(EventUpdate)(fmi1Component c, fmi1Boolean intermediate, fmi1EventInfo *info) {
    ball *b = c;
    const int expected = b->again || ball_ends(b);
    UNUSED(intermediate);
    b->again = ball_event(b);
    inform(b, info, b->again);
    return b->again || expected ? fmi1OK : fmi1Error; /* an update without an event */
}
fmi1Status FMI(CompletedIntegratorStep)(fmi1Component c, fmi1Boolean *event) {
    *event = (fmi1Boolean)ball_ends(c);
    return fmi1OK;
}
fmi1Status FMI(Terminate)(fmi1Component c) { return c ? fmi1OK : fmi1Error; }
fmi1Status FMI(GetReal)(fmi1Component c, const fmi1ValueReference r[], size_t n, fmi1Real x[]) {
    if (((ball *)c)->mode == INSTANTIATED) return fmi1Error;
    for (size_t i = 0; i < n; i++) x[i] = ball_get(c, r[i]);
    return fmi1OK;
}
fmi1Status FMI(SetReal)(fmi1Component c, const fmi1ValueReference r[], size_t n, const fmi1Real x[]) {
    for (size_t i = 0; i < n; i++) {
        if (!ball_may_set(c, r[i])) return fmi1Error;
        ((ball *)c)->x[r[i]] = x[i];
    }
    return fmi1OK;
}
fmi1Status FMI(GetContinuousStates)(fmi1Component c, fmi1Real x[], size_t n) {
    memcpy(x, ((ball *)c)->x, n * sizeof *x);
    return fmi1OK;
}
fmi1Status FMI(SetContinuousStates)(fmi1Component c, const fmi1Real x[], size_t n) {
    memcpy(((ball *)c)->x, x, n * sizeof *x);
    return ((ball *)c)->mode == CONTINUOUS ? fmi1OK : fmi1Error;
}
fmi1Status FMI(GetDerivatives)(fmi1Component c, fmi1Real dx[], size_t n) {
    ball_derivatives(c, dx);
    return n == 2 ? fmi1OK : fmi1Error;
}
fmi1Status FMI(GetEventIndicators)(fmi1Component c, fmi1Real z[], size_t n) {
    z[0] = ball_indicator(c);
    return n == 1 ? fmi1OK : fmi1Error;
}
fmi1Status FMI(GetNominalContinuousStates)(fmi1Component c, fmi1Real x[], size_t n) {
    UNUSED(c);
    for (size_t i = 0; i < n; i++) x[i] = 1.0;
    return fmi1OK;
}
