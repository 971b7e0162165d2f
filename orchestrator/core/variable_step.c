/* The variable communication step (variable_step.h). Start reading at `vary`. */
#include "variable_step.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define UUV_W 1
#include "uuv_math.h"

#include "coupling.h"
#include "fast_path.h"
#include "iterate.h"

static double power(double x, double y) { return uuv_pow(x, y); }

UUV_CORE_API int uuv_core_vary(uuv_core *core, const uuv_step_control *control) {
    struct variable_step *v = core->varied = calloc(1, sizeof *core->varied);
    if (!v) return 0;
    v->set = *control;
    v->horizon = UINT64_MAX;
    for (member *m = core->members; m < core->members + core->n_members; m++) m->follows = m->step_ticks == 1;
    return 1;
}

UUV_CORE_API int uuv_core_extrapolate(uuv_core *core, uint32_t slot) {
    struct variable_step *v = core->varied;
    uint32_t *next = append((void **)&v->sources, &v->n_sources, sizeof *next);
    if (next) *next = slot;
    return next != NULL;
}

UUV_CORE_API int uuv_core_judge(uuv_core *core, uint32_t target, uint32_t source, double factor,
                                double offset, double absolute, double relative) {
    struct variable_step *v = core->varied;
    judged *next = append((void **)&v->judged, &v->n_judged, sizeof *next);
    if (!next) return 0;
    *next = (judged){target, source, UINT32_MAX, factor, offset, absolute, relative};
    for (uint32_t i = 0; i < v->n_sources; i++)
        if (v->sources[i] == source) next->ahead = i;
    return 1;
}

UUV_CORE_API int uuv_core_bond(uuv_core *core, uint32_t input_a, uint32_t output_a, uint32_t input_b,
                               uint32_t output_b) {
    struct variable_step *v = core->varied;
    power_bond *next = append((void **)&v->bonds, &v->n_bonds, sizeof *next);
    if (next) *next = (power_bond){input_a, output_a, input_b, output_b};
    return next != NULL;
}

UUV_CORE_API void uuv_core_horizon(uuv_core *core, uint64_t tick) {
    if (core->varied) core->varied->horizon = tick;
}

UUV_CORE_API void uuv_core_step_counts(const uuv_core *core, uuv_step_counts *counts) {
    *counts = core->varied->now.counts;
}

void free_variable_step(uuv_core *core) {
    struct variable_step *v = core->varied;
    if (!v) return;
    free(v->judged), free(v->bonds), free(v->sources), free(v->past), free(v->ahead), free(v->slots);
    free(v->due), free(v->past_then), free(v);
}

static size_t past_size(const struct variable_step *v) { return v->n_sources * UUV_PAST * sizeof *v->past; }

int begin_variable_step(uuv_core *core) {
    struct variable_step *v = core->varied;
    if (!v) return 1;
    v->now = (step_state){.next = v->set.first, .before = 1.0, .counts.least = UINT64_MAX};
    v->horizon = UINT64_MAX;
    if (v->slots) return 1;
    v->past = calloc(v->n_sources + 1, UUV_PAST * sizeof *v->past);
    v->past_then = calloc(v->n_sources + 1, UUV_PAST * sizeof *v->past);
    v->ahead = calloc(v->n_sources + 1, sizeof *v->ahead);
    v->slots = calloc(2 * (size_t)core->n_slots + 1, sizeof *v->slots);
    v->due = calloc(core->n_members + 1, sizeof *v->due);
    if (v->past && v->past_then && v->ahead && v->slots && v->due) return 1;
    return failed(&core->why, UUV_CORE_NO_MEMORY, 0, UUV_CORE_GET);
}

size_t step_state_size(const uuv_core *core) {
    return core->varied ? sizeof core->varied->now + past_size(core->varied) : 0;
}

void put_step_state(const uuv_core *core, char *out) {
    memcpy(out, &core->varied->now, sizeof core->varied->now);
    memcpy(out + sizeof core->varied->now, core->varied->past, past_size(core->varied));
}

void take_step_state(uuv_core *core, const char *in) {
    memcpy(&core->varied->now, in, sizeof core->varied->now);
    memcpy(core->varied->past, in + sizeof core->varied->now, past_size(core->varied));
}

/* ---- extrapolation ------------------------------------------------------------------------ */

/* Newton's polynomial through the latest points, of one order less than their number. */
typedef struct {
    double f[UUV_PAST], t[UUV_PAST]; /* divided differences; times relative to the latest point */
    uint32_t n;
} polynomial;

static polynomial through(const double *values, const double *times, uint32_t n) {
    polynomial p = {.n = n};
    for (uint32_t i = 0; i < n; i++) p.f[i] = values[i], p.t[i] = times[i] - times[0];
    for (uint32_t k = 1; k < n; k++)
        for (uint32_t i = n - 1; i >= k; i--) p.f[i] = (p.f[i] - p.f[i - 1]) / (p.t[i] - p.t[i - k]);
    return p;
}

static double value_at(const polynomial *p, double s) {
    double y = p->f[p->n - 1];
    for (uint32_t i = p->n - 1; i--;) y = y * (s - p->t[i]) + p->f[i];
    return y;
}

/* The mean from 0 to h: Gauss' rule with two points is exact up to order 3. */
static double mean_to(const polynomial *p, double h) {
    const double spread = 0.28867513459481287 * h; /* h / sqrt(12) */
    return 0.5 * (value_at(p, 0.5 * h - spread) + value_at(p, 0.5 * h + spread));
}

static void note_past(uuv_core *core, double t) {
    struct variable_step *v = core->varied;
    step_state *now = &v->now;
    if (!v->n_sources || (now->known && now->times[0] == t)) return;
    for (int i = UUV_PAST - 1; i > 0; i--) now->times[i] = now->times[i - 1];
    now->times[0] = t;
    if (now->known < UUV_PAST) now->known++;
    for (uint32_t k = 0; k < v->n_sources; k++) {
        double *const past = v->past + k * UUV_PAST;
        for (int i = UUV_PAST - 1; i > 0; i--) past[i] = past[i - 1];
        past[0] = core->slots[v->sources[k]].f;
    }
}

/* Lets the outputs show, over the step, the mean of their extrapolated values; after the step they
 * show their new ones. */
static void extrapolate(uuv_core *core, double h) {
    struct variable_step *v = core->varied;
    const uint32_t points = v->set.order + 1u;
    const uint32_t n = v->now.known < points ? (uint32_t)v->now.known : points;
    for (uint32_t k = 0; k < v->n_sources; k++) {
        const polynomial p = through(v->past + k * UUV_PAST, v->now.times, n);
        v->ahead[k] = value_at(&p, h);
        core->slots[v->sources[k]].f = mean_to(&p, h);
    }
}

/* ---- estimate ----------------------------------------------------------------------------- */

static double of_connections(const uuv_core *core) {
    const struct variable_step *v = core->varied;
    double most = 0.0;
    for (const judged *j = v->judged; j < v->judged + v->n_judged; j++) {
        const double due = j->factor * core->slots[j->source].f + j->offset;
        const double used = j->ahead == UINT32_MAX ? core->slots[j->target].f
                                                   : j->factor * v->ahead[j->ahead] + j->offset;
        double residual = fabs(due - used);
        const double turn = core->turns[j->target];
        if (residual > 0.5 * turn && residual < 1.5 * turn) residual = fabs(residual - turn);
        const double error = residual / (j->absolute + j->relative * fabs(due));
        if (error > most) most = error;
    }
    return most;
}

static double of_bonds(const uuv_core *core, double h) {
    const struct variable_step *v = core->varied;
    const uuv_slot *const s = core->slots;
    double most = 0.0, sum = 0.0;
    if (!v->n_bonds) return 0.0;
    for (int pass = 0; pass < 2; pass++)
        for (const power_bond *b = v->bonds; b < v->bonds + v->n_bonds; b++) {
            const double residual = fabs(s[b->input_a].f * s[b->output_a].f - s[b->input_b].f * s[b->output_b].f);
            if (!pass) {
                if (residual > most) most = residual;
            } else {
                const double error = residual * h / (v->set.absolute + v->set.relative * (most * h));
                sum += error * error;
            }
        }
    return sqrt(sum / v->n_bonds);
}

static uint64_t within(const uuv_step_control *set, double ticks) {
    if (!(ticks > (double)set->smallest)) return set->smallest;
    return ticks < (double)set->largest ? (uint64_t)ticks : set->largest;
}

static double clamped(double x, double low, double high) { return x < low ? low : x > high ? high : x; }

/* The next step's length after one of `ticks`, which was `full` or was cut short. */
static void choose_next(struct variable_step *v, double error, uint64_t ticks, int full) {
    const uuv_step_control *set = &v->set;
    const double before = v->now.before;
    v->now.before = error;
    if (before == 0.0 || error == 0.0) return;
    const double change = set->safety * power(error, -set->integral - set->proportional) *
                          power(before, set->proportional);
    uint64_t next = within(set, clamped(change, set->slowest, set->fastest) * (double)ticks);
    /* A step of few ticks would not grow at all by less than a tick. */
    if (change > 1.0 && next == ticks && ticks < set->largest) next++;
    if (full || next > v->now.next) v->now.next = next;
}

/* ---- rollback ----------------------------------------------------------------------------- */

static int keep(uuv_core *core) {
    struct variable_step *v = core->varied;
    memcpy(v->slots, core->slots, 2 * (size_t)core->n_slots * sizeof *v->slots);
    v->then = v->now;
    memcpy(v->past_then, v->past, past_size(v));
    for (uint32_t i = 0; i < core->n_members; i++) {
        member *m = core->members + i;
        v->due[i] = m->due;
        if (m->due == core->tick && !save_state(m, &core->why)) return (int)i + 2;
    }
    return 1;
}

/* Says whether an output has other bits than before the step; texts are not compared. */
static int changed(const uuv_core *core, const member *m) {
    const uuv_slot *const kept = core->varied->slots + (m->fresh - core->slots);
    for (uint32_t i = 0; i < m->n_gets; i++) {
        const access *a = &m->gets[i];
        for (uint32_t s = a->slot; a->class != CLASS_BLOB && s < a->slot + a->n_values; s++)
            if (m->fresh[s].u != kept[s].u) return (int)s + 1;
    }
    return 0;
}

/* Goes back to the step's start; a member whose outputs are others than then gives itself. */
static member *go_back(uuv_core *core, uint64_t tick) {
    struct variable_step *v = core->varied;
    for (uint32_t i = 0; i < core->n_members; i++) {
        member *m = core->members + i;
        if (v->due[i] == tick) {
            if (!restore_state(m, &core->why) || !read_outputs(core, m)) return m;
            const int which = m->n_faults || m->group ? 0 : changed(core, m);
            if (which) {
                core->why.slot = (uint32_t)which - 1;
                failed(&core->why, UUV_CORE_NOT_RESTORED, 0, UUV_CORE_SET_STATE);
                return m;
            }
        }
        m->due = v->due[i];
    }
    for (uint32_t s = 0; s < core->n_slots; s++)
        if (core->classes[s] != CLASS_BLOB) {
            core->slots[s] = v->slots[s];
            core->fresh[s] = v->slots[core->n_slots + s];
        }
    v->then.counts = v->now.counts;
    v->now = v->then;
    memcpy(v->past, v->past_then, past_size(v));
    core->tick = tick;
    return NULL;
}

/* ---- the step ----------------------------------------------------------------------------- */

static double set_length(uuv_core *core, uint64_t ticks) {
    const double h = (double)(ticks * core->num) / (double)core->den;
    for (member *m = core->members; m < core->members + core->n_members; m++)
        if (m->follows) m->step_ticks = ticks, m->h = h;
    core->stride = ticks;
    return h;
}

/* Ticks to the next point that no step may pass. */
static uint64_t room(const uuv_core *core) {
    uint64_t end = core->varied->horizon;
    for (const member *m = core->members; m < core->members + core->n_members; m++) {
        if (m->follows) continue;
        const uint64_t due = m->due == core->tick ? core->tick + m->step_ticks : m->due;
        if (due < end) end = due;
    }
    return end > core->tick ? end - core->tick : UINT64_MAX;
}

/* A step that failed in a way which a shorter one may not: the component discards it, or its values
 * are no numbers. */
static int may_be_too_long(const uuv_failure *why) {
    return (why->outcome == UUV_CORE_BAD_STATUS && why->status == 2 && why->action == UUV_CORE_DO_STEP) ||
           why->outcome == UUV_CORE_NOT_FINITE || why->outcome == UUV_CORE_STATE_NOT_FINITE;
}

member *vary(uuv_core *core, member *(*step_due)(uuv_core *core, double t), void (*collect)(uuv_core *core)) {
    struct variable_step *v = core->varied;
    const uint64_t tick = core->tick;
    const double t = (double)(tick * core->num) / (double)core->den;
    note_past(core, t);
    for (;;) {
        const uint64_t most = room(core), ticks = v->now.next < most ? v->now.next : most;
        const int full = ticks == v->now.next;
        const int kept = v->set.rollback ? keep(core) : 1;
        if (kept != 1) return core->members + (kept - 2);
        const double h = set_length(core, ticks);
        extrapolate(core, h);
        find_segments(core);
        member *culprit = step_due(core, t);
        if (culprit) collect(core);
        const int retry = culprit && v->set.rollback && ticks > v->set.smallest && may_be_too_long(&core->why);
        if (culprit && !retry) return culprit;
        const int judge = !culprit && v->now.counts.steps > 0;
        const double of_values = judge ? of_connections(core) : 0.0, of_power = judge ? of_bonds(core, h) : 0.0;
        const double error = of_values > of_power ? of_values : of_power;
        if (!retry && !(v->set.rollback && error > 1.0 && ticks > v->set.smallest)) {
            uuv_step_counts *const counts = &v->now.counts;
            if (counts->steps++ > 0) choose_next(v, error, ticks, full);
            if (error > 1.0 && ticks <= v->set.smallest) counts->unsatisfied++;
            if (error > counts->worst) counts->worst = error, counts->worst_tick = core->tick;
            if (full && ticks < counts->least) counts->least = ticks;
            if (ticks > counts->most) counts->most = ticks;
            return NULL;
        }
        if ((culprit = go_back(core, tick))) return culprit;
        const double shorter = retry ? v->set.slowest
                                     : clamped(v->set.safety * power(error, -1.0 / (v->set.order + 1.0)), v->set.slowest, 0.9);
        v->now.next = within(&v->set, shorter * (double)ticks);
        v->now.before = 0.0;
        v->now.counts.rejected++;
    }
}
