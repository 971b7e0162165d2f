/* Anderson acceleration: of the last few trials, the combination whose residual is least.
 *
 *     x <- x + r - (dX + dR) g,   g = argmin |r - dR g|
 *
 * with the changes of x and r between trials as columns of dX and dR (Walker and Ni 2011). */
#include <math.h>
#include <string.h>

#include "iterate.h"

enum { DEPTH = 5 };

/* Least squares by modified Gram-Schmidt on a copy of dR (columns of n); dependent ones get 0. */
static void least_squares(double *q, uint32_t n, uint32_t m, double *rest, double *g) {
    double upper[DEPTH][DEPTH] = {{0}}, c[DEPTH] = {0};
    for (uint32_t k = 0; k < m; k++) {
        double *column = q + (size_t)k * n;
        const double before = norm_of(column, n);
        for (uint32_t i = 0; i < k; i++) {
            const double *other = q + (size_t)i * n;
            for (uint32_t j = 0; j < n; j++) upper[i][k] += other[j] * column[j];
            for (uint32_t j = 0; j < n; j++) column[j] -= upper[i][k] * other[j];
        }
        const double length = norm_of(column, n);
        upper[k][k] = length > 1e-10 * before ? length : 0.0;
        for (uint32_t j = 0; j < n; j++) column[j] = upper[k][k] > 0.0 ? column[j] / length : 0.0;
        for (uint32_t j = 0; j < n; j++) c[k] += column[j] * rest[j];
        for (uint32_t j = 0; j < n; j++) rest[j] -= c[k] * column[j];
    }
    for (uint32_t k = m; k-- > 0;) {
        g[k] = c[k];
        for (uint32_t i = k + 1; i < m; i++) g[k] -= upper[k][i] * g[i];
        g[k] = upper[k][k] > 0.0 ? g[k] / upper[k][k] : 0.0;
    }
}

int solve_anderson(uuv_core *core, iteration *it) {
    const uint32_t n = it->n, depth = n < DEPTH ? n : DEPTH;
    double *x = it->work, *r = x + n, *dX = r + n, *dR = dX + (size_t)DEPTH * n;
    double *q = dR + (size_t)DEPTH * n, *rest = q + (size_t)DEPTH * n, g[DEPTH];
    uint32_t trials = 0;
    while (!agreed(it, it->x, it->r)) {
        if (it->count++ >= it->limit) return not_converged(core, it, it->r);
        const uint32_t m = trials < depth ? trials : depth;
        memcpy(q, dR, (size_t)m * n * sizeof *q);
        memcpy(rest, it->r, n * sizeof *rest);
        least_squares(q, n, m, rest, g);
        for (uint32_t j = 0; j < n; j++) {
            x[j] = it->x[j] + it->r[j];
            for (uint32_t k = 0; k < m; k++) x[j] -= g[k] * (dX[k * n + j] + dR[k * n + j]);
        }
        if (!evaluate(core, it, x, r)) return ran_away(core, it, it->r);
        const size_t place = trials++ % depth;
        for (uint32_t j = 0; j < n; j++) {
            dX[place * n + j] = x[j] - it->x[j];
            dR[place * n + j] = r[j] - it->r[j];
        }
        memcpy(it->x, x, n * sizeof *x);
        memcpy(it->r, r, n * sizeof *r);
    }
    return 1;
}

/* Newton needs 3 n + 2 n^2, Anderson 3 n + 3 DEPTH n. */
size_t work_size(uint32_t n) { return 3 * (size_t)n + (size_t)n * (2 * (size_t)n + 3 * DEPTH); }
