/* Every function of uuv_float_math.h over arrays of floats; n is a multiple of UUV_W. */
#include <stddef.h>
#include <string.h>

#include "uuv_lane_component.h"

#define UNARY(name)                                                                   \
    UUV_KERNEL_API void array_##name(size_t n, const float *x, float *out) {          \
        for (size_t i = 0; i < n; i += UUV_W) {                                       \
            V a;                                                                      \
            memcpy(&a, x + i, sizeof a);                                              \
            a = uuv_##name(a);                                                        \
            memcpy(out + i, &a, sizeof a);                                            \
        }                                                                             \
    }
#define BINARY(name)                                                                  \
    UUV_KERNEL_API void array_##name(size_t n, const float *x, const float *y, float *out) { \
        for (size_t i = 0; i < n; i += UUV_W) {                                       \
            V a, b;                                                                   \
            memcpy(&a, x + i, sizeof a);                                              \
            memcpy(&b, y + i, sizeof b);                                              \
            a = uuv_##name(a, b);                                                     \
            memcpy(out + i, &a, sizeof a);                                            \
        }                                                                             \
    }

UNARY(neg)
UNARY(exp)
UNARY(log)
UNARY(sqrt)
UNARY(sq)
UNARY(twice)
UNARY(sin)
UNARY(cos)
UNARY(tan)
UNARY(asin)
UNARY(acos)
UNARY(atan)
UNARY(not)
UNARY(floor)
UNARY(ceil)
UNARY(fabs)
UNARY(sign)
UNARY(inv)
UNARY(sinh)
UNARY(cosh)
UNARY(tanh)
UNARY(asinh)
UNARY(acosh)
UNARY(atanh)
UNARY(log1p)
UNARY(expm1)
BINARY(pow)
BINARY(constpow)
BINARY(lt)
BINARY(le)
BINARY(eq)
BINARY(ne)
BINARY(and)
BINARY(or)
BINARY(fmod)
BINARY(copysign)
BINARY(if_else_zero)
BINARY(fmin)
BINARY(fmax)
BINARY(atan2)
BINARY(hypot)
BINARY(remainder)
