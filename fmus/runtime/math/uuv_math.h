/* SPDX-License-Identifier: Apache-2.0 */
/* Every operation that CasADi's expressions are made of, as uuv_<operation> on W lanes.
 *
 * Made of + - * / sqrt, comparisons and bits alone: no libm, no libc, no table look-up, and bits
 * that are equal for every UUV_W, compiler and processor (conditions: uuv_lanes.h). All functions
 * are total: every finite argument, however large, and the edge cases (signed zeros, infinities,
 * NaN, subnormals) of C99, Annex F. fmod and remainder are exact; the largest errors found, in ulp:
 *   exp 0.9  expm1 1.1  log 0.9  log1p 0.9  pow 1.0  hypot 1.2  sin 0.9  cos 0.9  tan 1.2  asin 0.8
 *   acos 0.7  atan 1.0  atan2 1.5  sinh 1.0  cosh 0.9  tanh 1.0  asinh 0.7  acosh 0.9  atanh 1.0
 *
 *   uuv_lanes.h         V, masks, select, sqrt, neg, fabs, copysign
 *   uuv_arithmetic.h    add ... inv, lt ... or, if_else_zero, sign, fmin, fmax, floor, ceil
 *   uuv_remainder.h     fmod, remainder
 *   uuv_exp_log.h       exp, expm1, log, log1p
 *   uuv_power.h         pow, constpow, hypot
 *   uuv_trig.h          sin, cos, sincos, tan
 *   uuv_inverse_trig.h  asin, acos, atan, atan2
 *   uuv_hyperbolic.h    sinh, cosh, tanh, asinh, acosh, atanh
 *
 * Names that end in _ are not for use outside these headers.
 */
#ifndef UUV_MATH_H
#define UUV_MATH_H

#include "uuv_arithmetic.h"
#include "uuv_exp_log.h"
#include "uuv_hyperbolic.h"
#include "uuv_inverse_trig.h"
#include "uuv_lanes.h"
#include "uuv_power.h"
#include "uuv_remainder.h"
#include "uuv_trig.h"

#endif
