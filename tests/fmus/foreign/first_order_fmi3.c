/* A first-order lag as an FMI 3.0 FMU, dy/dt = (k u - y) / T by Euler, with an echo of each type.
 *
 * Value references: 100 + i is the input and 200 + i the output of type i; do_step copies them.
 * `fault` as in first_order_fmi2.c, and 8: returns early.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)

enum { U = 1, Y, K, T, FAULT_TIME, FAULT, N, V, W, M };
enum { BYTES = 64 };

#define TYPES(X)                                                                             \
    X(Float32, 0) X(Int8, 2) X(UInt8, 3) X(Int16, 4) X(UInt16, 5) X(UInt32, 7) X(Int64, 8)   \
    X(UInt64, 9) X(Boolean, 10)

typedef struct {
    fmi3Float64 u, y, k, T, fault_time, v[3], m[4];
    fmi3Int32 fault;
#define FIELD(type, i) fmi3##type in_##type, out_##type;
    TYPES(FIELD)
    fmi3Int32 in_Int32[2], out_Int32[2];
    char in_String[2][BYTES], out_String[2][BYTES];
    fmi3Byte in_Binary[BYTES], out_Binary[BYTES];
    size_t in_size, out_size;
} values;

typedef struct {
    values v;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} instance;

static void start(values *v) {
    memset(v, 0, sizeof *v);
    v->k = 1.0;
    v->T = 0.5;
    for (int i = 0; i < 4; i++) v->m[i] = i + 1;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean events, fmi3Boolean early,
    const fmi3ValueReference required[], size_t n_required, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    UNUSED(name), UNUSED(resources), UNUSED(visible), UNUSED(logging), UNUSED(events);
    UNUSED(early), UNUSED(required), UNUSED(n_required), UNUSED(update);
    if (strcmp(token, "{first-order}") != 0) {
        log(environment, fmi3Error, "logStatusError", "the token is wrong");
        return NULL;
    }
    instance *s = calloc(1, sizeof *s);
    s->environment = environment;
    s->log = log;
    start(&s->v);
    return s;
}
void fmi3FreeInstance(fmi3Instance s) { free(s); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance s, fmi3Boolean a, fmi3Float64 b,
                                       fmi3Float64 c, fmi3Boolean d, fmi3Float64 e) {
    UNUSED(a), UNUSED(b), UNUSED(c), UNUSED(d), UNUSED(e);
    return s ? fmi3OK : fmi3Error;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }

static fmi3Float64 *float64(values *v, fmi3ValueReference r, size_t *n) {
    *n = r == V || r == W ? 3 : r == M ? 4 : 1;
    return r == U            ? &v->u
           : r == Y          ? &v->y
           : r == K          ? &v->k
           : r == T          ? &v->T
           : r == FAULT_TIME ? &v->fault_time
           : r == V          ? v->v
           : r == M          ? v->m
                             : NULL;
}

fmi3Status fmi3GetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                          fmi3Float64 x[], size_t n_x) {
    values *v = &((instance *)s)->v;
    fmi3Float64 w[3];
    for (int i = 0; i < 3; i++) w[i] = 2 * v->v[i];
    for (size_t i = 0; i < n; i++) {
        size_t size;
        fmi3Float64 *p = float64(v, r[i], &size);
        if (r[i] == W) p = w;
        if (p == NULL || size > n_x) return fmi3Error;
        memcpy(x, p, size * sizeof *x);
        x += size, n_x -= size;
    }
    return n_x == 0 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetFloat64(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                          const fmi3Float64 x[], size_t n_x) {
    for (size_t i = 0; i < n; i++) {
        size_t size;
        fmi3Float64 *p = float64(&((instance *)s)->v, r[i], &size);
        if (p == NULL || size > n_x) return fmi3Error;
        memcpy(p, x, size * sizeof *x);
        x += size, n_x -= size;
    }
    return n_x == 0 ? fmi3OK : fmi3Error;
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean final,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early,
                      fmi3Float64 *reached) {
    UNUSED(final);
    instance *s = c;
    values *v = &s->v;
#ifdef SHOWS_NO_RETURN
    v->y = final; /* noSetFMUStatePriorToCurrentPoint */
    *event = *end = *early = false;
    *reached = t + h;
    return fmi3OK;
#endif
    int fault = t >= v->fault_time - 1e-12 ? v->fault : 0;
    *event = false, *end = fault == 7, *early = fault == 8;
    *reached = fault == 8 ? t + h / 2 : t + h;
    if (fault == 1) v->y = 0.0 / (v->T - v->T);
    if (fault == 2) s->log(s->environment, fmi3Error, "logStatusError", "too hot");
    if (fault == 2) return fmi3Error;
    if (fault == 3) abort();
    if (fault == 9) *(volatile int *)(size_t)(fault - 9) = 1; /* a segmentation fault */
    if (fault == 10) exit(0);
    if (fault == 4) return fmi3Discard;
    if (fault == 5) return fmi3Fatal;
    while (fault == 6) {
        volatile int forever = 1;
        UNUSED(forever);
    }
    if (fault != 1) v->y += h * (v->k * v->u - v->y) / v->T;
#define ECHO(type, i) v->out_##type = v->in_##type;
    TYPES(ECHO)
    memcpy(v->out_Int32, v->in_Int32, sizeof v->in_Int32);
    memcpy(v->out_String, v->in_String, sizeof v->in_String);
    memcpy(v->out_Binary, v->in_Binary, BYTES);
    v->out_size = v->in_size;
    return fmi3OK;
}

#ifndef BARE
fmi3Status fmi3Terminate(fmi3Instance s) { return s ? fmi3OK : fmi3Error; }
fmi3Status fmi3Reset(fmi3Instance s) {
    start(&((instance *)s)->v);
    return fmi3OK;
}

#define ACCESS(type, i)                                                                       \
    fmi3Status fmi3Get##type(fmi3Instance s, const fmi3ValueReference r[], size_t n,          \
                             fmi3##type x[], size_t n_x) {                                    \
        values *v = &((instance *)s)->v;                                                      \
        if (n != 1 || n_x != 1) return fmi3Error;                                             \
        *x = r[0] == 100 + i ? v->in_##type : v->out_##type;                                  \
        return fmi3OK;                                                                        \
    }                                                                                         \
    fmi3Status fmi3Set##type(fmi3Instance s, const fmi3ValueReference r[], size_t n,          \
                             const fmi3##type x[], size_t n_x) {                              \
        if (n != 1 || n_x != 1 || r[0] != 100 + i) return fmi3Error;                          \
        ((instance *)s)->v.in_##type = *x;                                                    \
        return fmi3OK;                                                                        \
    }
TYPES(ACCESS)

fmi3Status fmi3GetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3Int32 x[],
                        size_t n_x) {
    values *v = &((instance *)s)->v;
    if (n != 1) return fmi3Error;
    if (r[0] == FAULT) x[0] = v->fault;
    if (r[0] == FAULT) return fmi3OK;
    if (n_x != 2) return fmi3Error;
    memcpy(x, r[0] == 106 ? v->in_Int32 : v->out_Int32, sizeof v->in_Int32);
    return fmi3OK;
}
fmi3Status fmi3SetInt32(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                        const fmi3Int32 x[], size_t n_x) {
    values *v = &((instance *)s)->v;
    if (n != 1) return fmi3Error;
    if (r[0] == FAULT) v->fault = x[0];
    if (r[0] == FAULT) return fmi3OK;
    if (n_x != 2) return fmi3Error;
    memcpy(v->in_Int32, x, sizeof v->in_Int32);
    return fmi3OK;
}

fmi3Status fmi3GetString(fmi3Instance s, const fmi3ValueReference r[], size_t n, fmi3String x[],
                         size_t n_x) {
    values *v = &((instance *)s)->v;
    if (n != 1 || n_x != 2) return fmi3Error;
    for (int i = 0; i < 2; i++) x[i] = r[0] == 111 ? v->in_String[i] : v->out_String[i];
    return fmi3OK;
}
fmi3Status fmi3SetString(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                         const fmi3String x[], size_t n_x) {
    UNUSED(r);
    if (n != 1 || n_x != 2) return fmi3Error;
    for (int i = 0; i < 2; i++) snprintf(((instance *)s)->v.in_String[i], BYTES, "%s", x[i]);
    return fmi3OK;
}
fmi3Status fmi3GetBinary(fmi3Instance s, const fmi3ValueReference r[], size_t n, size_t sizes[],
                         fmi3Binary x[], size_t n_x) {
    values *v = &((instance *)s)->v;
    if (n != 1 || n_x != 1) return fmi3Error;
    sizes[0] = r[0] == 112 ? v->in_size : v->out_size;
    x[0] = r[0] == 112 ? v->in_Binary : v->out_Binary;
    return fmi3OK;
}
fmi3Status fmi3SetBinary(fmi3Instance s, const fmi3ValueReference r[], size_t n,
                         const size_t sizes[], const fmi3Binary x[], size_t n_x) {
    UNUSED(r);
    values *v = &((instance *)s)->v;
    if (n != 1 || n_x != 1 || sizes[0] > BYTES) return fmi3Error;
    memcpy(v->in_Binary, x[0], sizes[0]);
    v->in_size = sizes[0];
    return fmi3OK;
}

fmi3Status fmi3GetFMUState(fmi3Instance s, fmi3FMUState *state) {
    if (*state == NULL) *state = malloc(sizeof(values));
    memcpy(*state, &((instance *)s)->v, sizeof(values));
    return fmi3OK;
}
fmi3Status fmi3SetFMUState(fmi3Instance s, fmi3FMUState state) {
#ifdef FORGETS_ITS_STATE
    UNUSED(s), UNUSED(state);
    return fmi3OK;
#endif
    memcpy(&((instance *)s)->v, state, sizeof(values));
    return fmi3OK;
}
fmi3Status fmi3FreeFMUState(fmi3Instance s, fmi3FMUState *state) {
    UNUSED(s);
    free(*state);
    *state = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance s, fmi3FMUState state, size_t *size) {
    UNUSED(s), UNUSED(state);
    *size = sizeof(values);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance s, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size) {
    UNUSED(s);
    memcpy(bytes, state, size);
    return fmi3OK;
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance s, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state) {
    UNUSED(s);
    if (size != sizeof(values)) return fmi3Error;
    *state = malloc(size);
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* d(w) = 2 d(v) */
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance s, const fmi3ValueReference unknowns[],
                                        size_t n_unknowns, const fmi3ValueReference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 out[], size_t n_out) {
    UNUSED(s);
    if (n_unknowns != 1 || n_knowns != 1 || unknowns[0] != W || knowns[0] != V) return fmi3Error;
    if (n_seed != 3 || n_out != 3) return fmi3Error;
    for (int i = 0; i < 3; i++) out[i] = 2 * seed[i];
    return fmi3OK;
}
#endif
