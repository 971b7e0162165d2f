/* Faults of signals: what others see of an output is overridden, biased, scaled, frozen, delayed or
 * dropped. The component itself knows nothing of it. */
#include <stdlib.h>
#include <string.h>

#include "tables.h"

struct fault {
    uint32_t id, slot, kind, n, head;
    double value;
    uint64_t seed;
    uuv_slot *past; /* kept values: one, or n of a delay, the oldest at head */
};

static double as_double(uuv_slot s, int class) {
    if (class == CLASS_FLOAT) return s.f;
    return class == CLASS_SIGNED ? (double)s.i : (double)s.u;
}

static uuv_slot from_double(double x, int class) {
    uuv_slot s = {0};
    if (class == CLASS_FLOAT) s.f = x;
    else if (class == CLASS_BOOLEAN) s.u = x != 0.0;
    else if (class == CLASS_SIGNED)
        s.i = x >= 9223372036854775808.0   ? INT64_MAX
              : x < -9223372036854775808.0 ? INT64_MIN
              : x <= -4503599627370496.0 || x >= 4503599627370496.0 ? (int64_t)x
              : (int64_t)(x < 0.0 ? x - 0.5 : x + 0.5);
    else
        s.u = x >= 18446744073709551616.0 ? UINT64_MAX
              : x >= 4503599627370496.0   ? (uint64_t)x
              : x > 0.0                   ? (uint64_t)(x + 0.5) : 0;
    return s;
}

/* Adds a number; to integers a whole one, without losing a digit, and within their range. */
static uuv_slot biased(uuv_slot s, double bias, int class) {
    uuv_slot sum = {0};
    if (class == CLASS_FLOAT || class == CLASS_BOOLEAN) return from_double(as_double(s, class) + bias, class);
    if (class == CLASS_SIGNED) {
        if (__builtin_add_overflow(s.i, from_double(bias, class).i, &sum.i)) sum.i = bias > 0.0 ? INT64_MAX : INT64_MIN;
    } else if (bias < 0.0) {
        const uint64_t less = from_double(-bias, class).u;
        sum.u = s.u > less ? s.u - less : 0;
    } else if (__builtin_add_overflow(s.u, from_double(bias, class).u, &sum.u)) {
        sum.u = UINT64_MAX;
    }
    return sum;
}

/* A number in [0, 1) of (seed, slot, tick) alone (the finalizer of splitmix64, twice). */
static double chance(uint64_t seed, uint64_t slot, uint64_t tick) {
    uint64_t z = seed + UINT64_C(0x9e3779b97f4a7c15) * (slot + 1);
    for (int i = 0; i < 2; i++) {
        z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
        z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
        z = (z ^ (z >> 31)) + UINT64_C(0x9e3779b97f4a7c15) * (tick + 1);
    }
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    return (double)(z >> 11) * 0x1p-53;
}

static void apply(const uuv_core *core, fault *f, uuv_slot *slots) {
    const int class = core->classes[f->slot];
    uuv_slot *s = slots + f->slot, kept;
    switch (f->kind) {
    case UUV_CORE_OVERRIDE: *s = from_double(f->value, class); break;
    case UUV_CORE_BIAS: *s = biased(*s, f->value, class); break;
    case UUV_CORE_SCALE: *s = from_double(as_double(*s, class) * f->value, class); break;
    case UUV_CORE_FREEZE: *s = f->past[0]; break;
    case UUV_CORE_DELAY:
        kept = f->past[f->head];
        f->past[f->head] = *s;
        f->head = (f->head + 1) % f->n;
        *s = kept;
        break;
    default: /* UUV_CORE_DROP */
        if (chance(f->seed, f->slot, core->tick) < f->value) *s = f->past[0];
        else f->past[0] = *s;
    }
}

void apply_faults(const uuv_core *core, member *m, uuv_slot *slots) {
    for (uint32_t i = 0; i < m->n_faults; i++) apply(core, &m->faults[i], slots);
}

static fault *find(const uuv_core *core, uint32_t id, member **owner) {
    for (member *m = core->members; m < core->members + core->n_members; m++)
        for (uint32_t i = 0; i < m->n_faults; i++)
            if (m->faults[i].id == id) {
                *owner = m;
                return &m->faults[i];
            }
    return NULL;
}

UUV_CORE_API int uuv_core_fault(uuv_core *core, uint32_t id, uint32_t member_, uint32_t slot, int kind,
                                double value, uint32_t n, uint64_t seed) {
    member *m = &core->members[member_];
    fault f = {.id = id, .slot = slot, .kind = (uint32_t)kind, .n = n ? n : 1, .value = value, .seed = seed};
    fault *grown = realloc(m->faults, (m->n_faults + 1) * sizeof *grown);
    if (!grown) return 0;
    m->faults = grown;
    f.past = malloc(f.n * sizeof *f.past);
    if (!f.past) return 0;
    for (uint32_t i = 0; i < f.n; i++) f.past[i] = core->slots[slot];
    m->faults[m->n_faults++] = f;
    return 1;
}

UUV_CORE_API void uuv_core_clear_fault(uuv_core *core, uint32_t id) {
    member *m;
    fault *f = find(core, id, &m);
    if (!f) return;
    free(f->past);
    memmove(f, f + 1, (size_t)(m->faults + m->n_faults - f - 1) * sizeof *f);
    m->n_faults--;
}

UUV_CORE_API uuv_slot *uuv_core_fault_past(uuv_core *core, uint32_t id, uint32_t *n,
                                           uint32_t **head) {
    member *m;
    fault *f = find(core, id, &m);
    if (!f) return NULL;
    *n = f->n;
    *head = &f->head;
    return f->past;
}

void free_faults(member *m) {
    for (uint32_t i = 0; i < m->n_faults; i++) free(m->faults[i].past);
    free(m->faults);
}
