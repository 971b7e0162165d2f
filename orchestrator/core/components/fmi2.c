/* FMI 2.0 for Co-Simulation. */
#include "fmi2FunctionTypes.h"
#include "pack.h"

typedef fmi2Status get_function(fmi2Component, const fmi2ValueReference[], size_t, void *);
typedef fmi2Status set_function(fmi2Component, const fmi2ValueReference[], size_t, const void *);

static int accept(fmi2Status status, int action, uuv_failure *why) {
    if (status == fmi2OK || status == fmi2Warning) return 1;
    return failed(why, UUV_CORE_BAD_STATUS, (int)status, action);
}

static int fmi2_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    for (uint32_t i = 0; i < m->n_sets; i++) {
        const access *a = &m->sets[i];
        why->slot = a->slot; /* says which function failed, if one does */
        calling(m, "fmi2Set", type_name(a->type, 2));
        const void *values = pack(a, slots, BOOLEAN_INT, why);
        if (!values) return 0;
        const fmi2Status status = ((set_function *)a->function)(m->instance, a->references, a->n_references, values);
        if (!accept(status, UUV_CORE_SET, why)) return 0;
    }
    return 1;
}

static int fmi2_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    (void)slots;
    calling(m, "fmi2DoStep", "");
    const fmi2Boolean last = never_goes_back(m);
    return accept(((fmi2DoStepTYPE *)m->do_step)(m->instance, t, h, last), UUV_CORE_DO_STEP, why);
}

static int fmi2_get(member *m, uuv_slot *slots, uuv_failure *why) {
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        why->slot = a->slot;
        calling(m, "fmi2Get", type_name(a->type, 2));
        void *values = unpack_buffer(a, slots);
        const fmi2Status status = ((get_function *)a->function)(m->instance, a->references, a->n_references, values);
        if (!accept(status, UUV_CORE_GET, why)) return 0;
        if (!unpack(a, slots, BOOLEAN_INT)) return failed(why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
    }
    return 1;
}

const kind kind_fmi2 = {fmi2_set, fmi2_do_step, fmi2_get};
