/* Interface Newton: the Jacobian of r by differences once a step, then Broyden's updates of it;
 * a step that does not lessen |r| is halved. The Jacobian is not kept between steps, so that a
 * step depends on the state alone, and a replay from a snapshot has the same bits. */
#include "iterate.h"

#include <float.h>
#include <math.h>
#include <string.h>

enum { HALVINGS = 8 };

/* Column j: change of r with x[j]. */
static int differences(uuv_core *core, iteration *it, double *jacobian, double *x, double *r) {
    const uint32_t n = it->n;
    memcpy(x, it->x, n * sizeof *x);
    for (uint32_t j = 0; j < n; j++) {
        x[j] = it->x[j] + sqrt(DBL_EPSILON) * (1.0 + fabs(it->x[j]));
        const double h = x[j] - it->x[j];
        if (!evaluate(core, it, x, r)) return 0;
        for (uint32_t i = 0; i < n; i++) jacobian[i * n + j] = (r[i] - it->r[i]) / h;
        x[j] = it->x[j];
    }
    return 1;
}

/* jacobian += (dr - jacobian dx) dx' / dx'dx, with x and r the new values. */
static void broyden(double *jacobian, const iteration *it, const double *x, const double *r) {
    const uint32_t n = it->n;
    double square = 0.0;
    for (uint32_t j = 0; j < n; j++) square += (x[j] - it->x[j]) * (x[j] - it->x[j]);
    if (square == 0.0) return;
    for (uint32_t i = 0; i < n; i++) {
        double miss = r[i] - it->r[i];
        for (uint32_t j = 0; j < n; j++) miss -= jacobian[i * n + j] * (x[j] - it->x[j]);
        for (uint32_t j = 0; j < n; j++) jacobian[i * n + j] += miss * (x[j] - it->x[j]) / square;
    }
}

int solve_newton(uuv_core *core, iteration *it) {
    const uint32_t n = it->n;
    double *x = it->work, *r = x + n, *dx = r + n, *jacobian = dx + n, *lu = jacobian + (size_t)n * n;
    int known = 0, fresh = 0;
    while (!agreed(it, it->x, it->r)) {
        if (it->count++ >= it->limit) return not_converged(core, it, it->r);
        if (!known) {
            if (!differences(core, it, jacobian, x, r)) return ran_away(core, it, it->r);
            known = fresh = 1;
        }
        memcpy(lu, jacobian, (size_t)n * n * sizeof *lu);
        memcpy(dx, it->r, n * sizeof *dx);
        int better = 0;
        if (solve_dense(lu, dx, n)) {
            double part = 1.0;
            for (int k = 0; k < (fresh ? HALVINGS : 1) && !better; k++, part *= 0.5) {
                for (uint32_t j = 0; j < n; j++) x[j] = it->x[j] - part * dx[j];
                better = evaluate(core, it, x, r) && norm_of(r, n) < norm_of(it->r, n);
            }
        }
        if (better) {
            const int slow = norm_of(r, n) > 0.5 * norm_of(it->r, n);
            broyden(jacobian, it, x, r);
            memcpy(it->x, x, n * sizeof *x);
            memcpy(it->r, r, n * sizeof *r);
            known = !slow;
            fresh = 0;
        } else if (fresh) {
            return not_converged(core, it, it->r);
        } else {
            known = 0;
        }
    }
    return 1;
}
