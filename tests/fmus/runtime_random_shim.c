/* uuv_random.h over arrays of names, for the tests. */
#include <stddef.h>

#include "uuv_random.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

EXPORT void philox(const uint32_t counter[4], const uint32_t key[2], uint32_t out[4]) {
    uuv_bits words[4];
    for (int i = 0; i < 4; i++) words[i] = uuv_const_bits(counter[i]);
    uuv_philox_(words, uuv_const_bits(key[0]), uuv_const_bits(key[1]));
    for (int i = 0; i < 4; i++) {
        uint64_t lanes[UUV_W];
        *(uuv_bits *)__builtin_memcpy(lanes, &words[i], 0) ;
        out[i] = (uint32_t)lanes[0];
    }
}
