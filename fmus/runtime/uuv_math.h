/* SPDX-License-Identifier: Apache-2.0 */
/* Every operation that CasADi's expressions are made of, as uuv_<operation> on W lanes.
 *
 * Made of + - * / sqrt, comparisons and bits alone: no libm, no libc, no table look-up, and bits
 * that are equal for every UUV_W, compiler and processor (conditions: uuv_lanes.h). All functions
 * are total: edge cases (signed zeros, infinities, NaN, subnormals) are C99's, Annex F. Errors are
 * below 1.5 ulp, within 2 ulp with certainty tested, over the whole range of float64 numbers.
 *
 *   uuv_lanes.h         V, masks, select, sqrt, neg, fabs, copysign
 *   uuv_arithmetic.h    add ... inv, comparisons, logic, if_else_zero, sign, fmin, fmax, floor, ceil
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
