/* Values go from output slots to input slots, converted where types or units differ. */
#include <string.h>

#include "tables.h"

static double as_double(uuv_slot s, int class) {
    if (class == CLASS_FLOAT) return s.f;
    return class == CLASS_SIGNED ? (double)s.i : (double)s.u;
}

/* Gives 0 if the value does not fit. */
static int from_double(double x, int class, uuv_slot *to) {
    if (class == CLASS_FLOAT) {
        to->f = x;
    } else if (class == CLASS_BOOLEAN) {
        to->u = x != 0.0;
    } else if (class == CLASS_SIGNED) {
        if (!(x >= -9223372036854775808.0 && x < 9223372036854775808.0)) return 0;
        to->i = (int64_t)(x < 0.0 ? x - 0.5 : x < 4503599627370496.0 ? x + 0.5 : x);
    } else {
        if (!(x >= 0.0 && x < 18446744073709551616.0)) return 0;
        to->u = (uint64_t)(x < 4503599627370496.0 ? x + 0.5 : x);
    }
    return 1;
}

/* Gives 0 for an integer that no double is. */
static int is_exact(uuv_slot s, int class) {
    if (class == CLASS_SIGNED)
        return (double)s.i < 9223372036854775808.0 && (int64_t)(double)s.i == s.i;
    if (class == CLASS_UNSIGNED)
        return (double)s.u < 18446744073709551616.0 && (uint64_t)(double)s.u == s.u;
    return 1;
}

/* Gives 0 where a sum or product of integers, in doubles, may have lost digits. */
static int is_whole(double x) { return x >= -9007199254740992.0 && x <= 9007199254740992.0; }

static int look_up(const transfer *t, uuv_slot from, uuv_slot *to) {
    for (const int64_t *pair = t->pairs; pair < t->pairs + 2 * (size_t)t->n_pairs; pair += 2)
        if (pair[0] == from.i) {
            to->i = pair[1];
            return 1;
        }
    return 0;
}

static int convert(const transfer *t, uuv_slot from, uuv_slot *to) {
    if (t->pairs) return look_up(t, from, to);
    const int integers = t->source_class != CLASS_FLOAT && t->target_class != CLASS_FLOAT;
    const int changes = t->factor != 1.0 || t->offset != 0.0;
    if ((changes || !integers) && !is_exact(from, t->source_class)) return 0;
    if (changes) {
        const double x = t->factor * as_double(from, t->source_class) + t->offset;
        return (!integers || is_whole(x)) && from_double(x, t->target_class, to);
    }
    if (!integers) return from_double(as_double(from, t->source_class), t->target_class, to);
    if (t->target_class == CLASS_BOOLEAN)
        to->u = from.u != 0;
    else if (t->source_class != CLASS_BOOLEAN && (from.i < 0))
        return 0; /* negative to unsigned, or too large for signed */
    else
        *to = from;
    return 1;
}

int carry(uuv_core *core, const transfer *t) {
    const member *from = &core->members[t->from];
    const int stepped = t->early == 2           ? core->iterating
                        : t->early == IN_EVENTS ? core->in_event
                                                : t->early && from->due == core->tick + from->step_ticks;
    const uuv_slot *source = (stepped ? core->fresh : core->slots) + t->source;
    uuv_slot *target = core->slots + t->target;
    if (t->copy && t->source_class != CLASS_BLOB) {
        for (uint32_t i = 0; i < t->count; i++) target[i] = source[i];
        return 1;
    }
    for (uint32_t i = 0; i < t->count; i++) {
        if (t->source_class == CLASS_BLOB) {
            if (!blob_assign(target[i].blob, source[i].blob->data, source[i].blob->size))
                return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_SET);
        } else if (!convert(t, source[i], &target[i])) {
            core->why.slot = t->target + i;
            return failed(&core->why, UUV_CORE_OUT_OF_RANGE, 0, UUV_CORE_SET);
        }
    }
    return 1;
}

int transfer_inputs(uuv_core *core, member *target) {
    for (uint32_t i = 0; i < target->n_transfers; i++)
        if (!carry(core, &target->transfers[i])) return 0;
    return 1;
}
