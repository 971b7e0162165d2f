/* The tables are made here, and freed. */
#include <stdlib.h>
#include <string.h>

#include "clocks.h"
#include "fast_path.h"
#include "iterate.h"
#include "variable_step.h"

slot_class class_of(int type) {
    if (type <= UUV_CORE_FLOAT32) return CLASS_FLOAT;
    if (type <= UUV_CORE_INT64) return CLASS_SIGNED;
    if (type <= UUV_CORE_UINT64) return CLASS_UNSIGNED;
    return type == UUV_CORE_BOOLEAN ? CLASS_BOOLEAN : CLASS_BLOB;
}

void *append(void **items, uint32_t *n, size_t size) {
    void *grown = realloc(*items, (*n + 1) * size);
    if (!grown) return NULL;
    *items = grown;
    return memset((char *)grown + (size_t)(*n)++ * size, 0, size);
}

UUV_CORE_API uuv_core *uuv_core_new(uint32_t n_members, uint32_t n_slots, uint64_t num, uint64_t den) {
    uuv_core *core = calloc(1, sizeof *core);
    if (!core) return NULL;
    core->n_members = n_members;
    core->n_slots = n_slots;
    core->num = num;
    core->den = den;
    core->stride = 1;
    core->parts = 1;
    core->members = calloc(n_members + 1, sizeof *core->members);
    core->slots = calloc(2 * (size_t)n_slots + 1, sizeof *core->slots);
    core->fresh = core->slots + n_slots;
    core->classes = calloc(n_slots + 1, 1);
    core->turns = calloc(n_slots + 1, sizeof *core->turns);
    core->instances = calloc(n_members + 1, sizeof *core->instances);
    core->low = calloc(n_slots + 1, sizeof *core->low);
    core->high = calloc(n_slots + 1, sizeof *core->high);
    core->segments = calloc(n_members + 1, sizeof *core->segments);
    if (core->members && core->slots && core->classes && core->turns && core->instances &&
        core->low && core->high && core->segments)
        return core;
    uuv_core_free(core);
    return NULL;
}

static void free_blob(uuv_blob *blob) {
    if (blob) free(blob->data);
    free(blob);
}

static void free_accesses(access *accesses, uint32_t n) {
    for (uint32_t i = 0; i < n; i++) {
        free(accesses[i].references);
        free(accesses[i].scratch);
        free(accesses[i].sizes);
        free(accesses[i].negated);
        free(accesses[i].turned);
        free(accesses[i].clocks);
    }
    free(accesses);
}

UUV_CORE_API void uuv_core_free(uuv_core *core) {
    if (!core) return;
    recording *r = &core->record;
    for (uint32_t s = 0; core->classes && s < core->n_slots; s++)
        if (core->classes[s] == CLASS_BLOB) {
            free_blob(core->slots[s].blob);
            free_blob(core->fresh[s].blob);
        }
    for (uint32_t i = 0; core->members && i < core->n_members; i++) {
        free_accesses(core->members[i].sets, core->members[i].n_sets);
        free_accesses(core->members[i].gets, core->members[i].n_gets);
        for (uint32_t k = 0; k < core->members[i].n_transfers; k++) free(core->members[i].transfers[k].pairs);
        free(core->members[i].transfers);
        free(core->members[i].values.offsets);
        free_values(&core->members[i]);
        free_faults(&core->members[i]);
    }
    free_groups(core);
    free_variable_step(core);
    free_clocks(core);
    free_events(core);
    for (uint64_t i = 0; i < r->capacity; i++) free(r->texts[i].data);
    free(r->texts);
    free(r->runs);
    free(r->text_columns);
    free(r->text_slots);
    free(r->last_text);
    free(core->members);
    free(core->slots);
    free(core->classes);
    free(core->turns);
    free(core->instances);
    free(core->low);
    free(core->high);
    free(core->segments);
    free(core->couplings);
    free(core->spans);
    free(core->twins);
    free(core->singles);
    free(core->most);
    free(core->coupling_of);
    free(core->largest);
    free(core);
}

UUV_CORE_API int uuv_core_member(uuv_core *core, uint32_t i, int which, void *instance,
                                 void *do_step, void *get, int32_t *kept, uint64_t step_ticks,
                                 int sequential) {
    static const kind *const kinds[] = {&kind_native, &kind_fmi2, &kind_fmi3, &kind_callback,
                                         &kind_shared, &kind_fmi1};
    member *m = &core->members[i];
    m->kind = kinds[which - UUV_CORE_NATIVE];
    m->instance = core->instances[i] = instance;
    m->do_step = do_step;
    m->get = get;
    m->kept = kept;
    m->step_ticks = step_ticks;
    m->h = (double)(step_ticks * core->num) / (double)core->den;
    m->sequential = sequential;
    m->fresh = sequential ? core->fresh : core->slots;
    m->at = &core->frame;
    return 1;
}

UUV_CORE_API void uuv_core_name(uuv_core *core, uint32_t i, const char *name) { core->members[i].name = name; }

UUV_CORE_API void uuv_core_guard(uuv_core *core, uuv_frame_function *enter, uuv_frame_function *leave) {
    core->enter = enter;
    core->leave = leave;
}

const char *type_name(int type, int version) {
    static const char *const names[] = {"Float64", "Float32", "Int8",   "Int16",  "Int32",   "Int64", "UInt8",
                                        "UInt16",  "UInt32",  "UInt64", "Boolean", "String", "Binary"};
    if (version == 3 || type == UUV_CORE_BOOLEAN || type == UUV_CORE_STRING) return names[type];
    return type == UUV_CORE_FLOAT64 ? "Real" : "Integer";
}

static int make_blobs(uuv_core *core, uint32_t slot, uint32_t n) {
    for (uint32_t s = slot; s < slot + n; s++) {
        core->slots[s].blob = calloc(1, sizeof(uuv_blob));
        core->fresh[s].blob = calloc(1, sizeof(uuv_blob));
        if (!core->slots[s].blob || !core->fresh[s].blob) return 0;
        if (!blob_assign(core->slots[s].blob, "", 0) || !blob_assign(core->fresh[s].blob, "", 0)) return 0;
    }
    return 1;
}

UUV_CORE_API int uuv_core_access(uuv_core *core, uint32_t i, int action, int type, uint32_t slot,
                                 uint32_t n_values, uint32_t n_references,
                                 const uint32_t *references, void *function) {
    member *m = &core->members[i];
    access *a = action == UUV_CORE_SET ? append((void **)&m->sets, &m->n_sets, sizeof *a)
                                       : append((void **)&m->gets, &m->n_gets, sizeof *a);
    if (!a) return 0;
    a->type = (uint8_t)type;
    a->class = (uint8_t)class_of(type);
    a->slot = slot;
    a->n_values = n_values;
    a->n_references = n_references;
    a->function = function;
    a->references = malloc((n_references + 1) * sizeof *references);
    a->scratch = calloc(n_values + 1, sizeof(uuv_slot));
    a->sizes = calloc(n_values + 1, sizeof *a->sizes);
    if (!a->references || !a->scratch || !a->sizes) return 0;
    memcpy(a->references, references, n_references * sizeof *references);
    a->consecutive = 1;
    for (uint32_t k = 1; k < n_references; k++)
        if (references[k] != references[0] + k) a->consecutive = 0;
    memset(core->classes + slot, a->class, n_values);
    return a->class != CLASS_BLOB || make_blobs(core, slot, n_values);
}

static int negate(access *accesses, uint32_t n, uint32_t slot) {
    for (access *a = accesses; a < accesses + n; a++) {
        if (slot < a->slot || slot >= a->slot + a->n_values) continue;
        if (!a->negated) a->negated = calloc(a->n_values, 1);
        if (!a->turned) a->turned = calloc(a->n_values, sizeof *a->turned);
        if (!a->negated || !a->turned) return 0;
        a->negated[slot - a->slot] = 1;
    }
    return 1;
}

UUV_CORE_API int uuv_core_negate(uuv_core *core, uint32_t i, uint32_t slot) {
    member *m = &core->members[i];
    return negate(m->sets, m->n_sets, slot) && negate(m->gets, m->n_gets, slot);
}

UUV_CORE_API int uuv_core_in_place(uuv_core *core, uint32_t i, uuv_values_function *find,
                                   uuv_steps_function *steps, const uint32_t *offsets, const double *low, const double *high) {
    member *m = &core->members[i];
    in_place *v = &m->values;
    for (uint32_t k = 0; k < m->n_sets; k++) v->n_in += m->sets[k].n_values;
    for (uint32_t k = 0; k < m->n_gets; k++) v->n_out += m->gets[k].n_values;
    v->first_in = m->n_sets ? m->sets->slot : 0;
    v->first_out = m->n_gets ? m->gets->slot : 0;
    v->find = find;
    v->steps = steps;
    v->offsets = malloc((v->n_in + v->n_out + 1) * sizeof *offsets);
    if (!v->offsets) return 0;
    memcpy(v->offsets, offsets, (v->n_in + v->n_out) * sizeof *offsets);
    memcpy(core->low + v->first_in, low, v->n_in * sizeof *low);
    memcpy(core->high + v->first_in, high, v->n_in * sizeof *high);
    return 1;
}

/* A transfer that continues the one before it becomes part of that. */
static int continues(const transfer *last, const transfer *next) {
    return !last->pairs && !next->pairs && last->access == next->access && last->from == next->from && last->early == next->early && last->factor == next->factor &&
           last->offset == next->offset && last->source_class == next->source_class &&
           last->target_class == next->target_class &&
           last->source + last->count == next->source && last->target + last->count == next->target;
}

UUV_CORE_API int uuv_core_transfer(uuv_core *core, uint32_t target, uint32_t source,
                                   uint32_t target_slot, uint32_t source_slot, int early,
                                   double factor, double offset, uint32_t n_pairs,
                                   const int64_t *pairs) {
    member *m = &core->members[target];
    transfer t = {.from = source, .source = source_slot, .target = target_slot, .count = 1,
                  .early = (uint8_t)early, .factor = factor, .offset = offset};
    for (uint32_t i = 0; m->events && i < m->n_sets; i++)
        if (target_slot >= m->sets[i].slot && target_slot < m->sets[i].slot + m->sets[i].n_values) t.access = i;
    t.source_class = core->classes[source_slot];
    t.target_class = core->classes[target_slot];
    t.copy = t.source_class == t.target_class && factor == 1.0 && offset == 0.0 && !n_pairs;
    if (n_pairs) {
        t.n_pairs = n_pairs;
        t.pairs = malloc(2 * n_pairs * sizeof *pairs);
        if (!t.pairs) return 0;
        memcpy(t.pairs, pairs, 2 * n_pairs * sizeof *pairs);
    }
    if (m->n_transfers && continues(&m->transfers[m->n_transfers - 1], &t)) {
        m->transfers[m->n_transfers - 1].count++;
        return 1;
    }
    transfer *place = append((void **)&m->transfers, &m->n_transfers, sizeof *place);
    if (place)
        *place = t;
    else
        free(t.pairs);
    return place != NULL;
}

static int record_slot(uuv_core *core, uint32_t column, uint32_t slot) {
    recording *r = &core->record;
    run *last = r->n_runs ? &r->runs[r->n_runs - 1] : NULL;
    if (core->classes[slot] == CLASS_BLOB) {
        r->text_columns[r->n_texts] = column;
        r->text_slots[r->n_texts++] = slot;
        return 1;
    }
    if (last && last->slot + last->count == slot && last->column + last->count == column) {
        last->count++;
        return 1;
    }
    run *next = append((void **)&r->runs, &r->n_runs, sizeof *next);
    if (next) *next = (run){slot, column, 1};
    return next != NULL;
}

UUV_CORE_API int uuv_core_record(uuv_core *core, uint32_t n, const uint32_t *slots, uint64_t every) {
    recording *r = &core->record;
    r->n_columns = n;
    r->every = every;
    r->text_columns = calloc(n + 1, sizeof *r->text_columns);
    r->text_slots = calloc(n + 1, sizeof *r->text_slots);
    r->last_text = calloc(n + 1, sizeof *r->last_text);
    if (!r->text_columns || !r->text_slots || !r->last_text) return 0;
    for (uint32_t i = 0; i < n; i++)
        if (!record_slot(core, i, slots[i])) return 0;
    return 1;
}

UUV_CORE_API int uuv_core_state(uuv_core *core, uint32_t i, void *get, void *set, void *free_,
                                size_t size) {
    member *m = &core->members[i];
    m->get_state = get;
    m->set_state = set;
    m->free_state = free_;
    m->state_size = size;
    return 1;
}
