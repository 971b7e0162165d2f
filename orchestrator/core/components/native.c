/* Native components: inputs and outputs are read and written in the instance's own block. */
#include "tables.h"
#include "values.h"

typedef int32_t do_step_function(uuv_instance *s, double t, double h);
typedef void update_function(uuv_instance *s);

static int native_set(member *m, const uuv_slot *slots, uuv_failure *why) {
    uuv_instance *s = m->instance;
    double *b = (double *)s->b;
    (void)why;
    for (uint32_t i = 0; i < m->n_sets; i++) {
        const access *a = &m->sets[i];
        const uuv_slot *from = slots + a->slot;
        if (a->class == CLASS_FLOAT && a->consecutive)
            for (uint32_t k = 0; k < a->n_values; k++) b[a->references[0] + k] = from[k].f;
        else
            for (uint32_t k = 0; k < a->n_values; k++) b[a->references[k]] = to_block(from[k], a->class);
    }
    s->outputs_stale = 1;
    return 1;
}

static int native_do_step(member *m, const uuv_slot *slots, double t, double h, uuv_failure *why) {
    (void)slots;
    calling(m, "its step", "");
    const int32_t bad = ((do_step_function *)m->do_step)(m->instance, t, h);
    return bad ? failed(why, UUV_CORE_STATE_NOT_FINITE, bad - 1, UUV_CORE_DO_STEP) : 1;
}

static int native_get(member *m, uuv_slot *slots, uuv_failure *why) {
    uuv_instance *s = m->instance;
    const double *b = (const double *)s->b;
    (void)why;
    calling(m, "its outputs", "");
    if (m->get && (s->outputs_stale || s->dirty)) ((update_function *)m->get)(s);
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        uuv_slot *to = slots + a->slot;
        if (a->class == CLASS_FLOAT && a->consecutive)
            for (uint32_t k = 0; k < a->n_values; k++) to[k].f = b[a->references[0] + k];
        else
            for (uint32_t k = 0; k < a->n_values; k++) to[k] = from_block(b[a->references[k]], a->class);
    }
    return 1;
}

const kind kind_native = {native_set, native_do_step, native_get};
