/* What one would write by hand: Jacobi over a chain of FMI 2.0 FMUs, each with u and y. With rows,
 * every y is written down at every communication point. */
#include <stdint.h>

#include "fmi2FunctionTypes.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
    fmi2Component instance;
    fmi2DoStepTYPE *do_step;
    fmi2GetRealTYPE *get;
    fmi2SetRealTYPE *set;
    uint32_t u, y;
} fmu;

static int get_all(const fmu *fmus, int n, double *y) {
    for (int i = 0; i < n; i++)
        if (fmus[i].get(fmus[i].instance, &fmus[i].y, 1, &y[i]) > fmi2Warning) return 0;
    return 1;
}

EXPORT int chain_loop(const fmu *fmus, int n, int64_t n_steps, double h, double *y, double *rows) {
    if (!get_all(fmus, n, y)) return 1;
    for (int64_t k = 0; k < n_steps; k++) {
        for (int i = 0; rows && i < n; i++) rows[k * n + i] = y[i];
        for (int i = 1; i < n; i++)
            if (fmus[i].set(fmus[i].instance, &fmus[i].u, 1, &y[i - 1]) > fmi2Warning) return 1;
        for (int i = 0; i < n; i++)
            if (fmus[i].do_step(fmus[i].instance, (double)k * h, h, fmi2False) > fmi2Warning) return 1;
        if (!get_all(fmus, n, y)) return 1;
    }
    for (int i = 0; rows && i < n; i++) rows[n_steps * n + i] = y[i];
    return 0;
}
