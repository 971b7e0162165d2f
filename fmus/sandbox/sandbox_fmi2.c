/* The functions of FMI 2.0, for an instance in a sandbox. */
#include <string.h>

#include "uuv_sandbox.h"

#define S ((uuv_sandbox *)c)
#define CALL(NAME, FORM, ...) return sandbox_invoke(S, F_fmi2##NAME, FORM, ##__VA_ARGS__)
#define FMI2(NAME) SANDBOX_EXPORT int sandbox_fmi2##NAME
enum { EVENT_INFO = 32 }; /* bytes of fmi2EventInfo, here and in the module */

#define NUMBERS(NAME, TYPE)                                                                          \
    FMI2(Get##NAME)(void *c, const uint32_t *r, size_t n, TYPE *v) {                                 \
        return sandbox_get(S, F_fmi2Get##NAME, r, n, v, n, sizeof(TYPE), 0);                         \
    }                                                                                                \
    FMI2(Set##NAME)(void *c, const uint32_t *r, size_t n, const TYPE *v) {                           \
        return sandbox_set(S, F_fmi2Set##NAME, r, n, v, n, sizeof(TYPE), 0);                         \
    }
NUMBERS(Real, double)
NUMBERS(Integer, int)
NUMBERS(Boolean, int)

FMI2(GetString)(void *c, const uint32_t *r, size_t n, const char **v) {
    return sandbox_get_texts(S, F_fmi2GetString, r, n, v, n, 0);
}
FMI2(SetString)(void *c, const uint32_t *r, size_t n, const char *const *v) {
    return sandbox_set_texts(S, F_fmi2SetString, r, n, v, n, 0);
}

/* `callbacks` are a structure of the module, whose logger calls `report`. */
SANDBOX_EXPORT void *uuv_sandbox_instantiate_fmi2(uuv_sandbox *c, int co_simulation, const char *name,
                                                  const char *token, const char *resources, int logging,
                                                  uint32_t callbacks, void *environment, void *report) {
    uint32_t place;
    size_t n_name = strlen(name) + 1, n_token = strlen(token) + 1;
    S->environment = environment;
    S->report = report;
    uint8_t *room = sandbox_room(S, n_name + n_token + strlen(resources) + 1, &place);
    if (!room) return NULL;
    memcpy(room, name, n_name);
    memcpy(room + n_name, token, n_token);
    strcpy((char *)room + n_name + n_token, resources);
    raw a[7] = {{(int32_t)place}, {co_simulation}, {(int32_t)(place + n_name)}, {(int32_t)(place + n_name + n_token)},
                {(int32_t)callbacks}, {0}, {logging}};
    if (!sandbox_call(S, F_fmi2Instantiate, a, 7)) return NULL;
    S->instance = (uint32_t)a[0].i32;
    return S->instance ? S : NULL;
}

SANDBOX_EXPORT void sandbox_fmi2FreeInstance(void *c) { sandbox_invoke(S, F_fmi2FreeInstance, ""); }
FMI2(SetupExperiment)(void *c, int tolerance_defined, double tolerance, double start, int stop_defined, double stop) {
    CALL(SetupExperiment, "iddid", tolerance_defined, tolerance, start, stop_defined, stop);
}
FMI2(EnterInitializationMode)(void *c) { CALL(EnterInitializationMode, ""); }
FMI2(ExitInitializationMode)(void *c) { CALL(ExitInitializationMode, ""); }
FMI2(EnterEventMode)(void *c) { CALL(EnterEventMode, ""); }
FMI2(EnterContinuousTimeMode)(void *c) { CALL(EnterContinuousTimeMode, ""); }
FMI2(Terminate)(void *c) { CALL(Terminate, ""); }
FMI2(Reset)(void *c) { CALL(Reset, ""); }

FMI2(DoStep)(void *c, double t, double h, int never_back) {
    raw a[4] = {{(int32_t)S->instance}};
    a[1].f64 = t;
    a[2].f64 = h;
    a[3].i32 = never_back;
    return sandbox_call(S, F_fmi2DoStep, a, 4) ? a[0].i32 : SANDBOX_FATAL;
}

FMI2(GetFMUstate)(void *c, void **state) { CALL(GetFMUstate, "Q", state); }
FMI2(SetFMUstate)(void *c, void *state) { CALL(SetFMUstate, "p", state); }
FMI2(FreeFMUstate)(void *c, void **state) { CALL(FreeFMUstate, "Q", state); }
FMI2(SerializedFMUstateSize)(void *c, void *state, size_t *size) { CALL(SerializedFMUstateSize, "pZ", state, size); }
FMI2(SerializeFMUstate)(void *c, void *state, uint8_t *bytes, size_t size) {
    CALL(SerializeFMUstate, "pXn", state, bytes, size);
}
FMI2(DeSerializeFMUstate)(void *c, const uint8_t *bytes, size_t size, void **state) {
    CALL(DeSerializeFMUstate, "xnP", bytes, size, state);
}
FMI2(GetDirectionalDerivative)(void *c, const uint32_t *u, size_t nu, const uint32_t *k, size_t nk,
                               const double *seed, double *out) {
    CALL(GetDirectionalDerivative, "RnRnDV", u, nu, k, nk, seed, nk, out, nu);
}
FMI2(GetBooleanStatus)(void *c, int kind, int *value) { CALL(GetBooleanStatus, "iI", kind, value); }
FMI2(GetRealStatus)(void *c, int kind, double *value) { CALL(GetRealStatus, "iO", kind, value); }

/* ---- Model Exchange --------------------------------------------------------------------- */

FMI2(SetTime)(void *c, double t) { CALL(SetTime, "d", t); }
FMI2(GetContinuousStates)(void *c, double *x, size_t n) { CALL(GetContinuousStates, "Vn", x, n); }
FMI2(SetContinuousStates)(void *c, const double *x, size_t n) { CALL(SetContinuousStates, "Dn", x, n); }
FMI2(GetDerivatives)(void *c, double *x, size_t n) { CALL(GetDerivatives, "Vn", x, n); }
FMI2(GetEventIndicators)(void *c, double *z, size_t n) { CALL(GetEventIndicators, "Vn", z, n); }
FMI2(GetNominalsOfContinuousStates)(void *c, double *x, size_t n) { CALL(GetNominalsOfContinuousStates, "Vn", x, n); }
FMI2(NewDiscreteStates)(void *c, void *info) { CALL(NewDiscreteStates, "X", info, (size_t)EVENT_INFO); }
FMI2(CompletedIntegratorStep)(void *c, int never_back, int *event, int *end) {
    CALL(CompletedIntegratorStep, "iII", never_back, event, end);
}
