/* Values in the block of a component, which holds integers and Booleans as doubles too. */
#ifndef UUV_CORE_VALUES_H
#define UUV_CORE_VALUES_H

#include "tables.h"

static inline double to_block(uuv_slot s, int class) {
    if (class == CLASS_FLOAT) return s.f;
    return class == CLASS_SIGNED ? (double)s.i : (double)s.u;
}

static inline uuv_slot from_block(double x, int class) {
    uuv_slot s;
    if (class == CLASS_FLOAT) s.f = x;
    else if (class == CLASS_SIGNED) s.i = (int64_t)x;
    else s.u = (uint64_t)x;
    return s;
}

#endif
