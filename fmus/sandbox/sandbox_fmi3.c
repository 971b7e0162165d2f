/* The functions of FMI 3.0, for an instance in a sandbox. */
#include <stdbool.h>
#include <string.h>

#include "uuv_sandbox.h"

#define S ((uuv_sandbox *)c)
#define CALL(NAME, FORM, ...) return sandbox_invoke(S, F_fmi3##NAME, FORM, ##__VA_ARGS__)
#define FMI3(NAME) SANDBOX_EXPORT int sandbox_fmi3##NAME

#define NUMBERS(NAME, TYPE)                                                                          \
    FMI3(Get##NAME)(void *c, const uint32_t *r, size_t n, TYPE *v, size_t count) {                   \
        return sandbox_get(S, F_fmi3Get##NAME, r, n, v, count, sizeof(TYPE), 1);                     \
    }                                                                                                \
    FMI3(Set##NAME)(void *c, const uint32_t *r, size_t n, const TYPE *v, size_t count) {             \
        return sandbox_set(S, F_fmi3Set##NAME, r, n, v, count, sizeof(TYPE), 1);                     \
    }
NUMBERS(Float32, float)
NUMBERS(Float64, double)
NUMBERS(Int8, int8_t)
NUMBERS(UInt8, uint8_t)
NUMBERS(Int16, int16_t)
NUMBERS(UInt16, uint16_t)
NUMBERS(Int32, int32_t)
NUMBERS(UInt32, uint32_t)
NUMBERS(Int64, int64_t)
NUMBERS(UInt64, uint64_t)
NUMBERS(Boolean, bool)

FMI3(GetClock)(void *c, const uint32_t *r, size_t n, bool *v) {
    return sandbox_get(S, F_fmi3GetClock, r, n, v, n, 1, 0);
}
FMI3(SetClock)(void *c, const uint32_t *r, size_t n, const bool *v) {
    return sandbox_set(S, F_fmi3SetClock, r, n, v, n, 1, 0);
}
FMI3(GetString)(void *c, const uint32_t *r, size_t n, const char **v, size_t count) {
    return sandbox_get_texts(S, F_fmi3GetString, r, n, v, count, 1);
}
FMI3(SetString)(void *c, const uint32_t *r, size_t n, const char *const *v, size_t count) {
    return sandbox_set_texts(S, F_fmi3SetString, r, n, v, count, 1);
}

/* Bytes stay in the module, where the caller reads them until the next call. */
FMI3(GetBinary)(void *c, const uint32_t *r, size_t n, size_t *sizes, const uint8_t **v, size_t count) {
    uint32_t place, first = (uint32_t)(4 * n), found[2];
    uint8_t *room = sandbox_room(S, first + 8 * count, &place);
    if (!room) return SANDBOX_FATAL;
    memcpy(room, r, 4 * n);
    memset(room + first, 0, 8 * count);
    raw a[6] = {{(int32_t)S->instance}, {(int32_t)place}, {(int32_t)n}, {(int32_t)(place + first)},
                {(int32_t)(place + first + 4 * count)}, {(int32_t)count}};
    if (!sandbox_call(S, F_fmi3GetBinary, a, 6)) return SANDBOX_FATAL;
    const uint8_t *base = S->api.memory_data(S->context, &S->memory);
    uint64_t size = S->api.memory_size(S->context, &S->memory);
    for (size_t i = 0; (uint32_t)a[0].i32 <= SANDBOX_WARNING && i < count; i++) {
        memcpy(&found[0], base + place + first + 4 * i, 4);
        memcpy(&found[1], base + place + first + 4 * (count + i), 4);
        if ((uint64_t)found[0] + found[1] > size) {
            sandbox_end(S, "it returned bytes that are outside its memory");
            return SANDBOX_FATAL;
        }
        sizes[i] = found[0];
        v[i] = base + found[1];
    }
    return a[0].i32;
}
FMI3(SetBinary)(void *c, const uint32_t *r, size_t n, const size_t *sizes, const uint8_t *const *v, size_t count) {
    uint32_t place, first = (uint32_t)(4 * n), next = (uint32_t)(first + 8 * count), word;
    size_t bytes = next;
    for (size_t i = 0; i < count; i++) bytes += sizes[i];
    uint8_t *room = sandbox_room(S, bytes, &place);
    if (!room) return SANDBOX_FATAL;
    memcpy(room, r, 4 * n);
    for (size_t i = 0; i < count; i++) {
        word = (uint32_t)sizes[i];
        memcpy(room + first + 4 * i, &word, 4);
        word = place + next;
        memcpy(room + first + 4 * (count + i), &word, 4);
        if (sizes[i]) memcpy(room + next, v[i], sizes[i]);
        next += (uint32_t)sizes[i];
    }
    raw a[6] = {{(int32_t)S->instance}, {(int32_t)place}, {(int32_t)n}, {(int32_t)(place + first)},
                {(int32_t)(place + first + 4 * count)}, {(int32_t)count}};
    return sandbox_call(S, F_fmi3SetBinary, a, 6) ? a[0].i32 : SANDBOX_FATAL;
}

/* `log` is the module's function for messages, which calls `report`. */
SANDBOX_EXPORT void *uuv_sandbox_instantiate_fmi3(uuv_sandbox *c, int model_exchange, const char *name,
                                                  const char *token, const char *resources, int logging,
                                                  uint32_t log, void *environment, void *report) {
    raw a[12];
    uint32_t place;
    size_t sizes[3] = {strlen(name) + 1, strlen(token) + 1, resources ? strlen(resources) + 1 : 0}, n = 0;
    const char *texts[3] = {name, token, resources};
    S->environment = environment;
    S->report = report;
    uint8_t *room = sandbox_room(S, sizes[0] + sizes[1] + sizes[2], &place);
    if (!room) return NULL;
    for (int i = 0; i < 3; i++) {
        a[n++].i32 = sizes[i] ? (int32_t)place : 0;
        if (sizes[i]) memcpy(room, texts[i], sizes[i]);
        room += sizes[i];
        place += (uint32_t)sizes[i];
    }
    a[n++].i32 = 0; /* visible */
    a[n++].i32 = logging;
    if (!model_exchange) { /* no event mode, no early return, no intermediate variables */
        a[n++].i32 = 0;
        a[n++].i32 = 0;
        a[n++].i32 = 0;
        a[n++].i32 = 0;
    }
    a[n++].i32 = 0; /* environment */
    a[n++].i32 = (int32_t)log;
    if (!model_exchange) a[n++].i32 = 0;
    if (!sandbox_call(S, model_exchange ? F_fmi3InstantiateModelExchange : F_fmi3InstantiateCoSimulation, a, n))
        return NULL;
    S->instance = (uint32_t)a[0].i32;
    return S->instance ? S : NULL;
}

SANDBOX_EXPORT void sandbox_fmi3FreeInstance(void *c) { sandbox_invoke(S, F_fmi3FreeInstance, ""); }
FMI3(EnterInitializationMode)(void *c, bool tolerance_defined, double tolerance, double start, bool stop_defined,
                              double stop) {
    CALL(EnterInitializationMode, "iddid", tolerance_defined, tolerance, start, stop_defined, stop);
}
FMI3(ExitInitializationMode)(void *c) { CALL(ExitInitializationMode, ""); }
FMI3(EnterConfigurationMode)(void *c) { CALL(EnterConfigurationMode, ""); }
FMI3(ExitConfigurationMode)(void *c) { CALL(ExitConfigurationMode, ""); }
FMI3(EnterEventMode)(void *c) { CALL(EnterEventMode, ""); }
FMI3(EnterContinuousTimeMode)(void *c) { CALL(EnterContinuousTimeMode, ""); }
FMI3(Terminate)(void *c) { CALL(Terminate, ""); }
FMI3(Reset)(void *c) { CALL(Reset, ""); }

FMI3(DoStep)(void *c, double t, double h, bool never_back, bool *event, bool *end, bool *early, double *reached) {
    uint32_t place;
    uint8_t *room = sandbox_room(S, 16, &place);
    if (!room) return SANDBOX_FATAL;
    memset(room, 0, 8);
    memcpy(room + 8, reached, 8);
    raw a[8] = {{(int32_t)S->instance}};
    a[1].f64 = t;
    a[2].f64 = h;
    a[3].i32 = never_back;
    a[4].i32 = (int32_t)place;
    a[5].i32 = (int32_t)place + 1;
    a[6].i32 = (int32_t)place + 2;
    a[7].i32 = (int32_t)place + 8;
    if (!sandbox_call(S, F_fmi3DoStep, a, 8)) return SANDBOX_FATAL;
    room = S->api.memory_data(S->context, &S->memory) + place;
    *event = room[0] != 0;
    *end = room[1] != 0;
    *early = room[2] != 0;
    memcpy(reached, room + 8, 8);
    return a[0].i32;
}

FMI3(GetFMUState)(void *c, void **state) { CALL(GetFMUState, "Q", state); }
FMI3(SetFMUState)(void *c, void *state) { CALL(SetFMUState, "p", state); }
FMI3(FreeFMUState)(void *c, void **state) { CALL(FreeFMUState, "Q", state); }
FMI3(SerializedFMUStateSize)(void *c, void *state, size_t *size) { CALL(SerializedFMUStateSize, "pZ", state, size); }
FMI3(SerializeFMUState)(void *c, void *state, uint8_t *bytes, size_t size) {
    CALL(SerializeFMUState, "pXn", state, bytes, size);
}
FMI3(DeserializeFMUState)(void *c, const uint8_t *bytes, size_t size, void **state) {
    CALL(DeserializeFMUState, "xnP", bytes, size, state);
}
FMI3(GetDirectionalDerivative)(void *c, const uint32_t *u, size_t nu, const uint32_t *k, size_t nk,
                               const double *seed, size_t n_seed, double *out, size_t n_out) {
    CALL(GetDirectionalDerivative, "RnRnDnVn", u, nu, k, nk, seed, n_seed, out, n_out);
}

/* ---- Model Exchange --------------------------------------------------------------------- */

FMI3(SetTime)(void *c, double t) { CALL(SetTime, "d", t); }
FMI3(GetContinuousStates)(void *c, double *x, size_t n) { CALL(GetContinuousStates, "Vn", x, n); }
FMI3(SetContinuousStates)(void *c, const double *x, size_t n) { CALL(SetContinuousStates, "Dn", x, n); }
FMI3(GetContinuousStateDerivatives)(void *c, double *x, size_t n) { CALL(GetContinuousStateDerivatives, "Vn", x, n); }
FMI3(GetEventIndicators)(void *c, double *z, size_t n) { CALL(GetEventIndicators, "Vn", z, n); }
FMI3(GetNominalsOfContinuousStates)(void *c, double *x, size_t n) { CALL(GetNominalsOfContinuousStates, "Vn", x, n); }
FMI3(GetNumberOfContinuousStates)(void *c, size_t *n) { CALL(GetNumberOfContinuousStates, "Z", n); }
FMI3(GetNumberOfEventIndicators)(void *c, size_t *n) { CALL(GetNumberOfEventIndicators, "Z", n); }
FMI3(UpdateDiscreteStates)(void *c, bool *more, bool *end, bool *nominals, bool *values, bool *has_next, double *next) {
    CALL(UpdateDiscreteStates, "bbbbbO", more, end, nominals, values, has_next, next);
}
FMI3(CompletedIntegratorStep)(void *c, bool never_back, bool *event, bool *end) {
    CALL(CompletedIntegratorStep, "ibb", never_back, event, end);
}
