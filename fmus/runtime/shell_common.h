/* What the FMI 2 and the FMI 3 shell share: modes, messages, checked access, states.
 *
 * A call that is refused changes nothing: it gives a message and an error status. Only a step
 * that produced a value that is not finite makes the instance FAILED; from there it can be
 * read, reset, freed, or put back into a saved state. There is no static data that changes.
 */
#ifndef SHELL_COMMON_H
#define SHELL_COMMON_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "uuv_component.h"

enum shell_mode {
    INSTANTIATED = 1,
    INITIALIZATION_MODE = 2,
    STEP_MODE = 4,
    TERMINATED = 8,
    FAILED = 16,
    ANY_MODE = 31
};

typedef struct {
    uuv_instance *block;
    char *name;
    uint64_t mode;
    double time, start_time, stop_time; /* stop_time: inf where there is none */
    void *environment;
    void (*log)(void); /* the importer's callback, cast by the shell */
} shell;

/* Hands a finished message to the importer; each shell has its own. */
static void shell_log(shell *s, const char *message);

static const char *mode_name(uint64_t mode) {
    switch (mode) {
    case INSTANTIATED: return "Instantiated";
    case INITIALIZATION_MODE: return "Initialization Mode";
    case STEP_MODE: return "Step Mode";
    case TERMINATED: return "Terminated";
    default: return "Failed";
    }
}

/* Logs a message and gives 0, so that `return refuse(…)` reads well. */
static int refuse(shell *s, const char *format, ...) {
    char text[512];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    shell_log(s, text);
    return 0;
}

static int in_mode(shell *s, const char *function, unsigned allowed) {
    if (!s) return 0;
    if (s->mode & allowed) return 1;
    char expected[128] = "";
    size_t used = 0;
    for (unsigned m = INSTANTIATED; m <= FAILED; m <<= 1)
        if (allowed & m)
            used += (size_t)snprintf(expected + used, sizeof expected - used, "%s%s",
                                     used ? " or " : "", mode_name(m));
    return refuse(s, "%s is not allowed in state %s; expected %s", function, mode_name(s->mode),
                  expected);
}

/* ---- life ------------------------------------------------------------------------------ */

static void shell_free(shell *s) {
    if (!s) return;
    uuv_free(s->block);
    free(s->name);
    free(s);
}

static shell *shell_instantiate(const char *name, const char *token, void *environment,
                                void (*log)(void)) {
    const uuv_component *c = uuv_get_component();
    const char *given = name && *name ? name : c->name;
    shell *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->environment = environment;
    s->log = log;
    s->mode = INSTANTIATED;
    s->stop_time = __builtin_inf();
    s->name = malloc(strlen(given) + 1);
    if (s->name) strcpy(s->name, given);
    if (!token || strcmp(token, c->token) != 0) {
        refuse(s, "token \"%s\" is not that of this binary; expected \"%s\"", token ? token : "",
               c->token);
        shell_free(s);
        return NULL;
    }
    s->block = uuv_instantiate(c);
    if (!s->block || !s->name) {
        refuse(s, "out of memory");
        shell_free(s);
        return NULL;
    }
    return s;
}

static void shell_reset(shell *s) {
    uuv_reset(s->block);
    s->mode = INSTANTIATED;
    s->time = s->start_time = 0.0;
    s->stop_time = __builtin_inf();
}

static int shell_setup(shell *s, const char *function, double start, int stop_defined,
                       double stop) {
    if (!__builtin_isfinite(start))
        return refuse(s, "%s: startTime is %g; expected a finite number", function, start);
    if (stop_defined && !(stop >= start))
        return refuse(s, "%s: stopTime is %g; expected at least startTime %g", function, stop,
                      start);
    s->start_time = start;
    s->stop_time = stop_defined ? stop : __builtin_inf();
    return 1;
}

/* Sets the time, and each clock to its first sample that is not before the start. */
static void shell_enter_initialization(shell *s) {
    const uuv_component *c = s->block->component;
    s->time = s->start_time;
    s->block->b[0] = uuv_const(s->start_time);
    for (uint32_t i = 0; i < c->n_clocks; i++) {
        const double period = (double)c->clocks[i].period_num / (double)c->clocks[i].period_den;
        const double k = s->start_time / period;
        uint64_t first = k > 0.0 ? (uint64_t)k : 0;
        if (k > 0.0 && k - (double)first > 1e-6) first++;
        s->block->k[i] = first;
    }
    s->block->outputs_stale = 1;
    s->mode = INITIALIZATION_MODE;
}

/* ---- variables ------------------------------------------------------------------------- */

/* The variable that holds a place of the block, and which element of it; NULL if none does. */
static const uuv_variable *owner(const uuv_component *c, uint32_t offset, uint32_t *element) {
    uint32_t low = 0, high = c->n_variables;
    while (low + 1 < high) {
        const uint32_t middle = low + (high - low) / 2;
        if (c->variables[middle].offset <= offset)
            low = middle;
        else
            high = middle;
    }
    const uuv_variable *v = &c->variables[low];
    if (c->n_variables == 0 || offset < v->offset || offset - v->offset >= v->size) return NULL;
    *element = offset - v->offset;
    return v;
}

/* Writes "tau[3]" or "mass"; elements count from 1. */
static const char *element_name(char text[96], const uuv_variable *v, uint32_t element) {
    if (v->array)
        snprintf(text, 96, "%s[%u]", v->name, (unsigned)element + 1);
    else
        snprintf(text, 96, "%s", v->name);
    return text;
}

static const char *type_name(unsigned type) {
    return type == UUV_FLOAT64 ? "Float64" : type == UUV_INT32 ? "Int32" : "Boolean";
}

/* Finds the variable that a value reference names. With `whole`, references name variables,
 * and `*size` is their number of elements; without, they name elements. */
static const uuv_variable *reference(shell *s, const char *function, uint32_t vr, unsigned type,
                                     int whole, uint32_t *element, uint32_t *size) {
    const uuv_variable *v = owner(s->block->component, vr, element);
    if (!v || (whole && *element != 0)) {
        refuse(s, "%s: value reference %u is unknown", function, (unsigned)vr);
        return NULL;
    }
    if (v->type != type) {
        refuse(s, "%s: value reference %u is the %s variable \"%s\"; expected a %s variable",
               function, (unsigned)vr, type_name(v->type), v->name, type_name(type));
        return NULL;
    }
    *size = whole ? v->size : 1;
    return v;
}

/* Makes what lies at the reference up to date, and gives where it lies; NULL if refused. */
static V *readable(shell *s, const char *function, uint32_t vr, unsigned type, int whole,
                   uint32_t *size) {
    uint32_t element;
    const uuv_variable *v = reference(s, function, vr, type, whole, &element, size);
    if (!v) return NULL;
    if (s->mode != FAILED) {
        if (v->kind == UUV_OUTPUT) uuv_update_outputs(s->block);
        if (v->kind == UUV_LOCAL) uuv_refresh(s->block);
    }
    return s->block->b + vr;
}

/* Checks that the variable may be set now; gives where it lies, NULL if refused. */
static V *settable(shell *s, const char *function, uint32_t vr, unsigned type, int whole,
                   uint32_t *size) {
    uint32_t element;
    const uuv_variable *v = reference(s, function, vr, type, whole, &element, size);
    if (!v) return NULL;
    switch (v->kind) {
    case UUV_INPUT:
    case UUV_TUNABLE: return s->block->b + vr;
    case UUV_FIXED:
        if (s->mode == INSTANTIATED || s->mode == INITIALIZATION_MODE) return s->block->b + vr;
        refuse(s, "%s: fixed parameter \"%s\" cannot be set in state %s; expected it to be set "
                  "before initialization ends", function, v->name, mode_name(s->mode));
        return NULL;
    default:
        refuse(s, "%s: \"%s\" is %s and cannot be set; expected an input or a parameter",
               function, v->name,
               v->kind == UUV_TIME ? "time" : v->kind == UUV_OUTPUT ? "an output" : "a local");
        return NULL;
    }
}

/* Checks a value against its variable's bounds. */
static int acceptable(shell *s, const char *function, uint32_t offset, double value) {
    uint32_t element;
    char name[96];
    const uuv_variable *v = owner(s->block->component, offset, &element);
    if (!__builtin_isfinite(value))
        return refuse(s, "%s: \"%s\" = %g; expected a finite number", function,
                      element_name(name, v, element), value);
    if (value < v->min || value > v->max)
        return refuse(s, "%s: \"%s\" = %.17g; expected a value in [%.17g, %.17g]", function,
                      element_name(name, v, element), value, v->min, v->max);
    return 1;
}

static void store(shell *s, V *place, double value) {
    const uuv_component *c = s->block->component;
    const size_t offset = (size_t)(place - s->block->b);
    *place = uuv_const(value);
    if (offset < c->off_u || offset >= (size_t)c->off_u + c->n_u) s->block->dirty = 1;
    s->block->outputs_stale = 1;
}

typedef double (*value_reader)(const void *values, size_t i);
typedef void (*value_writer)(void *values, size_t i, double value);

static int counts_match(shell *s, const char *function, size_t used, size_t n) {
    if (used == n) return 1;
    return refuse(s, "%s: nValues is %llu; expected %llu", function, (unsigned long long)n,
                  (unsigned long long)used);
}

/* Reads variables (`whole`) or elements of them into n values. */
static int get_values(shell *s, const char *function, const uint32_t *vr, size_t n_vr,
                      unsigned type, int whole, void *values, size_t n, value_writer put) {
    size_t used = 0;
    if (!in_mode(s, function, ANY_MODE)) return 0;
    for (size_t i = 0; i < n_vr; i++) {
        uint32_t size;
        const V *place = readable(s, function, vr[i], type, whole, &size);
        if (!place) return 0;
        if (used + size > n) return counts_match(s, function, used + size, n);
        for (uint32_t j = 0; j < size; j++) put(values, used + j, uuv_lane(place[j], 0));
        used += size;
    }
    return counts_match(s, function, used, n);
}

/* Sets variables (`whole`) or elements of them; all or, if one is refused, none. */
static int set_values(shell *s, const char *function, const uint32_t *vr, size_t n_vr,
                      unsigned type, int whole, const void *values, size_t n, value_reader at) {
    if (!in_mode(s, function, INSTANTIATED | INITIALIZATION_MODE | STEP_MODE)) return 0;
    for (int storing = 0; storing < 2; storing++) {
        size_t used = 0;
        for (size_t i = 0; i < n_vr; i++) {
            uint32_t size;
            V *place = settable(s, function, vr[i], type, whole, &size);
            if (!place) return 0;
            if (used + size > n) return counts_match(s, function, used + size, n);
            for (uint32_t j = 0; j < size; j++) {
                const double value = at(values, used + j);
                if (storing)
                    store(s, place + j, value);
                else if (!acceptable(s, function, vr[i] + j, value))
                    return 0;
            }
            used += size;
        }
        if (!counts_match(s, function, used, n)) return 0;
    }
    return 1;
}

static double read_double(const void *values, size_t i) { return ((const double *)values)[i]; }
static void write_double(void *values, size_t i, double value) { ((double *)values)[i] = value; }
static double read_int32(const void *values, size_t i) { return ((const int32_t *)values)[i]; }
static void write_int32(void *values, size_t i, double value) {
    ((int32_t *)values)[i] = (int32_t)value;
}

/* Gives 1, or refuses and names the first output or state that is not finite. */
static int all_finite(shell *s, const char *function, double time, int32_t bad) {
    const uuv_component *c = s->block->component;
    for (uint32_t i = c->off_x; i < c->n_block && !bad; i++)
        if (!uuv_all_finite(s->block->b[i])) bad = (int32_t)(1 + i);
    if (!bad) return 1;
    uint32_t element;
    char name[96];
    const uint32_t at = (uint32_t)(bad - 1);
    const uuv_variable *v = owner(c, at, &element);
    return refuse(s, "%s: \"%s\" became %g at t = %.9g s", function,
                  v ? element_name(name, v, element) : "an internal value",
                  uuv_lane(s->block->b[at], 0), time);
}

static int shell_exit_initialization(shell *s, const char *function) {
    uuv_exit_initialization(s->block);
    uuv_update_outputs(s->block);
    if (!all_finite(s, function, s->time, 0)) {
        s->mode = FAILED;
        return 0;
    }
    s->mode = STEP_MODE;
    return 1;
}

static int shell_do_step(shell *s, const char *function, double t, double h) {
    if (!__builtin_isfinite(t))
        return refuse(s, "%s: currentCommunicationPoint is %g; expected a finite number",
                      function, t);
    if (!__builtin_isfinite(h) || h < 0.0)
        return refuse(s, "%s: communicationStepSize is %g; expected a finite number, at least 0",
                      function, h);
    /* Masters that accumulate time may be off by a few units in the last place. */
    const double slack = 1e-6 * h + 1e-9 * (__builtin_fabs(t) + 1.0);
    if (__builtin_fabs(t - s->time) > slack)
        return refuse(s, "%s: currentCommunicationPoint is %.17g; expected %.17g, where the "
                         "last step ended", function, t, s->time);
    if (t + h > s->stop_time + slack)
        return refuse(s, "%s: the step ends at %.17g; expected not after stopTime %.17g",
                      function, t + h, s->stop_time);
    const int32_t bad = uuv_do_step(s->block, t, h);
    s->time = t + h;
    if (bad) {
        s->mode = FAILED;
        return all_finite(s, function, s->time, bad);
    }
    return 1;
}

/* ---- derivatives ----------------------------------------------------------------------- */

/* Place of an input or output in [u] or [y]; -1 if the reference is refused. */
static int64_t differentiable(shell *s, const char *function, uint32_t vr, int known, int whole,
                              uint32_t *size) {
    const uuv_component *c = s->block->component;
    uint32_t element;
    const uuv_variable *v = reference(s, function, vr, UUV_FLOAT64, whole, &element, size);
    if (!v) return -1;
    if (v->kind != (known ? UUV_INPUT : UUV_OUTPUT)) {
        refuse(s, "%s: \"%s\" is not %s", function, v->name,
               known ? "a known; expected an input" : "an unknown; expected an output");
        return -1;
    }
    return (int64_t)vr - (known ? c->off_u : c->off_y);
}

/* Work space [seed of u and x | sensitivity of y and dx], zeroed; NULL if there is no memory. */
static V *derivative_space(shell *s, V **sensitivity) {
    const uuv_component *c = s->block->component;
    const size_t n = (size_t)c->n_u + c->n_x, m = (size_t)c->n_y + c->n_x;
    V *seed = calloc(n + m + 1, sizeof(V));
    if (!seed) {
        refuse(s, "out of memory");
        return NULL;
    }
    *sensitivity = seed + n;
    uuv_update_outputs(s->block);
    return seed;
}

/* ---- states ---------------------------------------------------------------------------- */

typedef struct {
    char magic[8];
    uint64_t token, size, checksum, mode;
    double time, start_time, stop_time;
} state_header;

static const char STATE_MAGIC[8] = {'U', 'U', 'V', 'S', 'T', 'A', 'T', '1'};

static const uint64_t HASH_START = 14695981039346656037u;

/* FNV-1a, continued from h. */
static uint64_t hash_bytes(uint64_t h, const void *data, size_t n) {
    const unsigned char *p = data;
    for (size_t i = 0; i < n; i++) h = (h ^ p[i]) * 1099511628211u;
    return h;
}

static uint64_t token_hash(const shell *s) {
    const char *token = s->block->component->token;
    return hash_bytes(HASH_START, token, strlen(token));
}

static size_t state_bytes(const shell *s) { return sizeof(state_header) + uuv_state_size(s->block); }

/* Copies the state into memory that is allocated unless `old` is given. */
static void *save_state(shell *s, void *old) {
    state_header *state = old ? old : malloc(state_bytes(s));
    if (!state) {
        refuse(s, "out of memory");
        return NULL;
    }
    memcpy(state->magic, STATE_MAGIC, sizeof STATE_MAGIC);
    state->token = token_hash(s);
    state->size = state_bytes(s);
    state->checksum = 0;
    state->mode = s->mode;
    state->time = s->time;
    state->start_time = s->start_time;
    state->stop_time = s->stop_time;
    uuv_get_state(s->block, state + 1);
    return state;
}

static int is_state(shell *s, const char *function, const state_header *state) {
    if (!state) return refuse(s, "%s: the state is NULL", function);
    if (memcmp(state->magic, STATE_MAGIC, sizeof STATE_MAGIC) != 0)
        return refuse(s, "%s: this is not a state of such a component", function);
    if (state->token != token_hash(s) || state->size != state_bytes(s))
        return refuse(s, "%s: the state is one of another component, or of another version of it",
                      function);
    return 1;
}

static int restore_state(shell *s, const char *function, const state_header *state) {
    if (!is_state(s, function, state)) return 0;
    uuv_set_state(s->block, state + 1);
    s->mode = state->mode;
    s->time = state->time;
    s->start_time = state->start_time;
    s->stop_time = state->stop_time;
    return 1;
}

static int serialize_state(shell *s, const char *function, const state_header *state,
                           unsigned char *bytes, size_t size) {
    if (!is_state(s, function, state)) return 0;
    if (size != state->size)
        return refuse(s, "%s: room for %llu bytes; expected %llu", function,
                      (unsigned long long)size, (unsigned long long)state->size);
    state_header header = *state;
    header.checksum = 0;
    memcpy(bytes, &header, sizeof header);
    memcpy(bytes + sizeof header, state + 1, size - sizeof header);
    header.checksum = hash_bytes(HASH_START, bytes, size);
    memcpy(bytes, &header, sizeof header);
    return 1;
}

/* Reads a state into memory that is allocated unless `old` is given; NULL if refused. */
static void *deserialize_state(shell *s, const char *function, const unsigned char *bytes,
                               size_t size, void *old) {
    state_header header;
    if (size != state_bytes(s) || !bytes) {
        refuse(s, "%s: %llu bytes; expected %llu", function, (unsigned long long)size,
               (unsigned long long)state_bytes(s));
        return NULL;
    }
    memcpy(&header, bytes, sizeof header);
    if (!is_state(s, function, &header)) return NULL;
    const uint64_t checksum = header.checksum;
    header.checksum = 0;
    const uint64_t head = hash_bytes(HASH_START, &header, sizeof header);
    const uint64_t found = hash_bytes(head, bytes + sizeof header, size - sizeof header);
    const int one_mode = header.mode && (header.mode & (header.mode - 1)) == 0;
    if (found != checksum || !one_mode || header.mode > FAILED) {
        refuse(s, "%s: the serialized state is damaged: its checksum does not fit", function);
        return NULL;
    }
    state_header *state = old ? old : malloc(size);
    if (!state) {
        refuse(s, "out of memory");
        return NULL;
    }
    memcpy(state, bytes, size);
    state->checksum = 0;
    return state;
}

#endif
