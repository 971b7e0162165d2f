/* Loads an FMI 3.0 DLL, steps it, and writes the bits of an output after each step. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <windows.h>

#include "fmi3FunctionTypes.h"

static void write_message(fmi3InstanceEnvironment environment, fmi3Status status,
                          fmi3String category, fmi3String message) {
    (void)environment, (void)status, (void)category;
    fprintf(stderr, "%s\n", message);
}

#define FIND(name) name##TYPE *name = (name##TYPE *)(void *)GetProcAddress(library, #name)

int main(int argc, char **argv) {
    if (argc != 8) return 10;
    HMODULE library = LoadLibraryA(argv[1]);
    if (!library) return 11;
    const fmi3ValueReference u = (fmi3ValueReference)atoi(argv[3]);
    const fmi3ValueReference y = (fmi3ValueReference)atoi(argv[5]);
    const size_t n_u = (size_t)atoi(argv[4]), n_y = (size_t)atoi(argv[6]);
    const int steps = atoi(argv[7]);
    const double h = 0.03;
    double in[64], out[64];
    FIND(fmi3EnterInitializationMode);
    FIND(fmi3ExitInitializationMode);
    FIND(fmi3SetFloat64);
    FIND(fmi3GetFloat64);
    FIND(fmi3DoStep);
    FIND(fmi3Terminate);
    FIND(fmi3FreeInstance);
    fmi3InstantiateCoSimulationTYPE *instantiate = (fmi3InstantiateCoSimulationTYPE *)(void *)
        GetProcAddress(library, "fmi3InstantiateCoSimulation");
    if (!instantiate || !fmi3DoStep || !fmi3SetFloat64 || !fmi3GetFloat64) return 12;
    fmi3Instance x = instantiate("it", argv[2], NULL, false, false, false, false, NULL, 0, NULL,
                                 write_message, NULL);
    if (!x) return 13;
    if (fmi3EnterInitializationMode(x, false, 0.0, 0.0, false, 0.0)) return 14;
    if (fmi3ExitInitializationMode(x)) return 15;
    for (int k = 0; k < steps; k++) {
        bool event, terminate, early;
        double last;
        for (size_t i = 0; i < n_u; i++) in[i] = 0.01 * k - 0.25 * (double)i;
        if (fmi3SetFloat64(x, &u, 1, in, n_u)) return 16;
        if (fmi3DoStep(x, k * h, h, true, &event, &terminate, &early, &last)) return 17;
        if (fmi3GetFloat64(x, &y, 1, out, n_y)) return 18;
        for (size_t i = 0; i < n_y; i++) {
            uint64_t bits;
            memcpy(&bits, &out[i], sizeof bits);
            printf("%016" PRIx64 "\n", bits);
        }
    }
    if (fmi3Terminate(x)) return 19;
    fmi3FreeInstance(x);
    return 0;
}
