/* Iterated groups are made here, and freed. */
#include <stdlib.h>

#include "iterate.h"

/* The inputs inside the group: numbers are solved for, all else follows. */
static void find_inputs(uuv_core *core, iteration *it) {
    for (uint32_t i = it->first; i < it->first + it->n_members; i++)
        for (uint32_t k = 0; k < core->members[i].n_transfers; k++) {
            const transfer *t = &core->members[i].transfers[k];
            if (t->early != 2) continue;
            for (uint32_t j = 0; j < t->count; j++) {
                const int numbers = t->source_class == CLASS_FLOAT && t->target_class == CLASS_FLOAT;
                if (numbers)
                    it->slots[it->n++] = t->target + j;
                else if (t->target_class != CLASS_BLOB)
                    it->others[it->n_others++] = t->target + j;
            }
        }
}

UUV_CORE_API int uuv_core_iterate(uuv_core *core, uint32_t first, uint32_t n_members, int solver_,
                                  double tolerance, uint32_t limit) {
    static solver *const solvers[] = {solve_newton, solve_anderson, solve_fixed_point};
    iteration *it = append((void **)&core->groups, &core->n_groups, sizeof *it);
    if (!it) return 0;
    it->solve = solvers[solver_];
    it->first = first;
    it->n_members = n_members;
    it->tolerance = tolerance;
    it->limit = limit;
    it->slots = calloc(core->n_slots + 1, sizeof *it->slots);
    it->others = calloc(core->n_slots + 1, sizeof *it->others);
    it->before = calloc(core->n_slots + 1, sizeof *it->before);
    if (!it->slots || !it->others || !it->before) return 0;
    find_inputs(core, it);
    it->x = calloc(it->n + 1, sizeof *it->x);
    it->r = calloc(it->n + 1, sizeof *it->r);
    it->work = calloc(work_size(it->n) + 1, sizeof *it->work);
    it->largest = calloc(it->n + 1, sizeof *it->largest);
    if (!it->x || !it->r || !it->work || !it->largest) return 0;
    /* The array of groups has moved. */
    for (uint32_t g = 0; g < core->n_groups; g++)
        for (uint32_t i = 0; i < core->groups[g].n_members; i++)
            core->members[core->groups[g].first + i].group = &core->groups[g];
    return 1;
}

void free_groups(uuv_core *core) {
    for (uint32_t i = 0; i < core->n_groups; i++) {
        free(core->groups[i].slots);
        free(core->groups[i].others);
        free(core->groups[i].before);
        free(core->groups[i].x);
        free(core->groups[i].r);
        free(core->groups[i].work);
        free(core->groups[i].largest);
    }
    free(core->groups);
}
