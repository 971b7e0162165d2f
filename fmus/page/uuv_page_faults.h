/* SPDX-License-Identifier: Apache-2.0 */
/* Faults of outputs in a fused system: the effect that orchestrator/core/faults.c has in the master.
 *
 * Included by uuv_page.h. The generated file has, for each shown output, the tables output_member,
 * output_kind and output_slot (of the master, which numbers draw from), and is_sequential for each
 * member. While a fault is active, wrappers around the declarations apply it: right after the step
 * of a sequential member, whose readers in the same step get the faulty value, and where the
 * outputs of the others become visible.
 */
#ifndef UUV_PAGE_FAULTS_H
#define UUV_PAGE_FAULTS_H

enum { OF_FLOAT, OF_BOOLEAN, OF_SIGNED, OF_UNSIGNED };           /* output_kind */
enum { OVERRIDE = 1, BIAS, SCALE, FREEZE, DELAY, DROP };         /* as in orchestrator/core */
enum { N_FAULTS_MOST = 128, N_PAST_MOST = 8192, N_DECLARATIONS = sizeof stepper / sizeof *stepper };

typedef struct {
    uint32_t id, member, cell, slot, kind, of, n, head, past; /* past: first kept value */
    V value;
} fault;

typedef struct {
    uint32_t count, n_past, last_id, unused;
    uint64_t seed; /* of lost samples */
    fault each[N_FAULTS_MOST];
    V past[N_PAST_MOST];
} active_faults;
static active_faults faulty;

static const uuv_lane_stepper *true_stepper[N_DECLARATIONS];
static uuv_lane_stepper faulty_stepper[N_DECLARATIONS];
static uuv_lane_component faulty_component[N_DECLARATIONS];

/* What a value becomes in its type; integers beyond 2^53 have no exact value in a cell. */
static V fitted(V x, uint32_t of) {
    if (of == OF_BOOLEAN) return x != 0.0;
    if (of == OF_FLOAT) return x;
    const V most = of == OF_SIGNED ? 9223372036854775808.0 : 18446744073709551616.0;
    if (of == OF_UNSIGNED && !(x > 0.0)) return 0.0;
    if (x >= most) return most;
    if (x < -most) return -most;
    if (x <= -4503599627370496.0 || x >= 4503599627370496.0) return x;
    return (V)(x < 0.0 ? -(int64_t)(0.5 - x) : (int64_t)(x + 0.5));
}

static V chance(uint64_t seed, uint64_t slot, uint64_t tick) {
    uint64_t z = seed + UINT64_C(0x9e3779b97f4a7c15) * (slot + 1);
    for (int i = 0; i < 2; i++) {
        z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
        z = (z ^ (z >> 27)) * UINT64_C(0x94d049bb133111eb);
        z = (z ^ (z >> 31)) + UINT64_C(0x9e3779b97f4a7c15) * (tick + 1);
    }
    z = (z ^ (z >> 30)) * UINT64_C(0xbf58476d1ce4e5b9);
    return (V)(z >> 11) * 0x1p-53;
}

static void apply_fault(fault *f, V *x, uint64_t tick) {
    V *past = faulty.past + f->past, kept;
    if (*x - *x != 0.0) return; /* the system stops at this value */
    switch (f->kind) {
    case OVERRIDE: *x = fitted(f->value, f->of); break;
    case BIAS: *x = fitted(*x + f->value, f->of); break;
    case SCALE: *x = fitted(*x * f->value, f->of); break;
    case FREEZE: *x = past[0]; break;
    case DELAY:
        kept = past[f->head];
        past[f->head] = *x;
        f->head = (f->head + 1) % f->n;
        *x = kept;
        break;
    default: /* DROP */
        if (chance(faulty.seed, f->slot, tick) < f->value) *x = past[0];
        else past[0] = *x;
    }
}

/* Applies the faults of a member's outputs, whose first one is in `outputs`. */
static void apply_faults(uint32_t member, V *outputs, uint64_t tick) {
    const uuv_lane_component *c = true_stepper[members[member].declaration]->component;
    const uint32_t first = members[member].cell + c->off_y;
    for (fault *f = faulty.each; f < faulty.each + faulty.count; f++)
        if (f->member == member) apply_fault(f, outputs + (f->cell - first), tick);
}

static uint32_t member_at(const V *b) {
    uint32_t i = 0;
    while (page->m + members[i].cell != b) i++;
    return i;
}

/* Of a member that steps with every tick: those that are not sequential show a later point. */
static void after_step(uint32_t member, V *b) {
    const uuv_lane_component *c = true_stepper[members[member].declaration]->component;
    apply_faults(member, b + c->off_y, *lane_words(page->m, WORD_TICK) + !is_sequential[member]);
}

static void faulty_do_step(V *cells, V *b, uint32_t n_pieces, const uint8_t *periods,
                           uint32_t n_periods, const uuv_lane_time *now,
                           const uuv_lane_sources *at, V *scratch) {
    const uint32_t i = member_at(b);
    true_stepper[members[i].declaration]->do_step(cells, b, n_pieces, periods, n_periods, now, at,
                                                  scratch);
    after_step(i, b);
}

static void faulty_do_step_together(V *cells, V *b, uint32_t count, uint32_t n_pieces,
                                    const uuv_lane_time *now, const uuv_lane_sources *at,
                                    V *scratch) {
    const uint32_t i = member_at(b);
    const uuv_lane_stepper *s = true_stepper[members[i].declaration];
    s->do_step_together(cells, b, count, n_pieces, now, at, scratch);
    for (uint32_t j = 0; j < count; j++) {
        V *own = b + j * s->component->n_block;
        after_step(member_at(own), own);
    }
}

/* Called for a member with a longer step only, whose readers in the same step see `out`. */
static void faulty_outputs(const V *b, const V *p, V *out) {
    const uint32_t i = member_at(b);
    true_stepper[members[i].declaration]->component->outputs(b, p, out);
    if (is_sequential[i]) apply_faults(i, out, *lane_words(page->m, WORD_TICK));
}

/* After a tick: members with a longer step that has ended, and that are not sequential. */
static void show_faults(void) {
    for (uint32_t j = 0; j < faulty.count; j++) {
        const uint32_t i = faulty.each[j].member;
        int seen = !members[i].is_slower || is_sequential[i];
        for (uint32_t k = 0; k < j && !seen; k++) seen = faulty.each[k].member == i;
        if (seen || *lane_words(page->m, WORD_PHASES + member_period[i]) != 0) continue;
        const uuv_lane_component *c = true_stepper[members[i].declaration]->component;
        apply_faults(i, page->m + members[i].cell + c->off_y, *lane_words(page->m, WORD_TICK));
    }
}

/* Uses the wrappers while there is a fault. */
static void bind_faults(void) {
    for (uint32_t i = 0; i < N_DECLARATIONS; i++) {
        if (!true_stepper[i]) {
            true_stepper[i] = stepper[i];
            faulty_component[i] = *stepper[i]->component;
            faulty_component[i].outputs = faulty_outputs;
            faulty_stepper[i] = *stepper[i];
            faulty_stepper[i].component = &faulty_component[i];
            faulty_stepper[i].do_step = faulty_do_step;
            faulty_stepper[i].do_step_together = faulty_do_step_together;
        }
        uuv_kernel_bind(i, faulty.count ? &faulty_stepper[i] : true_stepper[i]);
    }
}

static void clear_faults(void) {
    uint32_t key[2];
    faulty.count = faulty.n_past = faulty.last_id = 0;
    component_seed((uint64_t)(int64_t)page->head.b[SEED], first_path, key);
    faulty.seed = (uint64_t)(first_seed[0] ? first_seed[1] : key[0]) << 32 |
                  (first_seed[0] ? first_seed[2] : key[1]);
    bind_faults();
}

/* Makes element k of the shown output i faulty from now on; returns the fault's number, or 0 if
 * there is no space for it. `n`: kept values, those of a delay. */
uint32_t UUV_PAGE(uuv_page_add_fault)(uint32_t i, uint32_t k, uint32_t kind, V value, uint32_t n) {
    if (faulty.count == N_FAULTS_MOST || n > N_PAST_MOST - faulty.n_past) return 0;
    fault *f = &faulty.each[faulty.count++];
    *f = (fault){.id = ++faulty.last_id, .member = output_member[i], .kind = kind, .n = n, .value = value,
                 .cell = shown_outputs[i].cell + k, .slot = output_slot[i] + k, .of = output_kind[i],
                 .past = faulty.n_past};
    for (uint32_t j = 0; j < n; j++) faulty.past[faulty.n_past++] = page->m[f->cell];
    bind_faults();
    return f->id;
}

void UUV_PAGE(uuv_page_clear_fault)(uint32_t id) {
    uint32_t i = 0;
    while (i < faulty.count && faulty.each[i].id != id) i++;
    if (i == faulty.count) return;
    const uint32_t first = faulty.each[i].past, n = faulty.each[i].n;
    memmove(faulty.past + first, faulty.past + first + n,
            (faulty.n_past - first - n) * sizeof *faulty.past);
    faulty.n_past -= n;
    faulty.count--;
    memmove(&faulty.each[i], &faulty.each[i + 1], (faulty.count - i) * sizeof *faulty.each);
    for (uint32_t j = i; j < faulty.count; j++) faulty.each[j].past -= n;
    bind_faults();
}

#endif
