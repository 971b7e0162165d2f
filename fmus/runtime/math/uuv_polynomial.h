/* SPDX-License-Identifier: Apache-2.0 */
/* Polynomials c[0] + c[1] x + c[2] x^2 + ..., evaluated in independent halves.
 *
 * Horner's rule is one chain of dependent operations, four cycles each; pairs (Estrin) keep a
 * processor's pipelines full. Coefficients: tests/fmus/runtime/derive_polynomials.py.
 */
#ifndef UUV_POLYNOMIAL_H
#define UUV_POLYNOMIAL_H

#include "uuv_lanes.h"

static inline V uuv_poly4_(V x, V x2, const uuv_real *c) {
    return (c[0] + c[1] * x) + (c[2] + c[3] * x) * x2;
}
static inline V uuv_poly6_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2;
    return uuv_poly4_(x, x2, c) + (c[4] + c[5] * x) * x4;
}
static inline V uuv_poly7_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2;
    return uuv_poly4_(x, x2, c) + ((c[4] + c[5] * x) + c[6] * x2) * x4;
}
static inline V uuv_poly8_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2;
    return uuv_poly4_(x, x2, c) + uuv_poly4_(x, x2, c + 4) * x4;
}
static inline V uuv_poly10_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2;
    return uuv_poly4_(x, x2, c) + (uuv_poly4_(x, x2, c + 4) + (c[8] + c[9] * x) * x4) * x4;
}
static inline V uuv_poly12_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2;
    return uuv_poly4_(x, x2, c) +
           (uuv_poly4_(x, x2, c + 4) + uuv_poly4_(x, x2, c + 8) * x4) * x4;
}
static inline V uuv_poly13_(V x, const uuv_real *c) {
    const V x2 = x * x, x4 = x2 * x2, x8 = x4 * x4;
    return (uuv_poly4_(x, x2, c) + uuv_poly4_(x, x2, c + 4) * x4) +
           (uuv_poly4_(x, x2, c + 8) + c[12] * x4) * x8;
}

#endif
