/* Every function of uuv_math.h over arrays, for the tests: loads UUV_W values at a time. */
#include <stddef.h>

#include "uuv_math.h"

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* n is a multiple of UUV_W. */
#define UNARY(name)                                                        \
    EXPORT void array_##name(size_t n, const double *x, double *out) {     \
        for (size_t i = 0; i < n; i += UUV_W)                              \
            uuv_store(out + i, uuv_##name(uuv_load(x + i)));               \
    }
#define BINARY(name)                                                                         \
    EXPORT void array_##name(size_t n, const double *x, const double *y, double *out) {      \
        for (size_t i = 0; i < n; i += UUV_W)                                                \
            uuv_store(out + i, uuv_##name(uuv_load(x + i), uuv_load(y + i)));                \
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

BINARY(add)
BINARY(sub)
BINARY(mul)
BINARY(div)
BINARY(pow)
BINARY(constpow)
BINARY(lt)
BINARY(le)
BINARY(eq)
BINARY(ne)
BINARY(and)
BINARY(or)
BINARY(fmod)
BINARY(remainder)
BINARY(copysign)
BINARY(if_else_zero)
BINARY(fmin)
BINARY(fmax)
BINARY(atan2)
BINARY(hypot)

EXPORT void array_sincos(size_t n, const double *x, double *s, double *c) {
    for (size_t i = 0; i < n; i += UUV_W) {
        V sine, cosine;
        uuv_sincos(uuv_load(x + i), &sine, &cosine);
        uuv_store(s + i, sine);
        uuv_store(c + i, cosine);
    }
}

EXPORT void array_if_else(size_t n, const double *c, const double *a, const double *b,
                          double *out) {
    for (size_t i = 0; i < n; i += UUV_W)
        uuv_store(out + i, uuv_if_else(uuv_load(c + i), uuv_load(a + i), uuv_load(b + i)));
}

EXPORT void array_select_less(size_t n, const double *a, const double *b, double *out) {
    for (size_t i = 0; i < n; i += UUV_W) {
        const V x = uuv_load(a + i), y = uuv_load(b + i);
        uuv_store(out + i, uuv_select(uuv_mask_lt(x, y), x, y));
    }
}

EXPORT int all_finite(const double *x) { return uuv_all_finite(uuv_load(x)); }
