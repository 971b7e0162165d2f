/* An FMU in WebAssembly with the C interface of FMI: its functions are called in a sandbox.
 *
 * Arguments are copied into the memory of the module, and results out of it. The functions of
 * wasmtime come from the caller, so that this library is not linked with it. */
#ifndef UUV_SANDBOX_H
#define UUV_SANDBOX_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define SANDBOX_EXPORT __declspec(dllexport)
#else
#define SANDBOX_EXPORT __attribute__((visibility("default")))
#endif

enum { SANDBOX_WARNING = 1, SANDBOX_ERROR = 3, SANDBOX_FATAL = 4 }; /* FMI's */

/* As wasmtime.h has them: wasmtime_val_raw_t, wasmtime_func_t, wasmtime_memory_t, wasm_byte_vec_t. */
typedef union {
    int32_t i32;
    double f64;
    _Alignas(8) uint8_t bytes[16];
} raw;
typedef struct {
    uint64_t store;
    void *place;
} function;
typedef struct {
    uint64_t parts[3];
} memory;
typedef struct {
    size_t size;
    char *data;
} byte_vector;

typedef struct {
    void *(*call)(void *context, const function *f, raw *arguments, size_t n, void **trap);
    void (*set_deadline)(void *context, uint64_t ticks);
    uint8_t *(*memory_data)(void *context, const memory *m);
    size_t (*memory_size)(void *context, const memory *m);
    void *(*memory_grow)(void *context, const memory *m, uint64_t pages, uint64_t *before);
    void (*error_message)(const void *error, byte_vector *text);
    void (*error_delete)(void *error);
    int (*trap_code)(const void *trap, uint8_t *code);
    void (*trap_message)(const void *trap, byte_vector *text);
    void (*trap_delete)(void *trap);
    void (*bytes_delete)(byte_vector *text);
} wasmtime;

#define SANDBOX_FMI2_TYPES(F) F(Real) F(Integer) F(Boolean) F(String)
#define SANDBOX_FMI3_TYPES(F) \
    F(Float32) F(Float64) F(Int8) F(UInt8) F(Int16) F(UInt16) F(Int32) F(UInt32) F(Int64) F(UInt64) \
    F(Boolean) F(String) F(Binary) F(Clock)
/* Functions whose arguments FMI 2.0 and FMI 3.0 share. */
#define SANDBOX_COMMON(F, V) \
    F(V, ExitInitializationMode) F(V, Terminate) F(V, Reset) F(V, EnterEventMode) \
    F(V, EnterContinuousTimeMode) F(V, GetContinuousStates) F(V, SetContinuousStates) \
    F(V, GetEventIndicators) F(V, GetNominalsOfContinuousStates) F(V, FreeInstance) F(V, SetTime)
#define SANDBOX_FMI2_OTHERS(F, V) \
    F(V, Instantiate) F(V, SetupExperiment) F(V, EnterInitializationMode) F(V, GetFMUstate) \
    F(V, SetFMUstate) F(V, FreeFMUstate) F(V, SerializedFMUstateSize) F(V, SerializeFMUstate) \
    F(V, DeSerializeFMUstate) F(V, GetDirectionalDerivative) F(V, DoStep) F(V, GetBooleanStatus) \
    F(V, GetRealStatus) F(V, GetDerivatives) F(V, NewDiscreteStates) F(V, CompletedIntegratorStep)
#define SANDBOX_FMI3_OTHERS(F, V) \
    F(V, InstantiateCoSimulation) F(V, InstantiateModelExchange) F(V, EnterInitializationMode) \
    F(V, EnterConfigurationMode) F(V, ExitConfigurationMode) F(V, GetFMUState) F(V, SetFMUState) \
    F(V, FreeFMUState) F(V, SerializedFMUStateSize) F(V, SerializeFMUState) \
    F(V, DeserializeFMUState) F(V, GetDirectionalDerivative) F(V, DoStep) \
    F(V, GetNumberOfContinuousStates) F(V, GetNumberOfEventIndicators) \
    F(V, GetContinuousStateDerivatives) F(V, UpdateDiscreteStates) F(V, CompletedIntegratorStep)

#define SANDBOX_ID(V, NAME) F_##V##NAME,
#define SANDBOX_ID2(T) F_fmi2Get##T, F_fmi2Set##T,
#define SANDBOX_ID3(T) F_fmi3Get##T, F_fmi3Set##T,
enum {
    SANDBOX_COMMON(SANDBOX_ID, fmi2) SANDBOX_FMI2_OTHERS(SANDBOX_ID, fmi2)
    SANDBOX_COMMON(SANDBOX_ID, fmi3) SANDBOX_FMI3_OTHERS(SANDBOX_ID, fmi3)
    SANDBOX_FMI2_TYPES(SANDBOX_ID2) SANDBOX_FMI3_TYPES(SANDBOX_ID3)
    N_FUNCTIONS
};

typedef struct uuv_sandbox {
    wasmtime api;
    void *context;
    memory memory;
    uint64_t ticks; /* of the engine's epoch that a call may take */
    function functions[N_FUNCTIONS]; /* `store` is 0: the module does not export it */
    uint32_t instance;               /* of the FMU, in the module */
    uint32_t scratch, scratch_size;  /* pages of the module's memory that only this side uses */
    int ended;                       /* by a trap: nothing may be called any more */
    void (*report)(void *environment, int status, const char *category, const char *text);
    void *environment;
    char reason[512]; /* why it ended */
} uuv_sandbox;

/* Gives `size` bytes that only this side uses, and their place in the module; NULL: it has ended. */
uint8_t *sandbox_room(uuv_sandbox *s, size_t size, uint32_t *place);
/* Calls a function of the module; its first result is in a[0]. 0: it has ended. */
int sandbox_call(uuv_sandbox *s, int f, raw *a, size_t n);
int sandbox_end(uuv_sandbox *s, const char *reason);

/* Calls a function of the instance and gives its status. The letters of `form` name the arguments:
 * i int32, d double, p a pointer of the module, s text. With a pointer and a number of elements:
 * R references, D doubles and x bytes that go in, V doubles and X bytes that come out; n is the
 * number of the last of these. A pointer to a result: b bool, I int32, Z size_t, O double; P a pointer
 * of the module that comes out, Q one that goes in and comes out. */
int sandbox_invoke(uuv_sandbox *s, int f, const char *form, ...);

/* Getters and setters; `counts` says whether the number of values follows them. */
int sandbox_get(uuv_sandbox *s, int f, const uint32_t *references, size_t n, void *values, size_t count,
                size_t width, int counts);
int sandbox_set(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const void *values, size_t count,
                size_t width, int counts);
int sandbox_get_texts(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const char **values,
                      size_t count, int counts);
int sandbox_set_texts(uuv_sandbox *s, int f, const uint32_t *references, size_t n, const char *const *values,
                      size_t count, int counts);

#endif
