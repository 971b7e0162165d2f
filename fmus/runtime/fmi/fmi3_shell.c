/* FMI 3.0 for Co-Simulation and Model Exchange over an instance of a component. Value references name variables. */
#include <stdbool.h>
#include <stdint.h>

#include "fmi3Functions.h"
#include "shell_exchange.h"
#include "shell_states.h"

static fmi3Status status_of(int result) {
    return result == DONE ? fmi3OK : result == REFUSED ? fmi3Error : fmi3Warning;
}

static const char *category_of(int result) {
    return result == REFUSED ? "logStatusError" : "logStatusWarning";
}

static void shell_log(shell *s, int result, const char *message) {
    if (s->log)
        ((fmi3LogMessageCallback)s->log)(s->environment, status_of(result), category_of(result),
                                         message);
}

/* ---- life ------------------------------------------------------------------------------ */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean loggingOn, size_t nCategories,
                               const fmi3String categories[]) {
    (void)loggingOn; /* errors and warnings are always reported, and there is nothing else to report */
    if (!in_mode(instance, "fmi3SetDebugLogging", ANY_MODE)) return fmi3Error;
    for (size_t i = 0; i < nCategories; i++)
        if (strcmp(categories[i], category_of(REFUSED)) != 0 &&
            strcmp(categories[i], category_of(DONE_WITH_WARNING)) != 0)
            return status_of(refuse(instance, "fmi3SetDebugLogging: category \"%s\" is unknown; "
                                              "expected \"logStatusError\" or "
                                              "\"logStatusWarning\"", categories[i]));
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3Boolean eventModeUsed,
    fmi3Boolean earlyReturnAllowed, const fmi3ValueReference requiredIntermediateVariables[],
    size_t nRequiredIntermediateVariables, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3IntermediateUpdateCallback intermediateUpdate) {
    (void)resourcePath, (void)visible, (void)loggingOn, (void)earlyReturnAllowed;
    (void)requiredIntermediateVariables, (void)intermediateUpdate;
    shell *s = shell_instantiate(instanceName, instantiationToken, instanceEnvironment,
                                 (void (*)(void))logMessage);
    if (!s) return NULL;
    int ok = 1;
    if (eventModeUsed)
        ok = refuse(s, "fmi3InstantiateCoSimulation: Event Mode is not supported; expected "
                       "eventModeUsed = false");
    if (nRequiredIntermediateVariables)
        ok = refuse(s, "fmi3InstantiateCoSimulation: intermediate update is not supported; "
                       "expected nRequiredIntermediateVariables = 0");
    if (ok) return s;
    shell_free(s);
    return NULL;
}

static fmi3Instance refused_instance(fmi3InstanceEnvironment environment,
                                     fmi3LogMessageCallback logMessage) {
    if (logMessage)
        logMessage(environment, fmi3Error, "logStatusError",
                   UUV_EXCHANGES ? "Scheduled Execution is not supported; expected "
                                   "fmi3InstantiateCoSimulation or fmi3InstantiateModelExchange"
                                 : "only Co-Simulation is supported; expected "
                                   "fmi3InstantiateCoSimulation");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String instanceName, fmi3String instantiationToken,
                                          fmi3String resourcePath, fmi3Boolean visible,
                                          fmi3Boolean loggingOn,
                                          fmi3InstanceEnvironment instanceEnvironment,
                                          fmi3LogMessageCallback logMessage) {
    (void)resourcePath, (void)visible, (void)loggingOn;
    if (!UUV_EXCHANGES) return refused_instance(instanceEnvironment, logMessage);
    shell *s = shell_instantiate(instanceName, instantiationToken, instanceEnvironment,
                                 (void (*)(void))logMessage);
    if (s) s->exchange = 1;
    return s;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String instanceName, fmi3String instantiationToken, fmi3String resourcePath,
    fmi3Boolean visible, fmi3Boolean loggingOn, fmi3InstanceEnvironment instanceEnvironment,
    fmi3LogMessageCallback logMessage, fmi3ClockUpdateCallback clockUpdate,
    fmi3LockPreemptionCallback lockPreemption, fmi3UnlockPreemptionCallback unlockPreemption) {
    (void)instanceName, (void)instantiationToken, (void)resourcePath, (void)visible;
    (void)loggingOn, (void)clockUpdate, (void)lockPreemption, (void)unlockPreemption;
    return refused_instance(instanceEnvironment, logMessage);
}

void fmi3FreeInstance(fmi3Instance instance) { shell_free(instance); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean toleranceDefined,
                                       fmi3Float64 tolerance, fmi3Float64 startTime,
                                       fmi3Boolean stopTimeDefined, fmi3Float64 stopTime) {
    static const char name[] = "fmi3EnterInitializationMode";
    (void)toleranceDefined, (void)tolerance;
    if (!in_mode(instance, name, INSTANTIATED)) return fmi3Error;
    if (!shell_setup(instance, name, startTime, stopTimeDefined, stopTime)) return fmi3Error;
    shell_enter_initialization(instance);
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance) {
    if (!in_mode(instance, "fmi3ExitInitializationMode", INITIALIZATION_MODE)) return fmi3Error;
    return status_of(shell_exit_initialization(instance, "fmi3ExitInitializationMode"));
}

fmi3Status fmi3Terminate(fmi3Instance instance) {
    if (!in_mode(instance, "fmi3Terminate", STEP_MODE | EXCHANGE_MODE)) return fmi3Error;
    ((shell *)instance)->mode = TERMINATED;
    uuv_terminate(((shell *)instance)->block);
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance) {
    if (!in_mode(instance, "fmi3Reset", ANY_MODE)) return fmi3Error;
    shell_reset(instance);
    return fmi3OK;
}

#ifndef UUV_WHOLE

/* For the stepping loop of this package, with an instance of either shell; everybody else calls FMI's
 * functions. */
UUV_EXPORT void uuv_values_1(const void *component, uuv_values *values) {
    uuv_instance *s = ((const shell *)component)->block;
    *values = (uuv_values){(double *)s->b, &s->dirty, &s->outputs_stale};
}

#endif

/* ---- variables ------------------------------------------------------------------------- */

static void write_bool(void *values, size_t i, double value) {
    ((fmi3Boolean *)values)[i] = value != 0.0;
}

static double read_bool(const void *values, size_t i) {
    return ((const fmi3Boolean *)values)[i] ? 1.0 : 0.0;
}

#define ACCESS(Type, type, write, read)                                                        \
    fmi3Status fmi3Get##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr, \
                             fmi3##Type values[], size_t nValues) {                            \
        return status_of(get_values(instance, "fmi3Get" #Type, vr, nvr, type, 1, values,       \
                                    nValues, write));                                          \
    }                                                                                          \
    fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr, \
                             const fmi3##Type values[], size_t nValues) {                      \
        return status_of(set_values(instance, "fmi3Set" #Type, vr, nvr, type, 1, values,       \
                                    nValues, read));                                           \
    }

ACCESS(Float64, UUV_FLOAT64, write_double, read_double)
ACCESS(Int32, UUV_INT32, write_int32, read_int32)
ACCESS(Boolean, UUV_BOOLEAN, write_bool, read_bool)

#ifdef UUV_WHOLE

fmi3Status fmi3GetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr,
                         fmi3String values[], size_t nValues) {
    if (!in_mode(instance, "fmi3GetString", ANY_MODE)) return fmi3Error;
    return status_of(counts_match(instance, "fmi3GetString", nvr, nValues) &&
                     get_texts(instance, "fmi3GetString", vr, nvr, values));
}

fmi3Status fmi3SetString(fmi3Instance instance, const fmi3ValueReference vr[], size_t nvr,
                         const fmi3String values[], size_t nValues) {
    if (!in_mode(instance, "fmi3SetString", ANY_MODE)) return fmi3Error;
    return status_of(counts_match(instance, "fmi3SetString", nvr, nValues) &&
                     set_texts(instance, "fmi3SetString", vr, nvr, values));
}

#endif

/* ---- steps and derivatives ------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 currentCommunicationPoint,
                      fmi3Float64 communicationStepSize,
                      fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation,
                      fmi3Boolean *earlyReturn, fmi3Float64 *lastSuccessfulTime) {
    shell *s = instance;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!in_mode(s, "fmi3DoStep", STEP_MODE)) return fmi3Error;
    const double before = s->time;
    const int ok =
        shell_do_step(s, "fmi3DoStep", currentCommunicationPoint, communicationStepSize);
    if (eventHandlingNeeded) *eventHandlingNeeded = false;
    if (terminateSimulation) *terminateSimulation = false;
    if (earlyReturn) *earlyReturn = false;
    if (lastSuccessfulTime) *lastSuccessfulTime = ok ? s->time : before;
    return status_of(ok);
}

#ifndef UUV_WHOLE

UUV_EXPORT uint32_t uuv_fmi3_steps_1(void *const *components, uint32_t n, double t, double h,
                                    int32_t *status) {
    *status = fmi3Error;
    return shell_do_steps(components, "fmi3DoStep", n, t, h);
}

#endif

/* Directional: sensitivity of unknowns = J · seed of knowns. Adjoint: of knowns = Jᵀ · seed of
 * unknowns, by one forward pass for each element of the knowns. */
static int derivative(shell *s, const char *name, int adjoint, const fmi3ValueReference *unknowns,
                      size_t nUnknowns, const fmi3ValueReference *knowns, size_t nKnowns,
                      const double *seed, size_t nSeed, double *sensitivity,
                      size_t nSensitivity) {
    if (!in_mode(s, name, ANY_MODE & ~(INSTANTIATED | FAILED))) return 0;
    size_t n_known = 0, n_unknown = 0;
    uint32_t size;
    for (size_t i = 0; i < nKnowns; i++, n_known += size)
        if (differentiable(s, name, knowns[i], 1, 1, &size) < 0) return 0;
    for (size_t i = 0; i < nUnknowns; i++, n_unknown += size)
        if (differentiable(s, name, unknowns[i], 0, 1, &size) < 0) return 0;
    const size_t n_seed = adjoint ? n_unknown : n_known, n_out = adjoint ? n_known : n_unknown;
    if (nSeed != n_seed || nSensitivity != n_out)
        return refuse(s, "%s: nSeed is %llu and nSensitivity %llu; expected %llu and %llu", name,
                      (unsigned long long)nSeed, (unsigned long long)nSensitivity,
                      (unsigned long long)n_seed, (unsigned long long)n_out);
    V *dy;
    V *du = derivative_space(s, &dy);
    if (!du) return 0;
    size_t at = 0;
    for (size_t i = 0; i < nKnowns; i++) {
        const int64_t place = differentiable(s, name, knowns[i], 1, 1, &size);
        for (uint32_t j = 0; j < size; j++, at++) {
            du[place + j] = uuv_const(adjoint ? 1.0 : seed[at]);
            if (!adjoint) continue;
            s->block->component->forward(s->block->b, du, dy);
            du[place + j] = uuv_const(0.0);
            size_t from = 0;
            double sum = 0.0;
            for (size_t k = 0; k < nUnknowns; k++) {
                uint32_t rows;
                const int64_t row = differentiable(s, name, unknowns[k], 0, 1, &rows);
                for (uint32_t r = 0; r < rows; r++)
                    sum += uuv_lane(dy[row + r], 0) * seed[from++];
            }
            sensitivity[at] = sum;
        }
    }
    if (!adjoint) {
        s->block->component->forward(s->block->b, du, dy);
        at = 0;
        for (size_t i = 0; i < nUnknowns; i++) {
            const int64_t row = differentiable(s, name, unknowns[i], 0, 1, &size);
            for (uint32_t r = 0; r < size; r++) sensitivity[at++] = uuv_lane(dy[row + r], 0);
        }
    }
    free(du);
    return 1;
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance,
                                        const fmi3ValueReference unknowns[], size_t nUnknowns,
                                        const fmi3ValueReference knowns[], size_t nKnowns,
                                        const fmi3Float64 seed[], size_t nSeed,
                                        fmi3Float64 sensitivity[], size_t nSensitivity) {
    return status_of(derivative(instance, "fmi3GetDirectionalDerivative", 0, unknowns, nUnknowns,
                                knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity));
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t nUnknowns, const fmi3ValueReference knowns[],
                                    size_t nKnowns, const fmi3Float64 seed[], size_t nSeed,
                                    fmi3Float64 sensitivity[], size_t nSensitivity) {
    return status_of(derivative(instance, "fmi3GetAdjointDerivative", 1, unknowns, nUnknowns,
                                knowns, nKnowns, seed, nSeed, sensitivity, nSensitivity));
}

/* ---- Model Exchange ---------------------------------------------------------------------- */

fmi3Status fmi3EnterEventMode(fmi3Instance instance) {
    static const char name[] = "fmi3EnterEventMode";
    return status_of(shell_enter_mode(instance, name, CONTINUOUS_TIME_MODE, EVENT_MODE));
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance) {
    static const char name[] = "fmi3EnterContinuousTimeMode";
    return status_of(shell_enter_mode(instance, name, EVENT_MODE, CONTINUOUS_TIME_MODE));
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *discreteStatesNeedUpdate,
                                    fmi3Boolean *terminateSimulation,
                                    fmi3Boolean *nominalsOfContinuousStatesChanged,
                                    fmi3Boolean *valuesOfContinuousStatesChanged,
                                    fmi3Boolean *nextEventTimeDefined,
                                    fmi3Float64 *nextEventTime) {
    double next;
    if (!shell_new_discrete_states(instance, "fmi3UpdateDiscreteStates", &next)) return fmi3Error;
    *discreteStatesNeedUpdate = *terminateSimulation = false;
    *nominalsOfContinuousStatesChanged = *valuesOfContinuousStatesChanged = false;
    *nextEventTimeDefined = __builtin_isfinite(next);
    *nextEventTime = __builtin_isfinite(next) ? next : 0.0;
    return fmi3OK;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                       fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode,
                                       fmi3Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!in_mode(instance, "fmi3CompletedIntegratorStep", CONTINUOUS_TIME_MODE)) return fmi3Error;
    *enterEventMode = *terminateSimulation = false;
    return fmi3OK;
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time) {
    return status_of(shell_set_time(instance, "fmi3SetTime", time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[], size_t n) {
    return status_of(shell_set_states(instance, "fmi3SetContinuousStates", states, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 states[], size_t n) {
    return status_of(shell_get_states(instance, "fmi3GetContinuousStates", states, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 derivatives[],
                                             size_t n) {
    static const char name[] = "fmi3GetContinuousStateDerivatives";
    const int got = shell_get_derivatives(instance, name, derivatives, n);
    return got < 0 ? fmi3Discard : status_of(got);
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t n) {
    return status_of(
        shell_get_nominals(instance, "fmi3GetNominalsOfContinuousStates", nominals, n));
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n) {
    if (!in_mode(instance, "fmi3GetNumberOfContinuousStates", ANY_MODE)) return fmi3Error;
    *n = ((shell *)instance)->block->component->n_x;
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n) {
    if (!in_mode(instance, "fmi3GetNumberOfEventIndicators", ANY_MODE)) return fmi3Error;
    *n = 0;
    return fmi3OK;
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n) {
    (void)indicators;
    if (!in_mode(instance, "fmi3GetEventIndicators", ANY_MODE)) return fmi3Error;
    return n ? status_of(refuse(instance, "fmi3GetEventIndicators: there are none")) : fmi3OK;
}

/* ---- states ---------------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    if (!in_mode(instance, "fmi3GetFMUState", ANY_MODE)) return fmi3Error;
    void *state = save_state(instance, *FMUState);
    if (!state) return fmi3Error;
    *FMUState = state;
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState FMUState) {
    if (!in_mode(instance, "fmi3SetFMUState", ANY_MODE)) return fmi3Error;
    return status_of(restore_state(instance, "fmi3SetFMUState", FMUState));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *FMUState) {
    if (!in_mode(instance, "fmi3FreeFMUState", ANY_MODE)) return fmi3Error;
    if (FMUState) {
        free(*FMUState);
        *FMUState = NULL;
    }
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState FMUState,
                                      size_t *size) {
    if (!in_mode(instance, "fmi3SerializedFMUStateSize", ANY_MODE)) return fmi3Error;
    if (!is_state(instance, "fmi3SerializedFMUStateSize", FMUState)) return fmi3Error;
    *size = state_bytes(instance);
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState FMUState,
                                 fmi3Byte serializedState[], size_t size) {
    if (!in_mode(instance, "fmi3SerializeFMUState", ANY_MODE)) return fmi3Error;
    return status_of(
        serialize_state(instance, "fmi3SerializeFMUState", FMUState, serializedState, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte serializedState[],
                                   size_t size, fmi3FMUState *FMUState) {
    if (!in_mode(instance, "fmi3DeserializeFMUState", ANY_MODE)) return fmi3Error;
    void *state = deserialize_state(instance, "fmi3DeserializeFMUState", serializedState, size,
                                    *FMUState);
    if (!state) return fmi3Error;
    *FMUState = state;
    return fmi3OK;
}

/* ---- not supported --------------------------------------------------------------------- */

#define NOT_SUPPORTED(function, ...)                                                          \
    fmi3Status function(fmi3Instance instance, ##__VA_ARGS__) {                               \
        return instance ? status_of(refuse(instance, #function " is not supported"))          \
                        : fmi3Error;                                                          \
    }

#define VRS const fmi3ValueReference vr[], size_t nvr
#define NO_VARIABLES(Type)                                                                     \
    NOT_SUPPORTED(fmi3Get##Type, VRS, fmi3##Type values[], size_t nValues)                     \
    NOT_SUPPORTED(fmi3Set##Type, VRS, const fmi3##Type values[], size_t nValues)

NO_VARIABLES(Float32)
NO_VARIABLES(Int8)
NO_VARIABLES(UInt8)
NO_VARIABLES(Int16)
NO_VARIABLES(UInt16)
NO_VARIABLES(UInt32)
NO_VARIABLES(Int64)
NO_VARIABLES(UInt64)
#ifndef UUV_WHOLE
NO_VARIABLES(String)
#endif
NOT_SUPPORTED(fmi3GetBinary, VRS, size_t sizes[], fmi3Binary values[], size_t nValues)
NOT_SUPPORTED(fmi3SetBinary, VRS, const size_t sizes[], const fmi3Binary values[], size_t nValues)
NOT_SUPPORTED(fmi3GetClock, VRS, fmi3Clock values[])
NOT_SUPPORTED(fmi3SetClock, VRS, const fmi3Clock values[])
NOT_SUPPORTED(fmi3GetNumberOfVariableDependencies, fmi3ValueReference vr, size_t *n)
NOT_SUPPORTED(fmi3GetVariableDependencies, fmi3ValueReference dependent, size_t elements[],
              fmi3ValueReference independents[], size_t elementsOfIndependents[],
              fmi3DependencyKind kinds[], size_t n)
NOT_SUPPORTED(fmi3EnterStepMode)
NOT_SUPPORTED(fmi3EnterConfigurationMode)
NOT_SUPPORTED(fmi3ExitConfigurationMode)
NOT_SUPPORTED(fmi3GetIntervalDecimal, VRS, fmi3Float64 intervals[],
              fmi3IntervalQualifier qualifiers[])
NOT_SUPPORTED(fmi3GetIntervalFraction, VRS, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
              fmi3IntervalQualifier qualifiers[])
NOT_SUPPORTED(fmi3GetShiftDecimal, VRS, fmi3Float64 shifts[])
NOT_SUPPORTED(fmi3GetShiftFraction, VRS, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
NOT_SUPPORTED(fmi3SetIntervalDecimal, VRS, const fmi3Float64 intervals[])
NOT_SUPPORTED(fmi3SetIntervalFraction, VRS, const fmi3UInt64 counters[],
              const fmi3UInt64 resolutions[])
NOT_SUPPORTED(fmi3SetShiftDecimal, VRS, const fmi3Float64 shifts[])
NOT_SUPPORTED(fmi3SetShiftFraction, VRS, const fmi3UInt64 counters[],
              const fmi3UInt64 resolutions[])
NOT_SUPPORTED(fmi3EvaluateDiscreteStates)
NOT_SUPPORTED(fmi3GetOutputDerivatives, VRS, const fmi3Int32 orders[], fmi3Float64 values[],
              size_t nValues)
NOT_SUPPORTED(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 activationTime)
