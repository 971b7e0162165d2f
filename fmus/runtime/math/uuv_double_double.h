/* SPDX-License-Identifier: Apache-2.0 */
/* Sums and products without rounding error, as a rounded value and the error made.
 *
 * T. J. Dekker, A floating-point technique for extending the available precision, Numer. Math. 18
 * (1971); D. E. Knuth, The Art of Computer Programming, vol. 2, section 4.2.2.
 * A suffix _hi or h is the rounded value, _lo or l what it misses.
 */
#ifndef UUV_DOUBLE_DOUBLE_H
#define UUV_DOUBLE_DOUBLE_H

#include "uuv_arithmetic.h"

/* a + b = sum + *error, for any a and b. */
static inline V uuv_two_sum_(V a, V b, V *error) {
    const V sum = a + b;
    const V b_taken = sum - a;
    *error = (a - (sum - b_taken)) + (b - b_taken);
    return sum;
}

/* a + b = sum + *error, where |a| >= |b| or a = 0. */
static inline V uuv_fast_two_sum_(V a, V b, V *error) {
    const V sum = a + b;
    *error = (a - sum) + b; /* after the last use of a and b, which may be *error's old value */
    return sum;
}

/* x to its upper 26 bits, rounded to nearest, so that what is left has 26 bits too. By bits, and
 * not by Dekker's multiplication, which overflows for large x. */
static inline V uuv_upper_half_(V x) {
    return uuv_from_bits((uuv_to_bits(x) + 0x4000000u) & ~(uint64_t)0x7ffffff);
}

/* a * b = product + *error, where nothing over- or underflows. */
static inline V uuv_two_product_(V a, V b, V *error) {
    const V product = a * b;
    const V ah = uuv_upper_half_(a), bh = uuv_upper_half_(b);
    const V al = a - ah, bl = b - bh;
    *error = ((ah * bh - product) + ah * bl + al * bh) + al * bl;
    return product;
}

/* sqrt(x_hi + x_lo), without over- or underflow in x; 0 at 0. */
static inline V uuv_two_sqrt_(V x_hi, V x_lo, V *error) {
    V square_lo;
    const V root = uuv_sqrt(x_hi);
    const V square = uuv_two_product_(root, root, &square_lo);
    const V e = (((x_hi - square) - square_lo) + x_lo) / (root + root);
    *error = uuv_keep(uuv_mask_true(root), e);
    return root;
}

/* (n_hi + n_lo) / (d_hi + d_lo), rounded: one Newton step from n_hi / d_hi. */
static inline V uuv_ratio_(V n_hi, V n_lo, V d_hi, V d_lo) {
    V error;
    const V q = n_hi / d_hi;
    const V product = uuv_two_product_(q, d_hi, &error);
    return q + (((n_hi - product) - error) + (n_lo - q * d_lo)) / d_hi;
}

#endif
