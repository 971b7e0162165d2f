/* A component for the slot "$path"; change law() to what you want.
   All variables lie in one array, and a value reference is an index into it. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

enum { $places, SIZE };

typedef struct {
    double v[SIZE];
    double t;
} Instance;

/* Sets the outputs, valid at t + dt, from the inputs at t. */
static void law(double *v, double t, double dt)
{
    (void)t;
    (void)dt;
${body}}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token,
                              fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)token, (void)resources, (void)callbacks, (void)visible, (void)logging;
    Instance *c = type == fmi2CoSimulation ? calloc(1, sizeof(Instance)) : NULL;
    if (c) fmi2Reset(c);
    return c;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *self = c;
    memset(self, 0, sizeof *self);
${starts}    return fmi2OK;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= SIZE) return fmi2Error;
        value[i] = ((Instance *)c)->v[vr[i]];
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                       const fmi2Real value[])
{
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= SIZE) return fmi2Error;
        ((Instance *)c)->v[vr[i]] = value[i];
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real dt, fmi2Boolean keeps)
{
    (void)keeps;
    law(((Instance *)c)->v, t, dt);
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    if (!*state) *state = malloc(sizeof(Instance));
    if (!*state) return fmi2Error;
    memcpy(*state, c, sizeof(Instance));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    memcpy(c, state, sizeof(Instance));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

/* What a component without integers, strings and derivatives must still have. */
#define EMPTY(name, ...) fmi2Status name(__VA_ARGS__)
#define REFUSED { return fmi2Error; }
#define FINE { return fmi2OK; }
const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
EMPTY(fmi2SetDebugLogging, fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) FINE
EMPTY(fmi2SetupExperiment, fmi2Component c, fmi2Boolean d, fmi2Real tol, fmi2Real t0,
      fmi2Boolean e, fmi2Real t1) FINE
EMPTY(fmi2EnterInitializationMode, fmi2Component c) FINE
EMPTY(fmi2ExitInitializationMode, fmi2Component c) FINE
EMPTY(fmi2Terminate, fmi2Component c) FINE
EMPTY(fmi2GetInteger, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer v[])
REFUSED
EMPTY(fmi2GetBoolean, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean v[])
REFUSED
EMPTY(fmi2GetString, fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String v[])
REFUSED
EMPTY(fmi2SetInteger, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer v[]) REFUSED
EMPTY(fmi2SetBoolean, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Boolean v[]) REFUSED
EMPTY(fmi2SetString, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2String v[]) REFUSED
EMPTY(fmi2SerializedFMUstateSize, fmi2Component c, fmi2FMUstate s, size_t *n) REFUSED
EMPTY(fmi2SerializeFMUstate, fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) REFUSED
EMPTY(fmi2DeSerializeFMUstate, fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
REFUSED
EMPTY(fmi2GetDirectionalDerivative, fmi2Component c, const fmi2ValueReference u[], size_t n,
      const fmi2ValueReference k[], size_t m, const fmi2Real a[], fmi2Real b[]) REFUSED
EMPTY(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer o[], const fmi2Real v[]) REFUSED
EMPTY(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference r[], size_t n,
      const fmi2Integer o[], fmi2Real v[]) REFUSED
EMPTY(fmi2CancelStep, fmi2Component c) REFUSED
EMPTY(fmi2GetStatus, fmi2Component c, const fmi2StatusKind k, fmi2Status *s) REFUSED
EMPTY(fmi2GetRealStatus, fmi2Component c, const fmi2StatusKind k, fmi2Real *v) REFUSED
EMPTY(fmi2GetIntegerStatus, fmi2Component c, const fmi2StatusKind k, fmi2Integer *v) REFUSED
EMPTY(fmi2GetBooleanStatus, fmi2Component c, const fmi2StatusKind k, fmi2Boolean *v) REFUSED
EMPTY(fmi2GetStringStatus, fmi2Component c, const fmi2StatusKind k, fmi2String *v) REFUSED
