/* Checked access to the variables of an instance by value reference. */
#ifndef SHELL_VARIABLES_H
#define SHELL_VARIABLES_H

#include "shell_common.h"

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
        if (uuv_failure(s->block)) {
            refuse(s, "%s: %s", function, uuv_failure(s->block));
            return NULL;
        }
        if (v->kind == UUV_LOCAL) uuv_refresh(s->block);
        if (v->kind == UUV_DERIVATIVE) uuv_update_derivatives(s->block);
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
    case UUV_TUNABLE:
        if (s->mode != CONTINUOUS_TIME_MODE || (v->kind == UUV_INPUT && v->type == UUV_FLOAT64))
            return s->block->b + vr;
        refuse(s, "%s: \"%s\" cannot be set in state %s; expected it to be set in Event Mode",
               function, v->name, mode_name(s->mode));
        return NULL;
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

/* Reports the first value below a soft minimum with which the component computes: until the end of
 * initialization, importers may set values that they replace. */
static int below_minimum(shell *s, const uuv_variable *v, uint32_t element) {
    const double value = uuv_lane(s->block->b[v->offset + element], 0);
    char name[96], text[512];
    if (!v->soft_min || !(value < v->min) || s->warned) return DONE;
    if (s->mode & (INSTANTIATED | INITIALIZATION_MODE)) return DONE;
    s->warned = 1;
    snprintf(text, sizeof text, "\"%s\" = %.9g at t = %.9g s; expected a value in [%.9g, %.9g]. "
             "The component goes on as at %.9g, and does not report this again",
             element_name(name, v, element), value, s->time, v->min, v->max, v->min);
    shell_log(s, DONE_WITH_WARNING, text);
    return DONE_WITH_WARNING;
}

/* Checks a value against its variable's bounds. */
static int acceptable(shell *s, const char *function, uint32_t offset, double value) {
    uint32_t element;
    char name[96];
    const uuv_variable *v = owner(s->block->component, offset, &element);
    if (!__builtin_isfinite(value))
        return refuse(s, "%s: \"%s\" = %g; expected a finite number", function,
                      element_name(name, v, element), value);
    if ((value < v->min && !v->soft_min) || value > v->max)
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

#ifdef UUV_WHOLE

static int get_texts(shell *s, const char *function, const uint32_t *vr, size_t n,
                     const char *values[]) {
    if (!in_mode(s, function, ANY_MODE)) return 0;
    for (size_t i = 0; i < n; i++)
        if (!(values[i] = uuv_text(s->block, vr[i])))
            return refuse(s, "%s: value reference %u is unknown", function, (unsigned)vr[i]);
    return 1;
}

static int set_texts(shell *s, const char *function, const uint32_t *vr, size_t n,
                     const char *const values[]) {
    if (!in_mode(s, function, INSTANTIATED | INITIALIZATION_MODE)) return 0;
    for (size_t i = 0; i < n; i++) {
        if (!values[i]) return refuse(s, "%s: a text is NULL", function);
        if (!uuv_set_text(s->block, vr[i], values[i]))
            return refuse(s, "%s: value reference %u is unknown, or its text too long", function,
                          (unsigned)vr[i]);
    }
    return 1;
}

#endif

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
    if (!in_mode(s, function, ANY_MODE & ~(TERMINATED | FAILED))) return 0;
    int result = DONE;
    for (int storing = 0; storing < 2; storing++) {
        size_t used = 0;
        for (size_t i = 0; i < n_vr; i++) {
            uint32_t size;
            V *place = settable(s, function, vr[i], type, whole, &size);
            if (!place) return 0;
            if (used + size > n) return counts_match(s, function, used + size, n);
            for (uint32_t j = 0; j < size; j++) {
                const double value = at(values, used + j);
                if (storing) {
                    uint32_t element;
                    store(s, place + j, value);
                    const uuv_variable *v = owner(s->block->component, vr[i] + j, &element);
                    if (below_minimum(s, v, element) == DONE_WITH_WARNING)
                        result = DONE_WITH_WARNING;
                } else if (!acceptable(s, function, vr[i] + j, value))
                    return 0;
            }
            used += size;
        }
        if (!counts_match(s, function, used, n)) return 0;
    }
    return result;
}

static double read_double(const void *values, size_t i) { return ((const double *)values)[i]; }
static void write_double(void *values, size_t i, double value) { ((double *)values)[i] = value; }
static double read_int32(const void *values, size_t i) { return ((const int32_t *)values)[i]; }
static void write_int32(void *values, size_t i, double value) {
    ((int32_t *)values)[i] = (int32_t)value;
}

#endif
