/* SPDX-License-Identifier: Apache-2.0 */
/* How deep a ball is in each solid of a scene, and the force with which springs and dampers push.
 *
 * Against the seabed and each solid, with d the depth of penetration by the distance to the nearest
 * point of its surface, n the outward normal there and v the velocity,
 *
 *     F = sum n max(0, K d + C dd/dt),    dd/dt = -n v.
 *
 * The distance to a surface has slope 1 and K d²/2 a second derivative of at most K, edges
 * included: what a step must be small for (models/contact.py). The nearest point is sought among
 * the triangles of the cells that lie within reach.
 */
#ifndef UUV_TOUCH_H
#define UUV_TOUCH_H

#include "uuv_cast.h"

static inline double uuv_dot_(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline double uuv_unit_interval_(double x) { return x > 0.0 ? (x < 1.0 ? x : 1.0) : 0.0; }

/* The square of the distance from p to its nearest point q of a segment from a to b. */
static inline double uuv_near_edge_(const double p[3], const double a[3], const double b[3], double q[3]) {
    const double e[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double w[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double s = uuv_unit_interval_(uuv_dot_(w, e) / uuv_dot_(e, e));
    double r[3];
    for (int k = 0; k < 3; k++) {
        q[k] = a[k] + s * e[k];
        r[k] = p[k] - q[k];
    }
    return uuv_dot_(r, r);
}

/* The same of a triangle. */
static inline double uuv_near_triangle_(const double p[3], const double a[3], const double b[3],
                                 const double c[3], double q[3]) {
    const double u[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
    const double v[3] = {c[0] - a[0], c[1] - a[1], c[2] - a[2]};
    const double w[3] = {p[0] - a[0], p[1] - a[1], p[2] - a[2]};
    const double uu = uuv_dot_(u, u), uv = uuv_dot_(u, v), vv = uuv_dot_(v, v);
    const double wu = uuv_dot_(w, u), wv = uuv_dot_(w, v), whole = uu * vv - uv * uv;
    const double s = (vv * wu - uv * wv) / whole, t = (uu * wv - uv * wu) / whole;
    if (s >= 0.0 && t >= 0.0 && s + t <= 1.0) {
        double r[3];
        for (int k = 0; k < 3; k++) {
            q[k] = a[k] + s * u[k] + t * v[k];
            r[k] = p[k] - q[k];
        }
        return uuv_dot_(r, r);
    }
    double other[3], best = uuv_near_edge_(p, a, b, q);
    const double *ends[2][2] = {{b, c}, {c, a}};
    for (int e = 0; e < 2; e++) {
        const double square = uuv_near_edge_(p, ends[e][0], ends[e][1], other);
        if (!(square < best)) continue;
        best = square;
        for (int k = 0; k < 3; k++) q[k] = other[k];
    }
    return best;
}

/* The depth of p in the seabed, negative above it; 0 where it is farther off than `reach`. */
static inline int uuv_depth_in_terrain_(const uuv_terrain *g, const double p[3], double reach, double *d,
                                 double n[3]) {
    const double gap = p[2] - uuv_height(g, p[0], p[1]);
    if (gap != gap) return 0; /* outside of the terrain, or over a hole */
    const double most = gap > 0.0 ? (gap < 2.0 * g->spacing ? gap : 2.0 * g->spacing) : reach;
    const double x = (p[0] - g->north) / g->spacing, y = (p[1] - g->east) / g->spacing;
    const double r = most / g->spacing;
    const int i0 = uuv_within_(x - r, 0, g->rows - 2), i1 = uuv_within_(x + r, 0, g->rows - 2);
    const int j0 = uuv_within_(y - r, 0, g->columns - 2), j1 = uuv_within_(y + r, 0, g->columns - 2);
    int near = gap > 0.0;
    for (int i = i0; i <= i1 + 1 && !near; i++)
        for (int j = j0; j <= j1 + 1 && !near; j++)
            near = g->z[(int64_t)i * g->columns + j] < p[2] + reach;
    if (!near) return 0;
    double best = gap * gap, nearest[3] = {p[0], p[1], p[2] - gap};
    for (int i = i0; i <= i1; i++)
        for (int j = j0; j <= j1; j++) {
            const uuv_corners_ c = uuv_corners_of_(g, i, j);
            const double n0 = g->north + i * g->spacing, n1 = g->north + (i + 1) * g->spacing;
            const double e0 = g->east + j * g->spacing, e1 = g->east + (j + 1) * g->spacing;
            const double a[3] = {n0, e0, c.z00}, b[3] = {n1, e1, c.z11};
            const double third[2][3] = {{n1, e0, c.z10}, {n0, e1, c.z01}};
            for (int k = 0; k < 2; k++) {
                double q[3];
                if (a[2] != a[2] || b[2] != b[2] || third[k][2] != third[k][2]) continue;
                const double square = uuv_near_triangle_(p, a, b, third[k], q);
                if (!(square < best)) continue;
                best = square;
                for (int m = 0; m < 3; m++) nearest[m] = q[m];
            }
        }
    const double distance = uuv_root_(best);
    *d = gap > 0.0 ? distance : -distance;
    if (distance > 1e-9) {
        for (int k = 0; k < 3; k++) n[k] = (nearest[k] - p[k]) / *d;
    } else { /* on the surface: the normal of its triangle */
        const int i = uuv_within_(x, 0, g->rows - 2), j = uuv_within_(y, 0, g->columns - 2);
        const uuv_corners_ c = uuv_corners_of_(g, i, j);
        double a, b;
        uuv_slopes_(&c, x - i >= y - j, &a, &b);
        const double up = g->spacing / uuv_root_(a * a + b * b + g->spacing * g->spacing);
        n[0] = a / g->spacing * up;
        n[1] = b / g->spacing * up;
        n[2] = -up;
    }
    return 1;
}

/* The depth of p, from its centre, in a body of half lengths `half` along `count` axes. */
static inline double uuv_depth_in_block_(const double *p, const double *half, int count, double *n) {
    double square = 0.0, least = -__builtin_inf();
    int side = 0;
    for (int k = 0; k < count; k++) {
        const double beyond = (p[k] < 0.0 ? -p[k] : p[k]) - half[k];
        n[k] = beyond > 0.0 ? (p[k] < 0.0 ? -beyond : beyond) : 0.0;
        square += n[k] * n[k];
        if (beyond > least) least = beyond, side = k;
    }
    if (least > 0.0) {
        const double distance = uuv_root_(square);
        for (int k = 0; k < count; k++) n[k] /= distance;
        return -distance;
    }
    for (int k = 0; k < count; k++) n[k] = k == side ? (p[k] < 0.0 ? -1.0 : 1.0) : 0.0;
    return -least;
}

/* The depth of the place p in a solid, negative outside of it, and the normal outwards. */
static inline double uuv_depth_in_solid_(const uuv_solid *s, const double place[3], double n[3]) {
    double p[3] = {place[0] - s->centre[0], place[1] - s->centre[1], place[2] - s->centre[2]};
    if (s->kind == UUV_BOX) {
        const double c = s->size[3], w = s->size[4];
        const double at[3] = {c * p[0] + w * p[1], c * p[1] - w * p[0], p[2]};
        double m[3];
        const double d = uuv_depth_in_block_(at, s->size, 3, m);
        n[0] = c * m[0] - w * m[1];
        n[1] = w * m[0] + c * m[1];
        n[2] = m[2];
        return d;
    }
    if (s->kind == UUV_CYLINDER) {
        const double off = uuv_root_(p[0] * p[0] + p[1] * p[1]), at[2] = {off, p[2]};
        double m[2];
        const double d = uuv_depth_in_block_(at, s->size, 2, m);
        n[0] = off > 0.0 ? m[0] * p[0] / off : m[0];
        n[1] = off > 0.0 ? m[0] * p[1] / off : 0.0;
        n[2] = m[1];
        return d;
    }
    double radius = s->size[0];
    if (s->kind == UUV_CAPSULE) {
        const double *e = s->size, ee = uuv_dot_(e, e);
        double along = ee > 0.0 ? uuv_dot_(p, e) / ee : 0.0;
        along = along > 1.0 ? 1.0 : along < -1.0 ? -1.0 : along;
        for (int k = 0; k < 3; k++) p[k] -= along * e[k];
        radius = s->size[3];
    }
    const double off = uuv_root_(uuv_dot_(p, p));
    for (int k = 0; k < 3; k++) n[k] = off > 0.0 ? p[k] / off : (k == 2 ? -1.0 : 0.0);
    return radius - off;
}

/* Capsules that move: centre, middle half the way to an end, radius, velocity; radius 0: none. */
#define UUV_MOVING 10

static inline uuv_solid uuv_moving_(const double *m) {
    uuv_solid s = {UUV_CAPSULE, {m[0], m[1], m[2]}, {m[3], m[4], m[5], m[6], 0.0}, 0.0};
    s.bound = uuv_root_(uuv_dot_(m + 3, m + 3)) + m[6];
    return s;
}

/* x: place and velocity of a ball (3 each), K, C, its radius, then the moving. y: the force (3),
 * the greatest depth or 0. With a seed, y is the derivative along it, for a surface without bend. */
static inline void uuv_touch(const uuv_scene *s, int n_moving, const double *x, const double *seed,
                      double *y) {
    const double K = x[6], C = x[7], ball = x[8];
    double fastest = uuv_root_(uuv_dot_(x + 3, x + 3)), deepest = 0.0;
    for (int k = 0; k < 4; k++) y[k] = 0.0;
    const double reach = ball + (K > 0.0 ? C / K * fastest : 0.0);
    for (int i = -1; i < s->n_solids + n_moving; i++) {
        const double *own = i >= s->n_solids ? x + 9 + UUV_MOVING * (i - s->n_solids) : 0;
        double d, n[3];
        if (i < 0) {
            if (!uuv_depth_in_terrain_(&s->terrain, x, reach, &d, n)) continue;
        } else if (own) {
            const uuv_solid moving = uuv_moving_(own);
            if (!(own[6] > 0.0)) continue;
            d = uuv_depth_in_solid_(&moving, x, n);
        } else {
            const uuv_solid *solid = s->solid + i;
            const double p[3] = {x[0] - solid->centre[0], x[1] - solid->centre[1],
                                 x[2] - solid->centre[2]};
            const double most = solid->bound + reach;
            if (uuv_dot_(p, p) > most * most) continue;
            d = uuv_depth_in_solid_(solid, x, n);
        }
        d += ball;
        double v[3] = {x[3], x[4], x[5]};
        for (int k = 0; k < 3 && own; k++) v[k] -= own[7 + k];
        const double rate = -uuv_dot_(n, v), f = K * d + C * rate;
        double d_seed = 0.0, change = 0.0;
        if (seed) {
            const double *moved = own ? seed + (own - x) : 0;
            double p[3], w[3];
            for (int k = 0; k < 3; k++) {
                p[k] = seed[k] - (moved ? moved[k] : 0.0);
                w[k] = seed[3 + k] - (moved ? moved[7 + k] : 0.0);
            }
            d_seed = seed[8] - uuv_dot_(n, p) + (moved ? moved[6] : 0.0);
            change = seed[6] * d + K * d_seed + seed[7] * rate - C * uuv_dot_(n, w);
        }
        const double push = seed ? change : f;
        for (int k = 0; k < 3 && f > 0.0; k++) y[k] += n[k] * push;
        if (d > deepest) {
            deepest = d;
            y[3] = seed ? d_seed : d;
        }
    }
}

#endif
