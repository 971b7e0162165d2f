/* A small dense linear system, and the length of a vector. */
#include <math.h>

#include "iterate.h"

double norm_of(const double *v, uint32_t n) {
    double square = 0.0;
    for (uint32_t j = 0; j < n; j++) square += v[j] * v[j];
    return sqrt(square);
}

static void swap_rows(double *a, double *b, uint32_t n, uint32_t i, uint32_t k) {
    for (uint32_t j = 0; j < n; j++) {
        const double kept = a[i * n + j];
        a[i * n + j] = a[k * n + j];
        a[k * n + j] = kept;
    }
    const double kept = b[i];
    b[i] = b[k];
    b[k] = kept;
}

int solve_dense(double *a, double *b, uint32_t n) {
    for (uint32_t k = 0; k < n; k++) {
        uint32_t pivot = k;
        for (uint32_t i = k + 1; i < n; i++)
            if (fabs(a[i * n + k]) > fabs(a[pivot * n + k])) pivot = i;
        if (!(fabs(a[pivot * n + k]) > 0.0)) return 0;
        if (pivot != k) swap_rows(a, b, n, pivot, k);
        for (uint32_t i = k + 1; i < n; i++) {
            const double factor = a[i * n + k] / a[k * n + k];
            for (uint32_t j = k; j < n; j++) a[i * n + j] -= factor * a[k * n + j];
            b[i] -= factor * b[k];
        }
    }
    for (uint32_t k = n; k-- > 0;) {
        for (uint32_t j = k + 1; j < n; j++) b[k] -= a[k * n + j] * b[j];
        b[k] /= a[k * n + k];
    }
    return 1;
}
