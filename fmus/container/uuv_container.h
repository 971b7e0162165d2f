/* SPDX-License-Identifier: Apache-2.0 */
/* A system of FMUs as one component: it loads the FMUs from its resources, and the stepping loop of
 * orchestrator/core steps them, as in the master.
 *
 * Included at the end of a generated file that has the tables: `boxes` (the FMUs), `starts` (their
 * start values), `build` (the calls that make the loop's tables), `order` (of Initialization Mode),
 * and the places of inputs, parameters and outputs in the block.
 */
#ifndef UUV_CONTAINER_H
#define UUV_CONTAINER_H

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"
#include "uuv_whole_steps.h"

enum { LONGEST_PATH = 4096, LONGEST_WORDS = 480 };

/* One FMU: its library and instance, and its last message. */
typedef struct {
    void *library, *instance;
    int32_t kept;
    char words[LONGEST_WORDS], place[LONGEST_PATH]; /* resources, as its FMI version names them */
    fmi2CallbackFunctions callbacks;
} inner;

struct container {
    uuv_instance head; /* what the shells know */
    inner *inside;
    uuv_core *core;
    double *applied; /* parameters as they were set last */
    double start_time;
    int64_t made; /* communication steps since the start */
    int initializing, failed;
    char failure[2 * LONGEST_WORDS], refused[256];
};

/* Keeps the first reason; gives 0. */
static int fail(container *x, const char *format, ...) {
    va_list arguments;
    if (x->failed) return 0;
    x->failed = 1;
    va_start(arguments, format);
    vsnprintf(x->failure, sizeof x->failure, format, arguments);
    va_end(arguments);
    return 0;
}

/* ---- the FMUs ---------------------------------------------------------------------------- */

static void heard_fmi2(fmi2ComponentEnvironment inside, fmi2String name, fmi2Status status,
                       fmi2String category, fmi2String format, ...) {
    inner *in = inside;
    va_list arguments;
    (void)name, (void)category;
    if (!in || status == fmi2OK || !format) return;
    va_start(arguments, format);
    vsnprintf(in->words, sizeof in->words, format, arguments);
    va_end(arguments);
}

static void heard_fmi3(fmi3InstanceEnvironment inside, fmi3Status status, fmi3String category,
                       fmi3String message) {
    inner *in = inside;
    (void)category;
    if (in && status != fmi3OK && message) snprintf(in->words, sizeof in->words, "%s", message);
}

/* The folder of the resources, from where this library was loaded: binaries/PLATFORM/NAME. */
static int own_resources(char *folder, size_t size) {
    Dl_info info;
    char real[LONGEST_PATH];
    if (!dladdr((const void *)own_resources, &info) || !realpath(info.dli_fname, real)) return 0;
    for (int i = 0; i < 3; i++) {
        char *slash = strrchr(real, '/');
        if (!slash) return 0;
        *slash = '\0';
    }
    return snprintf(folder, size, "%s/resources", real) < (int)size;
}

/* A function of an FMU; in compiled sources of FMI 2.0, the model's name precedes it. */
static void *function(const inner *in, const box *b, const char *name) {
    char full[256];
    void *found = dlsym(in->library, name);
    if (found) return found;
    snprintf(full, sizeof full, "%s_%s", b->identifier, name);
    return dlsym(in->library, full);
}

/* As a URI of FMI 2.0: with % before the bytes that a URI does not have. */
static int as_uri(const char *path, char *uri, size_t size) {
    size_t n = (size_t)snprintf(uri, size, "file://");
    for (; *path && n + 4 < size; path++) {
        const int plain = (*path >= 'a' && *path <= 'z') || (*path >= 'A' && *path <= 'Z') ||
                          (*path >= '0' && *path <= '9') || strchr("/-_.~", *path) != NULL;
        n += (size_t)snprintf(uri + n, size - n, plain ? "%c" : "%%%02X", (unsigned char)*path);
    }
    return !*path;
}

static int load(container *x, uint32_t i, const char *resources) {
    const box *b = boxes + i;
    inner *in = x->inside + i;
    char path[LONGEST_PATH];
    if (snprintf(path, sizeof path, "%s/%s/%s", resources, b->folder, b->library) >= (int)sizeof path)
        return fail(x, "%s: its path is too long", b->name);
    in->library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!in->library) return fail(x, "%s: its library cannot be loaded: %s", b->name, dlerror());
    if (snprintf(path, sizeof path, "%s/%s/resources", resources, b->folder) >= (int)sizeof path)
        return fail(x, "%s: its path is too long", b->name);
    void *make = function(in, b, b->fmi == 2 ? "fmi2Instantiate" : "fmi3InstantiateCoSimulation");
    if (!make) return fail(x, "%s: its library has no function to instantiate it", b->name);
    if (b->fmi == 2) {
        const fmi2CallbackFunctions callbacks = {heard_fmi2, calloc, free, NULL, in};
        memcpy(&in->callbacks, &callbacks, sizeof callbacks);
        if (!as_uri(path, in->place, sizeof in->place)) return fail(x, "%s: its path is too long", b->name);
        in->instance = ((fmi2InstantiateTYPE *)make)(b->name, fmi2CoSimulation, b->token, in->place,
                                                     &in->callbacks, fmi2False, fmi2True);
    } else {
        snprintf(in->place, sizeof in->place, "%s/", path);
        in->instance = ((fmi3InstantiateCoSimulationTYPE *)make)(
            b->name, b->token, b->has_resources ? in->place : NULL, fmi3False, fmi3True, fmi3False,
            fmi3False, NULL, 0, in, heard_fmi3, NULL);
    }
    return in->instance || fail(x, "%s could not be instantiated: %s", b->name, in->words);
}

static int good(container *x, uint32_t i, int status, const char *what) {
    if (status == 0 || status == 1) return 1;
    return fail(x, "%s: %s returned status %d: %s", boxes[i].name, what, status, x->inside[i].words);
}

/* Calls a function of one argument. */
static int call(container *x, uint32_t i, const char *what) {
    char name[64];
    snprintf(name, sizeof name, "fmi%d%s", boxes[i].fmi, what);
    void *f = function(x->inside + i, boxes + i, name);
    if (!f) return fail(x, "%s: its library has no function %s", boxes[i].name, name);
    return good(x, i, ((fmi2TerminateTYPE *)f)(x->inside[i].instance), name);
}

/* Sets n values of one type, in that type's own representation. */
static int set_values(container *x, uint32_t i, const char *type, const uint32_t *references,
                      size_t n_references, const void *values, size_t n) {
    char name[64];
    snprintf(name, sizeof name, "fmi%dSet%s", boxes[i].fmi, type);
    void *f = function(x->inside + i, boxes + i, name);
    if (!f) return fail(x, "%s: its library has no function %s", boxes[i].name, name);
    void *own = x->inside[i].instance;
    const int status = boxes[i].fmi == 2
                           ? (int)((fmi2SetRealTYPE *)f)(own, references, n_references, values)
                           : (int)((fmi3SetFloat64TYPE *)f)(own, references, n_references, values, n);
    return good(x, i, status, name);
}

/* Start values of the plan and seeds, in their order. */
static int set_starts(container *x, uint32_t i) {
    for (const start_value *s = starts; s < starts + N_STARTS; s++)
        if (s->box == i &&
            !set_values(x, i, s->type, s->references, s->n_references, s->values, s->n))
            return 0;
    return 1;
}

/* Parameters that the importer has changed since they were set last. */
static int set_parameters(container *x, uint32_t i, int tunable_only) {
    for (const shown_parameter *p = parameters; p < parameters + N_PARAMETERS; p++) {
        const double *now = x->head.b + p->b;
        union { double f; int32_t i; _Bool b; } one[LARGEST_PARAMETER];
        if (p->box != i || (tunable_only && !p->tunable)) continue;
        if (!memcmp(now, x->applied + p->b, p->size * sizeof *now)) continue;
        for (uint32_t k = 0; k < p->size; k++) {
            if (p->kind == 0) ((double *)one)[k] = now[k];
            if (p->kind == 1) ((int32_t *)one)[k] = (int32_t)now[k];
            if (p->kind == 2) ((_Bool *)one)[k] = now[k] != 0.0;
            if (p->kind == 3) ((int64_t *)one)[k] = (int64_t)now[k];
        }
        if (!set_values(x, i, p->type, p->references, p->n_references, one, p->size)) return 0;
        memcpy(x->applied + p->b, now, p->size * sizeof *now);
    }
    return 1;
}

static int enter_initialization(container *x, uint32_t i, double t) {
    void *own = x->inside[i].instance;
    const box *b = boxes + i;
    if (!set_starts(x, i) || !set_parameters(x, i, 0)) return 0;
    if (b->fmi == 3) {
        void *f = function(x->inside + i, b, "fmi3EnterInitializationMode");
        if (!f) return fail(x, "%s: its library has no function fmi3EnterInitializationMode", b->name);
        return good(x, i, (int)((fmi3EnterInitializationModeTYPE *)f)(own, 0, 0.0, t, 0, 0.0),
                    "fmi3EnterInitializationMode");
    }
    void *f = function(x->inside + i, b, "fmi2SetupExperiment");
    if (!f) return fail(x, "%s: its library has no function fmi2SetupExperiment", b->name);
    if (!good(x, i, (int)((fmi2SetupExperimentTYPE *)f)(own, 0, 0.0, t, 0, 0.0), "fmi2SetupExperiment"))
        return 0;
    /* some FMUs lose what was set before */
    memcpy(x->applied, x->head.component->start, x->head.component->n_block * sizeof(double));
    return set_starts(x, i) && set_parameters(x, i, 0) && call(x, i, "EnterInitializationMode");
}

/* ---- the loop ---------------------------------------------------------------------------- */

static int stopped(container *x, int32_t outcome) {
    uuv_loop_failure why;
    if (outcome == UUV_CORE_GOOD) return 1;
    uuv_core_why(x->core, &why);
    const char *name = why.member < N_BOXES ? boxes[member_box[why.member]].name : "?";
    const char *words = why.member < N_BOXES ? x->inside[member_box[why.member]].words : "";
    static const char *const reasons[] = {
        "", "a call returned a status that is not good", "an output is not finite",
        "a state is not finite", "a value does not fit the type of its input",
        "it asks to end the simulation", "it returned early from a step", "there is no memory",
        "the iterated group did not converge"};
    return fail(x, "component %s failed at t = %.9g s: %s (status %d)%s%s", name,
                (double)why.tick * (double)tick_num / (double)tick_den,
                why.outcome >= 0 && why.outcome < 9 ? reasons[why.outcome] : "unknown outcome",
                (int)why.status, words[0] ? ": " : "", words);
}

/* Free elements of inputs, from the block to the loop's slots. */
static void give_inputs(container *x) {
    uuv_slot *slots = uuv_core_slots(x->core);
    for (const shown *s = free_inputs; s < free_inputs + N_FREE; s++) {
        const double v = x->head.b[s->b];
        uuv_slot *slot = slots + s->slot;
        if (s->kind == 0) slot->f = v;
        if (s->kind == 1) slot->i = (int64_t)v;
        if (s->kind == 2) slot->u = (uint64_t)v;
    }
}

static void take_outputs(container *x) {
    const uuv_slot *slots = uuv_core_slots(x->core);
    for (const shown *s = shown_outputs; s < shown_outputs + N_SHOWN; s++) {
        const uuv_slot slot = slots[s->slot];
        x->head.b[s->b] = s->kind == 0 ? slot.f : s->kind == 1 ? (double)slot.i : (double)slot.u;
    }
}

/* In Initialization Mode: inputs from their sources, then the first values. */
static void begin(container *x) {
    char resources[LONGEST_PATH];
    int ok = !x->failed;
    const double t = (double)(first_tick * tick_num) / (double)tick_den;
    if (!ok || x->core) return;
    if (!own_resources(resources, sizeof resources))
        ok = fail(x, "the folder of the resources was not found beside this library");
    for (uint32_t i = 0; ok && i < N_BOXES; i++) ok = load(x, i, resources);
    for (uint32_t i = 0; ok && i < N_BOXES; i++) ok = enter_initialization(x, i, t);
    if (ok) {
        x->core = uuv_core_new(N_BOXES, N_SLOTS, tick_num, tick_den);
        ok = (x->core && build(x)) || fail(x, "there is no memory, or an FMU lacks a function");
    }
    if (!ok) return;
    uuv_core_measure_nothing(x->core);
    give_inputs(x);
    for (const start_value *s = solved; ok && s < solved + N_SOLVED; s++)
        ok = set_values(x, s->box, s->type, s->references, s->n_references, s->values, s->n);
    ok = ok && (N_ORDER == 0 || stopped(x, uuv_core_propagate(x->core, first_tick, N_ORDER, order)));
    for (uint32_t i = 0; ok && i < N_BOXES; i++) ok = call(x, i, "ExitInitializationMode");
    if (ok) ok = stopped(x, uuv_core_begin(x->core, first_tick));
    if (ok) take_outputs(x);
    x->head.outputs_stale = x->head.dirty = 0;
}

static void let_go(container *x, int terminate) {
    if (x->core) uuv_core_forget(x->core);
    for (uint32_t i = 0; i < N_BOXES; i++) {
        inner *in = x->inside + i;
        if (in->instance) {
            void *f = NULL;
            if (terminate && x->core && !x->failed) call(x, i, "Terminate");
            f = function(in, boxes + i, boxes[i].fmi == 2 ? "fmi2FreeInstance" : "fmi3FreeInstance");
            if (f) ((fmi2FreeInstanceTYPE *)f)(in->instance);
        }
        if (in->library) dlclose(in->library);
        memset(in, 0, sizeof *in);
    }
    if (x->core) uuv_core_free(x->core);
    x->core = NULL;
}

/* ---- life -------------------------------------------------------------------------------- */

UUV_EXPORT const uuv_component *uuv_get_component(void) { return &uuv_the_component; }

UUV_EXPORT void uuv_reset(uuv_instance *s) {
    container *x = (container *)s;
    let_go(x, 0);
    memcpy(s->b, s->component->start, s->component->n_block * sizeof(V));
    memcpy(x->applied, s->component->start, s->component->n_block * sizeof(V));
    x->made = 0;
    x->failed = x->initializing = s->initialized = 0;
    s->dirty = s->outputs_stale = 1;
}

UUV_EXPORT void uuv_free(uuv_instance *s) {
    container *x = (container *)s;
    if (!s) return;
    if (x->inside) let_go(x, 0);
    free(s->b);
    free(x->applied);
    free(x->inside);
    free(s);
}

UUV_EXPORT uuv_instance *uuv_instantiate(const uuv_component *c) {
    container *x = calloc(1, sizeof *x);
    if (!x) return NULL;
    x->head.component = c;
    x->head.b = calloc(c->n_block, sizeof(V));
    x->applied = calloc(c->n_block, sizeof(V));
    x->inside = calloc(N_BOXES, sizeof *x->inside);
    if (!x->head.b || !x->applied || !x->inside) {
        uuv_free(&x->head);
        return NULL;
    }
    uuv_reset(&x->head);
    return &x->head;
}

UUV_EXPORT void uuv_refresh(uuv_instance *s) { (void)s; } /* it shows no locals */

UUV_EXPORT void uuv_update_outputs(uuv_instance *s) {
    container *x = (container *)s;
    if (!x->initializing || !s->outputs_stale) return;
    let_go(x, 0); /* a value was changed after outputs had been read: initialize again */
    memcpy(x->applied, s->component->start, s->component->n_block * sizeof(V));
    begin(x);
}

UUV_EXPORT void uuv_enter_initialization(uuv_instance *s, double start_time) {
    container *x = (container *)s;
    s->b[0] = x->start_time = start_time;
    x->initializing = 1;
}

UUV_EXPORT void uuv_exit_initialization(uuv_instance *s) {
    uuv_update_outputs(s);
    ((container *)s)->initializing = 0;
    s->initialized = 1;
}

void uuv_terminate(uuv_instance *s) { let_go((container *)s, 1); }

const char *uuv_failure(const uuv_instance *s) {
    const container *x = (const container *)s;
    return x->failed ? x->failure : NULL;
}

/* ---- steps ------------------------------------------------------------------------------- */

static int64_t steps_to(const container *x, double time) {
    return whole_point(time - x->start_time, (double)tick_num, (double)tick_den);
}

const char *uuv_step_refused(uuv_instance *s, double t, double h) {
    container *x = (container *)s;
    return whole_refused(x->refused, sizeof x->refused, x->made,
                         steps_to(x, t + h), t, h, (double)tick_num / (double)tick_den);
}

UUV_EXPORT int32_t uuv_do_step(uuv_instance *s, double t, double h) {
    container *x = (container *)s;
    const int64_t end = steps_to(x, t + h);
    int ok = x->core != NULL;
    for (uint32_t i = 0; ok && s->dirty && i < N_BOXES; i++) ok = set_parameters(x, i, 1);
    s->dirty = 0;
    if (ok && end > x->made) {
        give_inputs(x);
        ok = stopped(x, uuv_core_run(x->core, (uint64_t)(end - x->made), 1e9));
        if (ok) take_outputs(x);
        x->made = end;
    }
    s->b[0] = t + h;
    return 0;
}

/* ---- states: the FMUs' own are not copied; texts ----------------------------------------- */

UUV_EXPORT size_t uuv_state_size(const uuv_instance *s) { return (void)s, 0; }

UUV_EXPORT void uuv_get_state(const uuv_instance *s, void *out) { (void)s, (void)out; }

UUV_EXPORT void uuv_set_state(uuv_instance *s, const void *in) { (void)s, (void)in; }

const char *uuv_text(const uuv_instance *s, uint32_t vr) { return (void)s, (void)vr, NULL; }

int uuv_set_text(uuv_instance *s, uint32_t vr, const char *value) {
    return (void)s, (void)vr, (void)value, 0;
}

#endif
