/* SPDX-License-Identifier: Apache-2.0 */
/* What a ranging instrument sees: a few rays with their incidence, or a whole frame with its noise.
 */
#ifndef UUV_RAYS_H
#define UUV_RAYS_H

#include "uuv_touch.h"

#define UUV_MOVERS 64 /* at most */

#if UUV_W == 1
#define UUV_PUT_LANE(v, lane, x) ((v) = (uuv_real)(x))
#else
#define UUV_PUT_LANE(v, lane, x) ((v)[lane] = (uuv_real)(x))
#endif

static inline int uuv_movers_(const double *x, int n, uuv_solid *moving) {
    int there = 0;
    for (int i = 0; i < n; i++)
        if (x[UUV_MOVING * i + 6] > 0.0) moving[there++] = uuv_moving_(x + UUV_MOVING * i);
    return there;
}

/* x: origin (3), the farthest range, the moving, n directions (3 each). y: n ranges, -1 where
 * nothing solid is met from outside, then n cosines of the incidence, 0 there. With a seed, y is
 * the derivative along it. */
static inline void uuv_rays(const uuv_scene *s, int n, int n_moving, const double *x, const double *seed,
                     double *y) {
    uuv_solid moving[UUV_MOVERS];
    const int there = uuv_movers_(x + 4, n_moving, moving);
    const double *d = x + 4 + UUV_MOVING * n_moving;
    const double *d_seed = seed ? seed + 4 + UUV_MOVING * n_moving : 0;
    for (int i = 0; i < n; i++, d += 3) {
        uuv_hit hit;
        uuv_cast(s, moving, there, x, d, x[3], &hit);
        const double into = -uuv_dot_(hit.n, d), size = uuv_root_(uuv_dot_(d, d));
        const int echo = (hit.kind == UUV_HIT_SEABED || hit.kind >= UUV_HIT_SOLID) && into > 0.0;
        y[i] = seed ? 0.0 : echo ? hit.t : -1.0;
        y[n + i] = !seed && echo ? into / size : 0.0;
        if (seed && echo) {
            const double *v = d_seed + 3 * i;
            double p[3];
            for (int k = 0; k < 3; k++) p[k] = seed[k] + hit.t * v[k];
            y[i] = uuv_dot_(hit.n, p) / into;
            y[n + i] = -(uuv_dot_(hit.n, v) + into * uuv_dot_(d, v) / (size * size)) / size;
        }
    }
}

/* Rays of a frame in sensor axes: n unit vectors; `depth`: readings are along z. */
typedef struct {
    int n, n_moving, depth;
    const double *d;
} uuv_frame;

enum { UUV_FRAME_HEAD = 19 };

/* x: origin (3), rotation from sensor axes row by row (9), then noise: constant and relative part,
 * common error, least and farthest range, least cosine of incidence, share of lost readings; the
 * moving; a normal draw a ray. y: n readings, 0 where there is none, and how many there are.
 * A draw's lower digits, uniform and independent of its size, decide what is lost. */
static inline void uuv_frame_seen(const uuv_scene *s, const uuv_frame *f, const double *x, double *y) {
    uuv_solid moving[UUV_MOVERS];
    const int there = uuv_movers_(x + UUV_FRAME_HEAD, f->n_moving, moving);
    const double *R = x + 3, *e = x + 12, *w = x + UUV_FRAME_HEAD + UUV_MOVING * f->n_moving;
    int count = 0;
    for (int i = 0; i < f->n; i++) {
        const double *a = f->d + 3 * i;
        const double d[3] = {uuv_dot_(R, a), uuv_dot_(R + 3, a), uuv_dot_(R + 6, a)};
        uuv_hit hit;
        uuv_cast(s, moving, there, x, d, e[4], &hit);
        const double into = -uuv_dot_(hit.n, d), many = (w[i] + 16.0) * 1024.0;
        const double digits = many - (double)(int)many;
        y[i] = 0.0;
        if (!(hit.kind == UUV_HIT_SEABED || hit.kind >= UUV_HIT_SOLID)) continue;
        if (!(into >= e[5]) || hit.t < e[3] || digits < e[6]) continue;
        const double r = e[1] * hit.t;
        const double range = hit.t + e[2] + uuv_root_(e[0] * e[0] + r * r) * w[i];
        if (!(range > 0.0)) continue;
        y[i] = f->depth ? range * a[2] : range;
        count++;
    }
    y[f->n] = count;
}

#endif
