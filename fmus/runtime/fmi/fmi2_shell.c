/* FMI 2.0 for Co-Simulation and Model Exchange over an instance of a component. Value references name elements. */
#include "fmi2Functions.h"
#include "shell_exchange.h"
#include "shell_states.h"

static fmi2Status status_of(int result) {
    return result == DONE ? fmi2OK : result == REFUSED ? fmi2Error : fmi2Warning;
}

static const char *category_of(int result) {
    return result == REFUSED ? "logStatusError" : "logStatusWarning";
}

static void shell_log(shell *s, int result, const char *message) {
    char format[1024];
    size_t n = 0;
    if (!s->log) return;
    for (const char *p = message; *p && n < sizeof format - 2; p++) {
        if (*p == '%') format[n++] = '%'; /* the callback formats as printf does */
        format[n++] = *p;
    }
    format[n] = '\0';
    ((fmi2CallbackLogger)s->log)(s->environment, s->name ? s->name : "",
                                 status_of(result), category_of(result), format);
}

/* ---- life ------------------------------------------------------------------------------ */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean loggingOn, size_t nCategories,
                               const fmi2String categories[]) {
    shell *s = c;
    (void)loggingOn; /* errors and warnings are always reported, and there is nothing else to report */
    if (!in_mode(s, "fmi2SetDebugLogging", ANY_MODE)) return fmi2Error;
    for (size_t i = 0; i < nCategories; i++)
        if (strcmp(categories[i], category_of(REFUSED)) != 0 &&
            strcmp(categories[i], category_of(DONE_WITH_WARNING)) != 0)
            return status_of(refuse(s, "fmi2SetDebugLogging: category \"%s\" is unknown; expected "
                                       "\"logStatusError\" or \"logStatusWarning\"",
                                    categories[i]));
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String instanceName, fmi2Type fmuType, fmi2String fmuGUID,
                              fmi2String fmuResourceLocation,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean loggingOn) {
    void *environment = functions ? functions->componentEnvironment : NULL;
    void (*log)(void) = functions ? (void (*)(void))functions->logger : NULL;
    (void)fmuResourceLocation, (void)visible, (void)loggingOn;
    shell *s = shell_instantiate(instanceName, fmuGUID, environment, log);
    if (s) s->exchange = fmuType == fmi2ModelExchange;
    if (s && s->exchange && !UUV_EXCHANGES) {
        refuse(s, "fmi2Instantiate: Model Exchange is not supported; expected Co-Simulation");
        shell_free(s);
        return NULL;
    }
    return s;
}

void fmi2FreeInstance(fmi2Component c) { shell_free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined, fmi2Real tolerance,
                               fmi2Real startTime, fmi2Boolean stopTimeDefined,
                               fmi2Real stopTime) {
    (void)toleranceDefined, (void)tolerance;
    if (!in_mode(c, "fmi2SetupExperiment", INSTANTIATED)) return fmi2Error;
    return status_of(
        shell_setup(c, "fmi2SetupExperiment", startTime, stopTimeDefined, stopTime));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    if (!in_mode(c, "fmi2EnterInitializationMode", INSTANTIATED)) return fmi2Error;
    shell_enter_initialization(c);
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    if (!in_mode(c, "fmi2ExitInitializationMode", INITIALIZATION_MODE)) return fmi2Error;
    return status_of(shell_exit_initialization(c, "fmi2ExitInitializationMode"));
}

fmi2Status fmi2Terminate(fmi2Component c) {
    if (!in_mode(c, "fmi2Terminate", STEP_MODE | EXCHANGE_MODE)) return fmi2Error;
    ((shell *)c)->mode = TERMINATED;
    uuv_terminate(((shell *)c)->block);
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    if (!in_mode(c, "fmi2Reset", ANY_MODE)) return fmi2Error;
    shell_reset(c);
    return fmi2OK;
}

/* ---- variables ------------------------------------------------------------------------- */

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       fmi2Real value[]) {
    return status_of(
        get_values(c, "fmi2GetReal", vr, nvr, UUV_FLOAT64, 0, value, nvr, write_double));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Integer value[]) {
    return status_of(
        get_values(c, "fmi2GetInteger", vr, nvr, UUV_INT32, 0, value, nvr, write_int32));
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          fmi2Boolean value[]) {
    return status_of(
        get_values(c, "fmi2GetBoolean", vr, nvr, UUV_BOOLEAN, 0, value, nvr, write_int32));
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                       const fmi2Real value[]) {
    return status_of(
        set_values(c, "fmi2SetReal", vr, nvr, UUV_FLOAT64, 0, value, nvr, read_double));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Integer value[]) {
    return status_of(
        set_values(c, "fmi2SetInteger", vr, nvr, UUV_INT32, 0, value, nvr, read_int32));
}

static double read_truth(const void *values, size_t i) {
    return ((const fmi2Boolean *)values)[i] ? 1.0 : 0.0;
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                          const fmi2Boolean value[]) {
    return status_of(
        set_values(c, "fmi2SetBoolean", vr, nvr, UUV_BOOLEAN, 0, value, nvr, read_truth));
}

#ifdef UUV_WHOLE

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         fmi2String value[]) {
    return status_of(get_texts(c, "fmi2GetString", vr, nvr, value));
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t nvr,
                         const fmi2String value[]) {
    return status_of(set_texts(c, "fmi2SetString", vr, nvr, value));
}

#endif

/* ---- steps and derivatives ------------------------------------------------------------- */

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real currentCommunicationPoint,
                      fmi2Real communicationStepSize,
                      fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!in_mode(c, "fmi2DoStep", STEP_MODE)) return fmi2Error;
    return status_of(
        shell_do_step(c, "fmi2DoStep", currentCommunicationPoint, communicationStepSize));
}

#ifndef UUV_WHOLE

UUV_EXPORT uint32_t uuv_fmi2_steps_1(void *const *components, uint32_t n, double t, double h,
                                    int32_t *status) {
    *status = fmi2Error;
    return shell_do_steps(components, "fmi2DoStep", n, t, h);
}

#endif

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference vUnknown_ref[],
                                        size_t nUnknown, const fmi2ValueReference vKnown_ref[],
                                        size_t nKnown, const fmi2Real dvKnown[],
                                        fmi2Real dvUnknown[]) {
    static const char name[] = "fmi2GetDirectionalDerivative";
    shell *s = c;
    uint32_t size;
    V *sensitivity;
    int ok = 1;
    if (!in_mode(s, name, ANY_MODE & ~(INSTANTIATED | FAILED))) return fmi2Error;
    V *seed = derivative_space(s, &sensitivity);
    if (!seed) return fmi2Error;
    for (size_t i = 0; ok && i < nKnown; i++) {
        const int64_t at = differentiable(s, name, vKnown_ref[i], 1, 0, &size);
        if ((ok = at >= 0)) seed[at] = uuv_const(dvKnown[i]);
    }
    if (ok) s->block->component->forward(s->block->b, seed, sensitivity);
    for (size_t i = 0; ok && i < nUnknown; i++) {
        const int64_t at = differentiable(s, name, vUnknown_ref[i], 0, 0, &size);
        if ((ok = at >= 0)) dvUnknown[i] = uuv_lane(sensitivity[at], 0);
    }
    free(seed);
    return status_of(ok);
}

/* ---- Model Exchange ---------------------------------------------------------------------- */

fmi2Status fmi2EnterEventMode(fmi2Component c) {
    return status_of(shell_enter_mode(c, "fmi2EnterEventMode", CONTINUOUS_TIME_MODE, EVENT_MODE));
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    static const char name[] = "fmi2EnterContinuousTimeMode";
    return status_of(shell_enter_mode(c, name, EVENT_MODE, CONTINUOUS_TIME_MODE));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    double next;
    if (!shell_new_discrete_states(c, "fmi2NewDiscreteStates", &next)) return fmi2Error;
    *info = (fmi2EventInfo){.nextEventTimeDefined = __builtin_isfinite(next) != 0,
                            .nextEventTime = __builtin_isfinite(next) ? next : 0.0};
    return fmi2OK;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c,
                                       fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode,
                                       fmi2Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!in_mode(c, "fmi2CompletedIntegratorStep", CONTINUOUS_TIME_MODE)) return fmi2Error;
    *enterEventMode = *terminateSimulation = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    return status_of(shell_set_time(c, "fmi2SetTime", time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t nx) {
    return status_of(shell_set_states(c, "fmi2SetContinuousStates", x, nx));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t nx) {
    return status_of(shell_get_states(c, "fmi2GetContinuousStates", x, nx));
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t nx) {
    const int got = shell_get_derivatives(c, "fmi2GetDerivatives", derivatives, nx);
    return got < 0 ? fmi2Discard : status_of(got);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t nx) {
    return status_of(shell_get_nominals(c, "fmi2GetNominalsOfContinuousStates", nominals, nx));
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t ni) {
    (void)indicators;
    if (!in_mode(c, "fmi2GetEventIndicators", ANY_MODE)) return fmi2Error;
    return ni ? status_of(refuse(c, "fmi2GetEventIndicators: there are none")) : fmi2OK;
}

/* ---- states ---------------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    if (!in_mode(c, "fmi2GetFMUstate", ANY_MODE)) return fmi2Error;
    void *state = save_state(c, *FMUstate);
    if (!state) return fmi2Error;
    *FMUstate = state;
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate FMUstate) {
    if (!in_mode(c, "fmi2SetFMUstate", ANY_MODE)) return fmi2Error;
    return status_of(restore_state(c, "fmi2SetFMUstate", FMUstate));
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *FMUstate) {
    if (!in_mode(c, "fmi2FreeFMUstate", ANY_MODE)) return fmi2Error;
    if (FMUstate) {
        free(*FMUstate);
        *FMUstate = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate FMUstate, size_t *size) {
    if (!in_mode(c, "fmi2SerializedFMUstateSize", ANY_MODE)) return fmi2Error;
    if (!is_state(c, "fmi2SerializedFMUstateSize", FMUstate)) return fmi2Error;
    *size = state_bytes(c);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate FMUstate,
                                 fmi2Byte serializedState[], size_t size) {
    if (!in_mode(c, "fmi2SerializeFMUstate", ANY_MODE)) return fmi2Error;
    return status_of(serialize_state(c, "fmi2SerializeFMUstate", FMUstate,
                                     (unsigned char *)serializedState, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte serializedState[], size_t size,
                                   fmi2FMUstate *FMUstate) {
    if (!in_mode(c, "fmi2DeSerializeFMUstate", ANY_MODE)) return fmi2Error;
    void *state = deserialize_state(c, "fmi2DeSerializeFMUstate",
                                    (const unsigned char *)serializedState, size, *FMUstate);
    if (!state) return fmi2Error;
    *FMUstate = state;
    return fmi2OK;
}

/* ---- not supported --------------------------------------------------------------------- */

#define NOT_SUPPORTED(function, ...)                                                          \
    fmi2Status function(fmi2Component c, ##__VA_ARGS__) {                                     \
        return c ? status_of(refuse(c, #function " is not supported")) : fmi2Error;           \
    }

#define VRS const fmi2ValueReference vr[], size_t nvr

#ifndef UUV_WHOLE
NOT_SUPPORTED(fmi2GetString, VRS, fmi2String value[])
NOT_SUPPORTED(fmi2SetString, VRS, const fmi2String value[])
#endif
NOT_SUPPORTED(fmi2SetRealInputDerivatives, VRS, const fmi2Integer order[], const fmi2Real value[])
NOT_SUPPORTED(fmi2GetRealOutputDerivatives, VRS, const fmi2Integer order[], fmi2Real value[])
NOT_SUPPORTED(fmi2CancelStep)
NOT_SUPPORTED(fmi2GetStatus, const fmi2StatusKind kind, fmi2Status *value)
NOT_SUPPORTED(fmi2GetIntegerStatus, const fmi2StatusKind kind, fmi2Integer *value)
NOT_SUPPORTED(fmi2GetStringStatus, const fmi2StatusKind kind, fmi2String *value)

/* Steps are never pending or discarded; importers ask for these two nevertheless. */
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!in_mode(c, "fmi2GetRealStatus", ANY_MODE)) return fmi2Error;
    if (kind != fmi2LastSuccessfulTime)
        return status_of(refuse(c, "fmi2GetRealStatus: expected fmi2LastSuccessfulTime"));
    *value = ((shell *)c)->time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (!in_mode(c, "fmi2GetBooleanStatus", ANY_MODE)) return fmi2Error;
    if (kind != fmi2Terminated)
        return status_of(refuse(c, "fmi2GetBooleanStatus: expected fmi2Terminated"));
    *value = fmi2False;
    return fmi2OK;
}
