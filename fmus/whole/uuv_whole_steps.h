/* SPDX-License-Identifier: Apache-2.0 */
/* Communication points of a whole system as one FMU: times are whole multiples of its tick. */
#ifndef UUV_WHOLE_STEPS_H
#define UUV_WHOLE_STEPS_H

#include <stdint.h>
#include <stdio.h>

/* Which communication point a time after the start is, with a tick of num / den seconds; -1: none. */
static int64_t whole_point(double elapsed, double num, double den) {
    const double ticks = elapsed * den / num;
    const double slack = 1e-6 + 1e-9 * (ticks + 1.0);
    if (!(ticks > -0.5 && ticks < 4e15)) return -1;
    const int64_t n = (int64_t)(ticks + 0.5);
    const double off = ticks - (double)n;
    return off <= slack && -off <= slack ? n : -1;
}

/* Why a step from point `now` to point `end` is refused, written to `text`; NULL: it is not. */
static const char *whole_refused(char *text, size_t size, int64_t now, int64_t end, double t, double h, double tick) {
    const double off = h - (double)(end - now) * tick;
    if (end >= now && off <= 1e-5 * tick && -off <= 1e-5 * tick) return NULL;
    snprintf(text, size,
             "communicationStepSize is %.9g s, from %.9g s on; expected a whole multiple of the "
             "system's communication step, %.9g s", h, t, tick);
    return text;
}

#endif
