/* Fixed point: x <- T(y(x)). Converges where the loop's gain is below one. */
#include "iterate.h"

int solve_fixed_point(uuv_core *core, iteration *it) {
    while (!agreed(it, it->x, it->r)) {
        if (it->count++ >= it->limit) return not_converged(core, it, it->r);
        for (uint32_t j = 0; j < it->n; j++) it->x[j] += it->r[j];
        if (!evaluate(core, it, it->x, it->r)) return ran_away(core, it, it->r);
    }
    return 1;
}
