/* FMI 1.0 for Co-Simulation. A negated alias is another name of a value, with the opposite sign. */
#include "pack.h"

typedef int get_function(void *, const uint32_t[], size_t, void *);
typedef int set_function(void *, const uint32_t[], size_t, const void *);
typedef int do_step_function(void *, double, double, char);

static int accept(int status, int action, uuv_failure *why) {
    if (status == 0 || status == 1) return 1; /* fmiOK, fmiWarning */
    return failed(why, UUV_CORE_BAD_STATUS, status, action);
}

static void turn(const access *a, uuv_slot *values) {
    for (uint32_t i = 0; i < a->n_values; i++) {
        if (!a->negated[i]) continue;
        if (a->class == CLASS_FLOAT) values[i].f = -values[i].f;
        if (a->class == CLASS_SIGNED) values[i].i = -values[i].i;
        if (a->class == CLASS_BOOLEAN) values[i].u = !values[i].u;
    }
}

static const void *packed(const access *a, const uuv_slot *slots, uuv_failure *why) {
    if (!a->negated) return pack(a, slots, BOOLEAN_BOOL, why);
    for (uint32_t i = 0; i < a->n_values; i++) a->turned[i] = slots[a->slot + i];
    turn(a, a->turned);
    access here = *a;
    here.slot = 0;
    const void *values = pack(&here, a->turned, BOOLEAN_BOOL, why);
    if (!values) why->slot += a->slot;
    return values;
}

static int fmi1_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    for (uint32_t i = 0; i < m->n_sets; i++) {
        const access *a = &m->sets[i];
        why->slot = a->slot; /* says which function failed, if one does */
        calling(m, "fmiSet", type_name(a->type, 1));
        const void *values = packed(a, slots, why);
        if (!values) return 0;
        const int status = ((set_function *)a->function)(m->instance, a->references, a->n_references, values);
        if (!accept(status, UUV_CORE_SET, why)) return 0;
    }
    return 1;
}

static int fmi1_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    (void)slots;
    calling(m, "fmiDoStep", "");
    return accept(((do_step_function *)m->do_step)(m->instance, t, h, 1), UUV_CORE_DO_STEP, why);
}

static int fmi1_get(member *m, uuv_slot *slots, uuv_failure *why) {
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        why->slot = a->slot;
        calling(m, "fmiGet", type_name(a->type, 1));
        void *values = unpack_buffer(a, slots);
        const int status = ((get_function *)a->function)(m->instance, a->references, a->n_references, values);
        if (!accept(status, UUV_CORE_GET, why)) return 0;
        if (!unpack(a, slots, BOOLEAN_BOOL)) return failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
        if (a->negated) turn(a, slots + a->slot);
    }
    return 1;
}

const kind kind_fmi1 = {fmi1_set, fmi1_do_step, fmi1_get};
