/* What one would write by hand: Jacobi over a chain of FMI 3.0 FMUs, each with u and y. */
#include <stdint.h>

#include "fmi3FunctionTypes.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct {
    fmi3Instance instance;
    fmi3DoStepTYPE *do_step;
    fmi3GetFloat64TYPE *get;
    fmi3SetFloat64TYPE *set;
    uint32_t u, y;
} fmu;

EXPORT int plain_loop(const fmu *fmus, int n, int64_t n_steps, double h, double *y) {
    fmi3Boolean event, end, early;
    fmi3Float64 reached;
    for (int64_t k = 0; k < n_steps; k++) {
        for (int i = 0; i < n; i++)
            if (fmus[i].get(fmus[i].instance, &fmus[i].y, 1, &y[i], 1) > fmi3Warning) return 1;
        for (int i = 1; i < n; i++)
            if (fmus[i].set(fmus[i].instance, &fmus[i].u, 1, &y[i - 1], 1) > fmi3Warning) return 1;
        for (int i = 0; i < n; i++)
            if (fmus[i].do_step(fmus[i].instance, (double)k * h, h, fmi3False, &event, &end, &early,
                                &reached) > fmi3Warning) return 1;
    }
    return 0;
}
