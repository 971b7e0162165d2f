/* Part of an FMU's WebAssembly component (FMI-LS-WASM): FMI 3.0's functions under the names, and with
 * the arguments, of the component model's canonical ABI.
 *
 * The host allocates lists and texts by cabi_realloc; they are freed when a call ends. Results lie in
 * memory that is reused by the next call. `sizes` of the generated header has the number of values
 * of each reference, which the interface does not state. */
#include <stdlib.h>
#include <string.h>

#include "component_sizes.h"
#include "fmi3Functions.h"

/* Functions that an FMU may lack: a call of one that it lacks ends the module. */
#pragma weak fmi3CompletedIntegratorStep
#pragma weak fmi3DeserializeFMUState
#pragma weak fmi3DoStep
#pragma weak fmi3EnterConfigurationMode
#pragma weak fmi3EnterContinuousTimeMode
#pragma weak fmi3EnterEventMode
#pragma weak fmi3EnterInitializationMode
#pragma weak fmi3EnterStepMode
#pragma weak fmi3EvaluateDiscreteStates
#pragma weak fmi3ExitConfigurationMode
#pragma weak fmi3ExitInitializationMode
#pragma weak fmi3FreeFMUState
#pragma weak fmi3FreeInstance
#pragma weak fmi3GetAdjointDerivative
#pragma weak fmi3GetBinary
#pragma weak fmi3GetBoolean
#pragma weak fmi3GetClock
#pragma weak fmi3GetContinuousStateDerivatives
#pragma weak fmi3GetContinuousStates
#pragma weak fmi3GetDirectionalDerivative
#pragma weak fmi3GetEventIndicators
#pragma weak fmi3GetFMUState
#pragma weak fmi3GetFloat32
#pragma weak fmi3GetFloat64
#pragma weak fmi3GetInt16
#pragma weak fmi3GetInt32
#pragma weak fmi3GetInt64
#pragma weak fmi3GetInt8
#pragma weak fmi3GetNominalsOfContinuousStates
#pragma weak fmi3GetNumberOfContinuousStates
#pragma weak fmi3GetNumberOfEventIndicators
#pragma weak fmi3GetString
#pragma weak fmi3GetUInt16
#pragma weak fmi3GetUInt32
#pragma weak fmi3GetUInt64
#pragma weak fmi3GetUInt8
#pragma weak fmi3GetVersion
#pragma weak fmi3InstantiateCoSimulation
#pragma weak fmi3InstantiateModelExchange
#pragma weak fmi3Reset
#pragma weak fmi3SerializeFMUState
#pragma weak fmi3SerializedFMUStateSize
#pragma weak fmi3SetBinary
#pragma weak fmi3SetBoolean
#pragma weak fmi3SetClock
#pragma weak fmi3SetContinuousStates
#pragma weak fmi3SetDebugLogging
#pragma weak fmi3SetFMUState
#pragma weak fmi3SetFloat32
#pragma weak fmi3SetFloat64
#pragma weak fmi3SetInt16
#pragma weak fmi3SetInt32
#pragma weak fmi3SetInt64
#pragma weak fmi3SetInt8
#pragma weak fmi3SetString
#pragma weak fmi3SetTime
#pragma weak fmi3SetUInt16
#pragma weak fmi3SetUInt32
#pragma weak fmi3SetUInt64
#pragma weak fmi3SetUInt8
#pragma weak fmi3Terminate
#pragma weak fmi3UpdateDiscreteStates

#define EXPORTED(NAME) __attribute__((export_name(NAME), visibility("default")))
#define IMPORTED(MODULE, NAME) __attribute__((import_module(MODULE), import_name(NAME)))

IMPORTED("fmi:fmi3/callbacks@3.0.0", "log-message")
void log_message(const char *name, size_t n_name, int status, const char *category, size_t n_category,
                 const char *text, size_t n_text);

/* ---- memory ----------------------------------------------------------------------------- */

typedef struct given {
    struct given *next;
    uint64_t bytes[];
} given;
static given *of_host;   /* what the host has allocated for this call */
static void *results[2]; /* of the last call, and their sizes */
static size_t rooms[2];
static _Alignas(8) uint8_t area[48];

EXPORTED("cabi_realloc") void *cabi_realloc(void *before, size_t old, size_t alignment, size_t size) {
    if (!size) return (void *)alignment;
    given *made = malloc(sizeof *made + size);
    if (!made) __builtin_trap();
    made->next = of_host;
    of_host = made;
    if (before) memcpy(made->bytes, before, old < size ? old : size);
    return made->bytes;
}

static void *room(int which, size_t size) {
    if (size > rooms[which] || !results[which]) {
        free(results[which]);
        results[which] = malloc(rooms[which] = size + 64);
        if (!results[which]) __builtin_trap();
    }
    return results[which];
}

static void release(void) {
    while (of_host) {
        given *next = of_host->next;
        free(of_host);
        of_host = next;
    }
}

/* ---- results: a byte that is 1 for an error, then its status or the value ---------------- */

static int finished(fmi3Status status) {
    release();
    return (int)status;
}

static void *result_of(fmi3Status status, int place) {
    release();
    area[0] = status > fmi3Warning;
    if (area[0]) area[place] = (uint8_t)status;
    return area;
}

static void *list_of(fmi3Status status, const void *items, size_t n) {
    ((size_t *)area)[1] = (size_t)items;
    ((size_t *)area)[2] = n;
    return result_of(status, 4);
}

static void *number_of(fmi3Status status, size_t n) {
    *(uint64_t *)(area + 8) = n;
    return result_of(status, 8);
}

static size_t count_of(const uint32_t *references, size_t n) {
    size_t count = 0;
    for (size_t i = 0; i < n; i++) {
        size_t low = 0, high = N_REFERENCES;
        while (low + 1 < high) {
            const size_t middle = low + (high - low) / 2;
            if (sizes[middle][0] <= references[i]) low = middle;
            else high = middle;
        }
        count += sizes[low][0] == references[i] ? sizes[low][1] : 1;
    }
    return count;
}

/* ---- the C library's way to the outside, which does not exist --------------------------- */

#define HIDDEN __attribute__((visibility("hidden")))
#define WASI(NAME, ...) \
    HIDDEN int32_t __imported_wasi_snapshot_preview1_##NAME(__VA_ARGS__) { return NOT_SUPPORTED; }
enum { NOT_SUPPORTED = 58 };
typedef int32_t i;
HIDDEN _Noreturn void __imported_wasi_snapshot_preview1_proc_exit(i status) {
    (void)status;
    __builtin_trap();
}
WASI(fd_write, i descriptor, i vectors, i count, i done)
WASI(fd_read, i descriptor, i vectors, i count, i done)
WASI(fd_seek, i descriptor, int64_t by, i from, i at)
WASI(fd_close, i descriptor)
WASI(fd_fdstat_get, i descriptor, i place)
WASI(fd_fdstat_set_flags, i descriptor, i flags)
WASI(fd_prestat_get, i descriptor, i place)
WASI(fd_prestat_dir_name, i descriptor, i place, i size)
WASI(path_open, i descriptor, i at, i path, i n, i flags, int64_t own, int64_t heirs, i more, i place)
WASI(clock_time_get, i clock, int64_t precision, i place)
WASI(environ_sizes_get, i count, i size)
WASI(environ_get, i places, i texts)

/* ---- instances -------------------------------------------------------------------------- */

typedef struct {
    fmi3Instance fmu;
    char *name;
} instance;

static void report(void *environment, fmi3Status status, const char *category, const char *text) {
    const char *name = environment ? ((instance *)environment)->name : "";
    log_message(name, strlen(name), status, category, strlen(category), text, strlen(text));
}

/* For a host that calls the functions of FMI in C. */
EXPORTED("uuv_guest_fmi3") void *uuv_guest_fmi3(void) { return (void *)report; }

static char *text_of(const char *text, size_t n) {
    char *made = malloc(n + 1);
    if (!made) __builtin_trap();
    memcpy(made, text, n);
    made[n] = '\0';
    return made;
}

static void destroy(instance *made) {
    if (made->fmu) fmi3FreeInstance(made->fmu);
    free(made->name);
    free(made);
}

EXPORTED("fmi:fmi3/common@3.0.0#get-version") void *get_version(void) {
    const char *text = fmi3GetVersion();
    ((size_t *)area)[0] = (size_t)text;
    ((size_t *)area)[1] = strlen(text);
    return area;
}

#if CO_SIMULATION
#define ID(NAME) co_simulation_##NAME
#define INTERFACE "fmi:fmi3/co-simulation@3.0.0"
#define RESOURCE "co-simulation-instance"
#include "component_methods.h"
#undef ID
#undef INTERFACE
#undef RESOURCE

static fmi3Instance co_simulation(instance *made, const char *token, const char *folder, int visible, int logging,
                                  int events, int early, const uint32_t *required, size_t n) {
    return fmi3InstantiateCoSimulation(made->name, token, folder, visible, logging, events, early, required, n, made,
                                       report, NULL);
}
EXPORTED("fmi:fmi3/co-simulation@3.0.0#[static]co-simulation-instance.instantiate-co-simulation")
void *instantiate_co_simulation(const char *name, size_t n_name, const char *token, size_t n_token, const char *folder,
                                size_t n_folder, int visible, int logging, int events, int early,
                                const uint32_t *required, size_t n) {
    instance *made = malloc(sizeof *made);
    char *own_token = text_of(token, n_token), *own_folder = text_of(folder, n_folder);
    made->name = text_of(name, n_name);
    made->fmu = co_simulation(made, own_token, own_folder, visible, logging, events, early, required, n);
    free(own_token);
    free(own_folder);
    return co_simulation_made(made);
}

EXPORTED("fmi:fmi3/co-simulation@3.0.0#[method]co-simulation-instance.do-step")
void *do_step(instance *c, double t, double h, int never_back) {
    fmi3Boolean event = 0, end = 0, early = 0;
    fmi3Float64 reached = t + h;
    const fmi3Status status = fmi3DoStep(c->fmu, t, h, never_back, &event, &end, &early, &reached);
    memcpy(area + 8, &reached, 8);
    area[16] = event;
    area[17] = end;
    area[18] = early;
    return result_of(status, 8);
}

EXPORTED("fmi:fmi3/co-simulation@3.0.0#[method]co-simulation-instance.set-input-derivatives")
int set_input_derivatives(instance *c, const void *requests, size_t n, const double *values, size_t n_values) {
    (void)c, (void)requests, (void)n, (void)values, (void)n_values;
    return finished(fmi3Error); /* FMI 3.0 has no such function */
}
#endif

#if MODEL_EXCHANGE
#define ID(NAME) model_exchange_##NAME
#define INTERFACE "fmi:fmi3/model-exchange@3.0.0"
#define RESOURCE "model-exchange-instance"
#include "component_methods.h"
#define EXCHANGE(NAME) EXPORTED(INTERFACE "#[method]" RESOURCE "." NAME)

EXPORTED("fmi:fmi3/model-exchange@3.0.0#[static]model-exchange-instance.instantiate-model-exchange")
void *instantiate_model_exchange(const char *name, size_t n_name, const char *token, size_t n_token,
                                 const char *folder, size_t n_folder, int visible, int logging) {
    instance *made = malloc(sizeof *made);
    char *own_token = text_of(token, n_token), *own_folder = text_of(folder, n_folder);
    made->name = text_of(name, n_name);
    made->fmu = fmi3InstantiateModelExchange(made->name, own_token, own_folder, visible, logging, made, report);
    free(own_token);
    free(own_folder);
    return model_exchange_made(made);
}
EXCHANGE("enter-continuous-time-mode") int enter_continuous_time(instance *c) {
    return finished(fmi3EnterContinuousTimeMode(c->fmu));
}
EXCHANGE("set-time") int set_time(instance *c, double t) { return finished(fmi3SetTime(c->fmu, t)); }
EXCHANGE("set-continuous-states") int set_states(instance *c, const double *x, size_t n) {
    return finished(fmi3SetContinuousStates(c->fmu, x, n));
}
static size_t states_of(instance *c) {
    size_t n = 0;
    fmi3GetNumberOfContinuousStates(c->fmu, &n);
    return n;
}
static size_t indicators_of(instance *c) {
    size_t n = 0;
    fmi3GetNumberOfEventIndicators(c->fmu, &n);
    return n;
}
#define VECTOR(NAME, FUNCTION, COUNT)                                              \
    EXCHANGE(NAME) void *exchange_##FUNCTION(instance *c) {                        \
        const size_t n = COUNT(c);                                                 \
        double *x = room(0, n * sizeof *x);                                        \
        return list_of(FUNCTION(c->fmu, x, n), x, n);                              \
    }
VECTOR("get-continuous-state-derivatives", fmi3GetContinuousStateDerivatives, states_of)
VECTOR("get-continuous-states", fmi3GetContinuousStates, states_of)
VECTOR("get-nominals-of-continuous-states", fmi3GetNominalsOfContinuousStates, states_of)
VECTOR("get-event-indicators", fmi3GetEventIndicators, indicators_of)
EXCHANGE("get-number-of-continuous-states") void *number_of_states(instance *c) {
    return number_of(fmi3OK, states_of(c));
}
EXCHANGE("get-number-of-event-indicators") void *number_of_indicators(instance *c) {
    return number_of(fmi3OK, indicators_of(c));
}
EXCHANGE("completed-integrator-step") void *completed_step(instance *c, int never_back) {
    fmi3Boolean event = 0, end = 0;
    const fmi3Status status = fmi3CompletedIntegratorStep(c->fmu, never_back, &event, &end);
    area[1] = event;
    area[2] = end;
    return result_of(status, 1);
}
#endif
