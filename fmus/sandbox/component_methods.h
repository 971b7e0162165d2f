/* The methods that instances for Co-Simulation and Model Exchange share. Included once for each, with
 * ID, INTERFACE and RESOURCE. */
#define METHOD(NAME) EXPORTED(INTERFACE "#[method]" RESOURCE "." NAME)
#define REFERENCES const uint32_t *r, size_t n

IMPORTED("[export]" INTERFACE, "[resource-new]" RESOURCE) int ID(resource)(instance *made);
EXPORTED(INTERFACE "#[dtor]" RESOURCE) void ID(drop)(instance *c) { destroy(c); }

/* An instance, or nothing if the FMU gave none. */
static void *ID(made)(instance *made) {
    release();
    area[0] = made->fmu != NULL;
    if (made->fmu) ((int *)area)[1] = ID(resource)(made);
    else destroy(made);
    return area;
}

METHOD("set-debug-logging") int ID(debug)(instance *c, int on, const size_t *texts, size_t n) {
    const char **categories = malloc((n + 1) * sizeof *categories);
    for (size_t i = 0; i < n; i++) categories[i] = text_of((const char *)texts[2 * i], texts[2 * i + 1]);
    const fmi3Status status = fmi3SetDebugLogging(c->fmu, on, n, categories);
    for (size_t i = 0; i < n; i++) free((char *)categories[i]);
    free(categories);
    return finished(status);
}
METHOD("enter-initialization-mode")
int ID(enter_initialization)(instance *c, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    return finished(fmi3EnterInitializationMode(c->fmu, has_tolerance, tolerance, start, has_stop, stop));
}

#define PLAIN(NAME, FUNCTION) \
    METHOD(NAME) int ID(FUNCTION)(instance *c) { return finished(FUNCTION(c->fmu)); }
PLAIN("exit-initialization-mode", fmi3ExitInitializationMode)
PLAIN("enter-event-mode", fmi3EnterEventMode)
PLAIN("terminate", fmi3Terminate)
PLAIN("reset", fmi3Reset)
PLAIN("enter-configuration-mode", fmi3EnterConfigurationMode)
PLAIN("exit-configuration-mode", fmi3ExitConfigurationMode)
PLAIN("evaluate-discrete-states", fmi3EvaluateDiscreteStates)
PLAIN("enter-step-mode", fmi3EnterStepMode)

METHOD("update-discrete-states") void *ID(update)(instance *c) {
    fmi3Boolean b[5] = {0};
    fmi3Float64 next = 0;
    const fmi3Status status = fmi3UpdateDiscreteStates(c->fmu, &b[0], &b[1], &b[2], &b[3], &b[4], &next);
    for (int i = 0; i < 5; i++) area[8 + i] = b[i];
    memcpy(area + 16, &next, 8);
    return result_of(status, 8);
}

#define NUMBERS(NAME, TYPE)                                                                       \
    METHOD("get-" NAME) void *ID(get_##TYPE)(instance *c, REFERENCES) {                           \
        const size_t count = count_of(r, n);                                                      \
        fmi3##TYPE *x = room(0, count * sizeof *x);                                               \
        return list_of(fmi3Get##TYPE(c->fmu, r, n, x, count), x, count);                          \
    }                                                                                             \
    METHOD("set-" NAME) int ID(set_##TYPE)(instance *c, REFERENCES, const fmi3##TYPE *x, size_t count) { \
        return finished(fmi3Set##TYPE(c->fmu, r, n, x, count));                                   \
    }
NUMBERS("float32", Float32)
NUMBERS("float64", Float64)
NUMBERS("int8", Int8)
NUMBERS("int16", Int16)
NUMBERS("int32", Int32)
NUMBERS("int64", Int64)
NUMBERS("uint8", UInt8)
NUMBERS("uint16", UInt16)
NUMBERS("uint32", UInt32)
NUMBERS("uint64", UInt64)
NUMBERS("boolean", Boolean)

METHOD("get-clock") void *ID(get_clock)(instance *c, REFERENCES) {
    fmi3Clock *x = room(0, n * sizeof *x);
    return list_of(fmi3GetClock(c->fmu, r, n, x), x, n);
}
METHOD("set-clock") int ID(set_clock)(instance *c, REFERENCES, const fmi3Clock *x, size_t count) {
    return finished(count == n ? fmi3SetClock(c->fmu, r, n, x) : fmi3Error);
}
METHOD("get-string") void *ID(get_string)(instance *c, REFERENCES) {
    const size_t count = count_of(r, n);
    fmi3String *x = room(0, count * sizeof *x);
    size_t *texts = room(1, 2 * count * sizeof *texts);
    const fmi3Status status = fmi3GetString(c->fmu, r, n, x, count);
    for (size_t i = 0; status <= fmi3Warning && i < count; i++) {
        texts[2 * i] = (size_t)x[i];
        texts[2 * i + 1] = strlen(x[i]);
    }
    return list_of(status, texts, count);
}
METHOD("set-string") int ID(set_string)(instance *c, REFERENCES, const size_t *texts, size_t count) {
    char **x = malloc((count + 1) * sizeof *x);
    for (size_t i = 0; i < count; i++) x[i] = text_of((const char *)texts[2 * i], texts[2 * i + 1]);
    const fmi3Status status = fmi3SetString(c->fmu, r, n, (const char *const *)x, count);
    for (size_t i = 0; i < count; i++) free(x[i]);
    free(x);
    return finished(status);
}
METHOD("get-binary") void *ID(get_binary)(instance *c, REFERENCES) {
    const size_t count = count_of(r, n);
    fmi3Binary *x = room(0, count * (sizeof *x + sizeof(size_t)));
    size_t *lengths = (size_t *)(x + count), *lists = room(1, 2 * count * sizeof *lists);
    const fmi3Status status = fmi3GetBinary(c->fmu, r, n, lengths, x, count);
    for (size_t i = 0; status <= fmi3Warning && i < count; i++) {
        lists[2 * i] = (size_t)x[i];
        lists[2 * i + 1] = lengths[i];
    }
    return list_of(status, lists, count);
}
METHOD("set-binary") int ID(set_binary)(instance *c, REFERENCES, const size_t *lists, size_t count) {
    fmi3Binary *x = room(0, count * (sizeof *x + sizeof(size_t)));
    size_t *lengths = (size_t *)(x + count);
    for (size_t i = 0; i < count; i++) {
        x[i] = (fmi3Binary)lists[2 * i];
        lengths[i] = lists[2 * i + 1];
    }
    return finished(fmi3SetBinary(c->fmu, r, n, lengths, x, count));
}

METHOD("get-fmu-state") void *ID(get_state)(instance *c) {
    fmi3FMUState state = NULL;
    size_t size = 0;
    uint8_t *bytes = NULL;
    fmi3Status status = fmi3GetFMUState(c->fmu, &state);
    if (status <= fmi3Warning) status = fmi3SerializedFMUStateSize(c->fmu, state, &size);
    if (status <= fmi3Warning) status = fmi3SerializeFMUState(c->fmu, state, bytes = room(0, size), size);
    if (state) fmi3FreeFMUState(c->fmu, &state);
    return list_of(status, bytes, size);
}
METHOD("set-fmu-state") int ID(set_state)(instance *c, const uint8_t *bytes, size_t size) {
    fmi3FMUState state = NULL;
    fmi3Status status = fmi3DeserializeFMUState(c->fmu, bytes, size, &state);
    if (status <= fmi3Warning) status = fmi3SetFMUState(c->fmu, state);
    if (state) fmi3FreeFMUState(c->fmu, &state);
    return finished(status);
}

#define DERIVATIVE(NAME, FUNCTION, OF)                                                                      \
    METHOD(NAME) void *ID(FUNCTION)(instance *c, const uint32_t *u, size_t nu, const uint32_t *k, size_t nk, \
                                    const double *seed, size_t n_seed) {                                    \
        const size_t count = count_of(OF, n##OF);                                                           \
        double *x = room(0, count * sizeof *x);                                                             \
        return list_of(FUNCTION(c->fmu, u, nu, k, nk, seed, n_seed, x, count), x, count);                   \
    }
DERIVATIVE("get-directional-derivative", fmi3GetDirectionalDerivative, u)
DERIVATIVE("get-adjoint-derivative", fmi3GetAdjointDerivative, k)

/* Dependencies, clocks and derivatives of outputs: no FMU of this package offers them. */
#define REFUSED_LIST(NAME, WHAT) \
    METHOD(NAME) void *ID(WHAT)(instance *c, REFERENCES) { return (void)c, (void)r, (void)n, list_of(fmi3Error, NULL, 0); }
#define REFUSED_SET(NAME, WHAT) \
    METHOD(NAME) int ID(WHAT)(instance *c, REFERENCES, const void *x, size_t count) { \
        return (void)c, (void)r, (void)n, (void)x, (void)count, finished(fmi3Error);  \
    }
REFUSED_LIST("get-interval-decimal", interval_decimal)
REFUSED_LIST("get-interval-fraction", interval_fraction)
REFUSED_LIST("get-shift-decimal", shift_decimal)
REFUSED_LIST("get-shift-fraction", shift_fraction)
REFUSED_LIST("get-output-derivatives", output_derivatives)
REFUSED_SET("set-interval-decimal", set_interval_decimal)
REFUSED_SET("set-interval-fraction", set_interval_fraction)
REFUSED_SET("set-shift-decimal", set_shift_decimal)
REFUSED_SET("set-shift-fraction", set_shift_fraction)
METHOD("get-number-of-variable-dependencies") void *ID(n_dependencies)(instance *c, uint32_t r) {
    return (void)c, (void)r, result_of(fmi3Error, 8);
}
METHOD("get-variable-dependencies") void *ID(dependencies)(instance *c, uint32_t r) {
    return (void)c, (void)r, list_of(fmi3Error, NULL, 0);
}

#undef METHOD
#undef REFERENCES
#undef PLAIN
#undef NUMBERS
#undef DERIVATIVE
#undef REFUSED_LIST
#undef REFUSED_SET
