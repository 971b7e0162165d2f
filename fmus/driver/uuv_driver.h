/* SPDX-License-Identifier: Apache-2.0 */
/* A program that runs a fused system: `driver SEED STEPS` writes all outputs at all communication
 * points to standard output, one float64 an element, and ends early after a failure.
 *
 * Included after uuv_page.h; `output_places` are the places of the elements in the block of values,
 * and `seed_place` is that of the seed. */
#ifndef UUV_DRIVER_H
#define UUV_DRIVER_H

#include <stdio.h>
#include <stdlib.h>

static int put_row(const V *block) {
    V row[N_SUMS];
    for (uint32_t j = 0; j < N_SUMS; j++) row[j] = block[output_places[j]];
    return fwrite(row, sizeof row, 1, stdout) == 1;
}

int main(int n, char **arguments) {
    V *block = n == 3 ? uuv_page_open() : NULL;
    if (!block) return 2;
    block[seed_place] = strtod(arguments[1], NULL);
    uuv_page_begin();
    if (!put_row(block)) return 3;
    for (uint64_t left = strtoull(arguments[2], NULL, 10); left && !*uuv_page_failure(); left--)
        if (!uuv_page_run(1) || !put_row(block)) return 3;
    return fflush(stdout) ? 3 : 0;
}

#endif
